"""Extreme singular values of matrices with four columns, by plane rotations of a symmetric 4 by 4 matrix.

The largest value is the root of the largest eigenvalue of the Gram matrix, where nothing cancels. The smallest is one
over the largest value of R^-1, X = E R with orthonormal E: the inverse of a triangular matrix is right to roundings
times the condition, which is all that the entries of X determine. A third of the operations of one-sided rotations, and
so short a program that a bound of four contacts stays one vectorised loop. Input: a list of 4 columns, each a list of n
>= 4 scalars of moderate size (the caller scales them).
"""

import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.orthogonal import Column, reciprocal_square
from jaxcontact.linalg.unrolled import Scalar, inner, largest, power_of_two_scale, shield, total

Rows = list[list[Scalar]]

COLUMNS = 4
"""The number of columns treated here; more rotations than these make too long a program."""

SWEEPS = {4: 4, 8: 5}
"""By bytes of the dtype: sweeps over the six pairs after which what is left off the diagonal is rounding."""

PAIRS = ((0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2))
"""Two disjoint pairs at a time."""


def max_value(cols: list[Column]) -> Scalar:
    """sigma_max."""
    return jnp.sqrt(top_value(_gram(cols)))


def min_value(cols: list[Column]) -> Scalar:
    """sigma_min; 0 where a column depends on the earlier ones to the last digit."""
    R, missing = _filled(_triangle(cols))
    Z, scale = _scaled_inverse(R)
    return jnp.where(missing, 0, shield(scale / jnp.sqrt(top_value(_gram(Z)))))


def top_value(S: Rows) -> Scalar:
    """The largest eigenvalue of the symmetric S, 4 by 4, positive semidefinite and of moderate size."""
    m = len(S)
    S = [list(row) for row in S]
    for _ in range(SWEEPS[jnp.dtype(S[0][0].dtype).itemsize]):
        for i, j in PAIRS:
            c, t = _rotation(S[i][i], S[i][j], S[j][j])
            shift = t * S[i][j]
            S[i][i], S[j][j] = S[i][i] - shift, S[j][j] + shift
            S[i][j] = S[j][i] = jnp.zeros_like(shift)
            for k in set(range(m)) - {i, j}:
                x, y = c * (S[k][i] - t * S[k][j]), c * (S[k][j] + t * S[k][i])
                S[k][i], S[i][k], S[k][j], S[j][k] = x, x, y, y
    return largest([S[i][i] for i in range(m)])


def _rotation(a: Scalar, b: Scalar, d: Scalar) -> tuple[Scalar, Scalar]:
    """(cos, tan) of the smaller angle that diagonalises [[a, b], [b, d]].

    The diagonal becomes a - t b, d + t b (Rutishauser, Numer. Math. 9 (1966) 1-10).
    """
    x, y = d - a, 2 * b
    bottom = lax.abs(x) + jnp.sqrt(x * x + y * y)
    t = shield(jnp.where(x < 0, -y, y) / jnp.where(bottom == 0, 1, bottom))
    return shield(lax.rsqrt(1 + t * t)), t


def _triangle(cols: list[Column]) -> Rows:
    """R of X = E R by modified Gram-Schmidt, whose R is as right as that of reflections; E is not kept."""
    rest, R = list(cols), []
    for i in range(len(cols)):
        q, rest = rest[0], rest[1:]
        weight = reciprocal_square(q)
        length = shield(jnp.sqrt(inner(q, q)))
        along = [inner(q, x) * weight for x in rest]
        rest = [[x_k - t * q_k for x_k, q_k in zip(x, q, strict=True)] for x, t in zip(rest, along, strict=True)]
        R.append([jnp.zeros_like(length)] * i + [length] + [t * length for t in along])
    return R


def _filled(R: Rows) -> tuple[Rows, Scalar]:
    """(R with a rounding in place of each zero of its diagonal, whether there was one)."""
    eps = float(jnp.finfo(R[0][0].dtype).eps)
    missing = [R[i][i] == 0 for i in range(len(R))]
    filled = [[jnp.where(missing[i], eps, x) if i == j else x for j, x in enumerate(row)] for i, row in enumerate(R)]
    return filled, missing[0] | missing[1] | missing[2] | missing[3]


def _scaled_inverse(R: Rows) -> tuple[Rows, Scalar]:
    """(s R^-1, s) for an upper triangular R, s the power of two that brings the largest entry near one."""
    m = len(R)
    pivots = [shield(1 / R[i][i]) for i in range(m)]
    Z = [[jnp.zeros_like(pivots[0])] * m for _ in range(m)]
    for j in range(m):
        Z[j][j] = pivots[j]
        for i in reversed(range(j)):
            Z[i][j] = -pivots[i] * total([R[i][k] * Z[k][j] for k in range(i + 1, j + 1)])
    _, inverse = power_of_two_scale(largest([lax.abs(Z[i][j]) for j in range(m) for i in range(j + 1)]))
    return [[z * inverse for z in row] for row in Z], inverse


def _gram(cols: list[Column]) -> Rows:
    """Products of the vectors with each other, each pair computed once."""
    m = len(cols)
    upper = {(i, j): inner(cols[i], cols[j]) for i in range(m) for j in range(i, m)}
    return [[upper[min(i, j), max(i, j)] for j in range(m)] for i in range(m)]
