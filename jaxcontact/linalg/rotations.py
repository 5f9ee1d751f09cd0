"""Extreme singular triples of matrices with four columns, by plane rotations of a symmetric 4 by 4 matrix.

The largest value is the root of the largest eigenvalue of the Gram matrix, where nothing cancels. The smallest is one
over the largest value of R^-1, X = E R with orthonormal E: the inverse of a triangular matrix is right to roundings
times the condition, which is all that the entries of X determine. A third of the operations of one-sided rotations, and
so short a program that a bound of four contacts stays one vectorised loop. The vectors are not carried through the
rotations: two steps of inverse iteration at the value are a sixth of their length. Input: a list of 4 columns, each a
list of n >= 4 scalars of moderate size (the caller scales them).
"""

import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.orthogonal import Column, normalised, triangular, turned_back, zeros
from jaxcontact.linalg.unrolled import Scalar, inner, largest, milestone, power_of_two_scale, shield, total

Rows = list[list[Scalar]]
Triple = tuple[Column, Scalar, Column]

COLUMNS = 4
"""The number of columns treated here; more rotations than these make too long a program."""

SWEEPS = {4: 4, 8: 5}
"""By bytes of the dtype: sweeps over the six pairs after which what is left off the diagonal is rounding."""

PAIRS = ((0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2))
"""Two disjoint pairs at a time."""

ABOVE = 16
"""The shift of inverse iteration is this many roundings above the eigenvalue, which is right to fewer."""


def max_value(cols: list[Column]) -> Scalar:
    """sigma_max."""
    return lax.sqrt(top_value(_gram(cols)))


def max_triple(cols: list[Column]) -> Triple:
    """(u, sigma, v); for the zero matrix the first axis on both sides."""
    S = _gram(cols)
    value = top_value(S)
    v = top_vector(S, value)
    image = [total([v_j * x for v_j, x in zip(v, row, strict=True)]) for row in zip(*cols, strict=True)]
    return normalised(image, [jnp.ones_like(image[0]), *zeros(image[1:])]), lax.sqrt(value), v


def min_value(cols: list[Column]) -> Scalar:
    """sigma_min; 0 where a column depends on the earlier ones to the last digit."""
    return _smallest(triangular(cols)[0])[0]


def min_triple(cols: list[Column]) -> Triple:
    """(u, sigma, v); where a column depends on the earlier ones, sigma = 0 with null vectors on both sides."""
    R, reflections = triangular(cols)
    sigma, Z, value = _smallest(R)
    # Z is a multiple of R^-1: Z Z^T v = value v has the v of R v = sigma u, and Z^T v is along u.
    v = top_vector(_gram(Z), value)
    u = [total([Z[i][j] * v[i] for i in range(j + 1)]) for j in range(len(Z))]
    u = normalised(u, u)
    return turned_back(reflections, u + zeros(cols[0][len(u) :])), sigma, v


def _smallest(R: Rows) -> tuple[Scalar, Rows, Scalar]:
    """(sigma_min of R, Z = s R^-1 for a power of two s, the largest eigenvalue of Z Z^T)."""
    R, missing = _filled(R)
    Z, scale = _scaled_inverse(R)
    value = top_value(_gram(Z))
    return jnp.where(missing, 0, shield(scale / lax.sqrt(value))), Z, value


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
    return milestone(largest([S[i][i] for i in range(m)]))


def top_vector(S: Rows, value: Scalar) -> Column:
    """A unit eigenvector for the largest eigenvalue `value` of S; one of the eigenspace where it is repeated.

    Column k of B^2, B the inverse of (value + shift) - S, definite. At least one diagonal entry of B is a quarter of
    its norm: that k starts the iteration well, whatever S is, and the second step leaves a residual of the shift.
    """
    m = len(S)
    size = jnp.where(value == 0, 1, value)
    eps = float(jnp.finfo(size.dtype).eps)
    shifted = value + ABOVE * eps * size
    A = [[shifted - S[i][j] if i == j else -S[i][j] for j in range(m)] for i in range(m)]
    B = _inverse_of_definite(A, eps * size)
    best, column = B[0][0], B[0]
    for i in range(1, m):
        more = B[i][i] > best
        best, column = lax.max(best, B[i][i]), [jnp.where(more, x, y) for x, y in zip(B[i], column, strict=True)]
    x = [inner(row, column) for row in B]
    return normalised(x, x)


def _inverse_of_definite(A: Rows, least: Scalar) -> Rows:
    """A^-1 for a symmetric A > 0 by A = L D L^T, whose pivots are kept from falling below `least`."""
    m = len(A)
    A = [list(row) for row in A]
    inverse_pivots = []
    for j in range(m):
        inverse_pivots.append(shield(1 / lax.max(A[j][j], least)))
        for i in range(j + 1, m):
            factor = A[i][j] * inverse_pivots[j]
            for k in range(j + 1, i + 1):
                A[i][k] = A[i][k] - factor * A[k][j]
    L = [[A[i][j] * inverse_pivots[j] for j in range(i)] for i in range(m)]
    K: list[dict[int, Scalar]] = []  # L^-1 without its ones
    for i in range(m):
        K.append({j: -total([L[i][j], *(L[i][k] * K[k][j] for k in range(j + 1, i))]) for j in range(i)})

    def entry(i, j):
        terms = [K[k][i] * K[k][j] * inverse_pivots[k] for k in range(j + 1, m)]
        return total([inverse_pivots[j] if i == j else K[j][i] * inverse_pivots[j], *terms])

    upper = {(i, j): entry(i, j) for i in range(m) for j in range(i, m)}
    return [[upper[min(i, j), max(i, j)] for j in range(m)] for i in range(m)]


def _rotation(a: Scalar, b: Scalar, d: Scalar) -> tuple[Scalar, Scalar]:
    """(cos, tan) of the smaller angle that diagonalises [[a, b], [b, d]].

    The diagonal becomes a - t b, d + t b (Rutishauser, Numer. Math. 9 (1966) 1-10).
    """
    x, y = d - a, 2 * b
    bottom = lax.abs(x) + lax.sqrt(x * x + y * y)
    t = shield(jnp.where(x < 0, -y, y) / jnp.where(bottom == 0, 1, bottom))
    return shield(lax.rsqrt(1 + t * t)), t


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
