"""The coupling X = W^-1 Wt of a set of contacts, from their factors: W = N^T N and Wt = N^T T are never formed."""

import jax.numpy as jnp
from jax import Array, lax
from jax.scipy.linalg import solve_triangular

from .. import linalg
from ..linalg.orthogonal import triangularise
from ..linalg.unrolled import UNROLL_LIMIT, columns, from_rows, inner, shield

NOISE = 16
"""Roundings of the terms that make up an entry of X, below which it counts as zero."""

DEPENDENT = 32
"""A gap gradient counts as dependent on the earlier ones when at most this many roundings of its length are left."""

WRITTEN_OUT = 4
"""Up to this many contacts loops over columns and rows are written out: two to four times as fast; beyond, compiling
would take too long."""

SCALAR_COLUMNS = 2
"""Up to this many contacts the algebra is on scalars and fuses; beyond, on arrays, which compile much sooner."""


def coupling(N: Array, T: Array) -> Array:
    """X (m, k) with N^T N X = N^T T for N (n, m) of full rank and T (n, k): the least-squares coefficients of T on N.

    With N = E R, E orthonormal, X = R^-1 E^T T: the error is that of the condition of N, half the digits of W's. An
    entry within rounding of zero is zero, since r = inf ("never lost") hangs on which entries vanish; its derivative
    stays.

    `coupling(here.N, here.T)`
    """
    scalars = N.shape[1] <= SCALAR_COLUMNS and max(*N.shape, T.shape[1]) <= UNROLL_LIMIT
    X, noise = _on_scalars(N, T) if scalars else _on_arrays(N, T)
    nothing = lax.abs(X) <= NOISE * float(jnp.finfo(X.dtype).eps) * noise
    return X - lax.stop_gradient(jnp.where(nothing, X, 0))


def dependent(N: Array) -> Array:
    """bool: the columns of N depend on each other, to rounding, whatever their lengths. `dependent(here.N)`"""
    n, m = N.shape
    if m == 0 or n < m:
        return jnp.full((), n < m)
    N = lax.stop_gradient(N)
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    missing = length == 0
    units = N / jnp.where(missing, 1, length)[None, :]
    if m <= SCALAR_COLUMNS:
        left = linalg.singular_value_min(units)
    else:
        left = linalg.least(jnp.diag(orthogonal_triangular(units)[1]))
    return jnp.any(missing) | (left <= DEPENDENT * float(jnp.finfo(N.dtype).eps))


def square_factors(N: Array, T: Array) -> tuple[Array, Array]:
    """(R (m, m), Z (m, k)) with the same products: R^T R = N^T N and R^T Z = N^T T, for every choice of columns."""
    if N.shape[0] == N.shape[1]:
        return N, T
    E, R = orthogonal_triangular(N)
    return R, _product(E.T, T)


def orthogonal_triangular(N: Array) -> tuple[Array, Array]:
    """(E (n, m), R (m, m)): N = E R by modified Gram-Schmidt, every projection done twice; the library beyond.

    A zero column, and one that depends on the earlier ones exactly, gives zeros in E and in the diagonal of R.
    """
    m = N.shape[1]
    if m > UNROLL_LIMIT:
        return _positive(*jnp.linalg.qr(N))
    return _column_by_column(N) if m <= WRITTEN_OUT else _in_a_loop(N)


def _column_by_column(N: Array) -> tuple[Array, Array]:
    rest, E, R = [N[:, j] for j in range(N.shape[1])], [], []
    zero = jnp.zeros((), N.dtype)
    while rest:
        e, length = _unit(rest[0])
        first = [jnp.sum(e * x) for x in rest[1:]]
        rest = [x - e * t for x, t in zip(rest[1:], first, strict=True)]
        second = [jnp.sum(e * x) for x in rest]
        rest = [x - e * t for x, t in zip(rest, second, strict=True)]
        R.append([zero] * len(R) + [length] + [s + t for s, t in zip(first, second, strict=True)])
        E.append(e)
    return jnp.stack(E, axis=1), jnp.stack([jnp.stack(row) for row in R])


def _unit(x: Array) -> tuple[Array, Array]:
    """(x / |x|, |x|); zeros for a zero vector."""
    square = jnp.sum(x * x)
    there = square > 0
    length = jnp.where(there, jnp.sqrt(jnp.where(there, square, 1)), 0 * square)
    return x / jnp.where(there, length, 1), length


def _in_a_loop(N: Array) -> tuple[Array, Array]:
    m = N.shape[1]
    later = jnp.triu(jnp.ones((m, m), N.dtype), 1)
    one = jnp.eye(m, dtype=N.dtype)

    def projected(rest, row):
        here, after = row
        e, length = _unit(jnp.sum(rest * here[None, :], axis=1))
        first = jnp.sum(e[:, None] * rest, axis=0) * after
        rest = rest - e[:, None] * first[None, :]
        second = jnp.sum(e[:, None] * rest, axis=0) * after
        return rest - e[:, None] * second[None, :], (e, length * here + first + second)

    _, (E, R) = lax.scan(projected, N, (one, later))
    return E.T, R


def _positive(E: Array, R: Array) -> tuple[Array, Array]:
    """The same factors with a positive diagonal of R."""
    sign = jnp.where(jnp.diag(R) < 0, -1, 1).astype(R.dtype)
    return E * sign[None, :], R * sign[:, None]


def _product(A: Array, B: Array) -> Array:
    return jnp.matmul(A, B, precision=lax.Precision.HIGHEST)


def _on_arrays(N: Array, T: Array) -> tuple[Array, Array]:
    """X and the sum of the absolute values of the terms it is made of: back substitution, rows from the last."""
    E, R = orthogonal_triangular(N)
    value, terms = _product(E.T, T), _product(abs(E).T, abs(T))
    if len(R) > UNROLL_LIMIT:
        comparison = lax.stop_gradient(2 * jnp.diag(jnp.diag(R)) - abs(R))
        return solve_triangular(R, value), solve_triangular(comparison, lax.stop_gradient(terms))
    if len(R) <= WRITTEN_OUT:
        return _row_by_row(R, value, terms)
    one = jnp.eye(len(R), dtype=R.dtype)

    def substituted(state, row):
        X, size = state
        here, R_i, value_i, terms_i = row
        pivot = jnp.sum(R_i * here)
        rest = R_i - pivot * here
        x = (value_i - jnp.sum(rest[:, None] * X, axis=0)) / pivot
        most = (terms_i + jnp.sum(abs(rest)[:, None] * size, axis=0)) / pivot
        return (X + here[:, None] * x[None, :], size + here[:, None] * most[None, :]), None

    start = jnp.zeros_like(value), jnp.zeros_like(terms)
    (X, size), _ = lax.scan(substituted, start, (one, R, value, terms), reverse=True)
    return X, lax.stop_gradient(size)


def _row_by_row(R: Array, value: Array, terms: Array) -> tuple[Array, Array]:
    x, size = list(value), list(terms)
    for i in reversed(range(len(x))):
        for j in range(i + 1, len(x)):
            x[i] = x[i] - R[i, j] * x[j]
            size[i] = size[i] + abs(R[i, j]) * size[j]
        x[i], size[i] = x[i] / R[i, i], size[i] / R[i, i]
    return jnp.stack(x), lax.stop_gradient(jnp.stack(size))


def _on_scalars(N: Array, T: Array) -> tuple[Array, Array]:
    """X and the sum of the absolute values of the terms it is made of, on scalars."""
    E, R = triangularise(columns(N))
    inverse = [shield(1 / R[i][i]) for i in range(len(R))]
    absolute = [[lax.abs(x) for x in e] for e in E]
    solved = [_substituted(R, inverse, E, absolute, t) for t in columns(T)]
    X, noise = ([[col[part][i] for col in solved] for i in range(len(R))] for part in (0, 1))
    return from_rows(X), lax.stop_gradient(from_rows(noise))


def _substituted(R, inverse, E, absolute, t):
    """Back substitution of E^T t, and of the absolute values beside it."""
    m = len(R)
    x, size = list(inverse), list(inverse)
    for i in reversed(range(m)):
        value = inner(E[i], t)
        terms = inner(absolute[i], [lax.abs(t_k) for t_k in t])
        for j in range(i + 1, m):
            value = value - R[i][j] * x[j]
            terms = terms + lax.abs(R[i][j]) * size[j]
        x[i], size[i] = value * inverse[i], terms * inverse[i]
    return x, size


def masked_coupling(N: Array, T: Array, closed: Array, signs: Array) -> Array:
    """(m, m) X S of the closed contacts, zero rows and columns for the open ones."""
    m = N.shape[1]
    N = jnp.concatenate([N * closed[None, :], jnp.eye(m, dtype=N.dtype) * (1 - closed)[None, :]])
    T = jnp.concatenate([T * (signs * closed)[None, :], jnp.zeros((m, T.shape[1]), T.dtype)])
    return coupling(N, T)
