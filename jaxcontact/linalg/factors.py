"""Triangular factors and what is solved or projected with them, for one small matrix."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.linalg import solve_triangular

from jaxcontact.linalg.compensated import det2, det3
from jaxcontact.linalg.orthogonal import reciprocal_square, remove
from jaxcontact.linalg.tracing import where
from jaxcontact.linalg.unrolled import (
    UNROLL_LIMIT,
    Scalar,
    columns,
    entries,
    from_columns,
    from_rows,
    inner,
    shield,
)

ELIMINATION_LIMIT = 4
"""Largest system solved by elimination on scalars; pivoting costs m^2 selections for every column."""

DEPENDENCE = 16
"""A column counts as dependent on the earlier ones when less than this many roundings of it are left."""


@jax.jit
def cholesky(M: jax.Array) -> jax.Array:
    """Lower triangular L (n, n) with L L^T = M for symmetric positive definite M (n, n); NaN where M is not.

    Reads the lower triangle only.

    >>> cholesky(jnp.array([[4.0, 2.0], [2.0, 5.0]]))  # [[2, 0], [1, 2]]
    """
    n = M.shape[0]
    if n == 0:
        return M
    if n > UNROLL_LIMIT:
        return jnp.linalg.cholesky(M, symmetrize_input=False)
    rows, (zero, one, nan) = entries(M), np.array([0, 1, np.nan], M.dtype)
    L = [[zero] * n for _ in range(n)]
    for j in range(n):
        for i in range(j, n):
            rest = lax.sub(rows[i][j], inner(L[i][:j], L[j][:j])) if j else rows[i][j]
            if i == j:
                L[j][j] = shield(lax.sqrt(lax.select(lax.gt(rest, zero), rest, nan)))
                inverse = shield(lax.div(one, L[j][j]))
            else:
                L[i][j] = lax.mul(rest, inverse)
    return from_rows(L)


def solve_lower(L: jax.Array, B: jax.Array) -> jax.Array:
    """X with L X = B for lower triangular L (n, n) and B (n,) or (n, k)."""
    return _solve_triangular(L, B, transposed=False)


def solve_lower_transposed(L: jax.Array, B: jax.Array) -> jax.Array:
    """X with L^T X = B for lower triangular L (n, n) and B (n,) or (n, k)."""
    return _solve_triangular(L, B, transposed=True)


@partial(jax.jit, static_argnames="transposed")
def _solve_triangular(L: jax.Array, B: jax.Array, transposed: bool) -> jax.Array:
    if B.size == 0:
        return B
    if B.ndim == 1:
        return _solve_triangular(L, B[:, None], transposed)[:, 0]
    n, k = B.shape
    if max(n, k) > UNROLL_LIMIT:
        return solve_triangular(L, B, lower=True, trans=1 if transposed else 0)
    rows = entries(L)
    one = np.ones((), B.dtype)
    inverse = [shield(lax.div(one, rows[i][i])) for i in range(n)]
    solved = [_substitute(rows, inverse, b, transposed) for b in columns(B)]
    return from_columns(solved, n, B.dtype)


def _substitute(L: list[list[Scalar]], inverse: list[Scalar], b: list[Scalar], transposed: bool) -> list[Scalar]:
    """Forward substitution with L, or backward with L^T, for one right-hand side."""
    n = len(b)
    x = list(b)
    for i in reversed(range(n)) if transposed else range(n):
        done = range(i + 1, n) if transposed else range(i)
        for j in done:
            x[i] = lax.sub(x[i], lax.mul(L[j][i] if transposed else L[i][j], x[j]))
        x[i] = lax.mul(x[i], inverse[i])
    return x


@jax.jit
def gram(A: jax.Array, B: jax.Array) -> jax.Array:
    """A^T B (p, q) for A (n, p) and B (n, q), or (p,) for B (n,).

    >>> gram(jnp.eye(3), jnp.ones((3, 2))).shape  # (3, 2)
    """
    if B.ndim == 1:
        return gram(A, B[:, None])[:, 0]
    n, p = A.shape
    q = B.shape[1]
    if 0 in (n, p, q):
        return jnp.zeros((p, q), A.dtype)
    if max(n, p, q) > UNROLL_LIMIT:
        return jnp.matmul(A.T, B, precision=lax.Precision.HIGHEST)
    right = columns(B)
    return from_rows([[inner(a, b) for b in right] for a in columns(A)])


def project_out(Q_of: jax.Array, X: jax.Array) -> jax.Array:
    """X (n, m) minus its orthogonal projection on the column space of Q_of (n, k); for X (n,), of the one vector.

    With N = [N_e, N_r] the Schur complement W_rr - W_re W_ee^-1 W_er is the Gram matrix of project_out(N_e, N_r),
    which keeps the digits that forming it loses. Modified Gram-Schmidt, each projection done twice and the first time
    with its rounding errors carried; columns of Q_of that depend on the earlier ones are left out of the span.
    """
    if X.ndim == 1:
        return project_out(Q_of, X[:, None])[:, 0]
    if 0 in Q_of.shape or X.size == 0:
        return X
    if max(*Q_of.shape, X.shape[1]) > UNROLL_LIMIT:
        return _project_out_by_qr(Q_of, X)
    span, rest = columns(Q_of), columns(X)
    noise = DEPENDENCE * float(jnp.finfo(X.dtype).eps)
    limits = [inner(q, q) * (noise * noise) for q in span]
    while span:
        q, span = span[0], span[1:]
        weight = reciprocal_square(q, limits.pop(0))
        span, rest = ([remove(q, weight, x)[1] for x in cols] for cols in (span, rest))
    return from_columns(rest, X.shape[0], X.dtype)


def _project_out_by_qr(Q_of: jax.Array, X: jax.Array) -> jax.Array:
    """The library's way for large sizes: an orthonormal basis, applied twice."""
    Q = jnp.linalg.qr(Q_of)[0]
    for _ in range(2):
        X = X - jnp.matmul(Q, gram(Q, X), precision=lax.Precision.HIGHEST)
    return X


def solve(A: jax.Array, b: jax.Array) -> jax.Array:
    """x with A x = b for square A (m, m) and b (m,) or (m, k); not finite where A is singular.

    >>> solve(jnp.array([[0.0, 2.0], [1.0, 0.0]]), jnp.array([2.0, 3.0]))  # [3, 1]
    """
    if b.size == 0:
        return b
    if b.ndim == 1:
        return solve(A, b[:, None])[:, 0]
    m, k = b.shape
    if m > ELIMINATION_LIMIT or k > UNROLL_LIMIT:
        return jnp.linalg.solve(A, b)
    rows = [left + right for left, right in zip(entries(A), entries(b), strict=True)]
    inverse = []
    for j in range(m):
        rows[j:] = _largest_first(rows[j:], j)
        inverse.append(shield(1 / rows[j][j]))
        for i in range(j + 1, m):
            factor = rows[i][j] * inverse[j]
            rows[i] = rows[i][: j + 1] + [x - factor * y for x, y in zip(rows[i][j + 1 :], rows[j][j + 1 :])]
    return from_columns([_back_substitute(rows, inverse, m + c) for c in range(k)], m, b.dtype)


def _largest_first(rows: list[list[Scalar]], j: int) -> list[list[Scalar]]:
    """Partial pivoting: the rows with the one of largest |entry j| exchanged into the first place, by selections."""
    first, rest = rows[0], []
    for row in rows[1:]:
        swap = lax.abs(row[j]) > lax.abs(first[j])
        rest.append([where(swap, x, y) for x, y in zip(first, row)])
        first = [where(swap, y, x) for x, y in zip(first, row)]
    return [first, *rest]


def _back_substitute(rows: list[list[Scalar]], inverse: list[Scalar], column: int) -> list[Scalar]:
    m = len(rows)
    x: list[Scalar] = [inverse[0]] * m
    for i in reversed(range(m)):
        rest = rows[i][column]
        for j in range(i + 1, m):
            rest = rest - rows[i][j] * x[j]
        x[i] = rest * inverse[i]
    return x


def det(A: jax.Array) -> jax.Array:
    """Determinant of A (m, m), 1 for m = 0; compensated to m = 3, so that cancellation costs no digits.

    >>> det(jnp.array([[1.0, 2.0], [3.0, 4.0]]))  # -2
    """
    m = A.shape[0]
    if m == 0:
        return jnp.ones((), A.dtype)
    if m == 1:
        return A[0, 0]
    if m == 2:
        return det2(A[0, 0], A[0, 1], A[1, 0], A[1, 1])
    if m == 3:
        return det3(entries(A))
    return jnp.linalg.det(A)
