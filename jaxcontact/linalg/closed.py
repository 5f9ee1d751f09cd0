"""Extreme singular triples of matrices with one, two or three columns, in closed form.

The smallest value is the volume of the columns over the product of the other values, which is the largest value of the
matrix of cofactors. Only the volume and the minors cancel, and they are computed in compensated arithmetic: relative
errors of a few roundings for square matrices, of roundings times the condition for tall ones, which are made
triangular first. Input: a list of m columns, each a list of n >= m scalars of moderate size (the caller scales them).
"""

import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.compensated import cofactor_pairs3, det2, dot_pairs
from jaxcontact.linalg.orthogonal import Column, completed, normalised, triangularise, unit_normal, zeros
from jaxcontact.linalg.symmetric_small import top_value, top_vector
from jaxcontact.linalg.tracing import where
from jaxcontact.linalg.unrolled import Scalar, inner, largest, power_of_two_scale, total

Triple = tuple[Column, Scalar, Column]

CLOSED_LIMIT = 3
"""Largest number of columns treated here."""


def max_value(cols: list[Column]) -> Scalar:
    """sigma_max, the root of the largest eigenvalue of the Gram matrix: nothing cancels there."""
    return lax.sqrt(top_value(_gram(cols)))


def max_triple(cols: list[Column]) -> Triple:
    """(u, sigma, v); for the zero matrix the first axis on both sides."""
    v = top_vector(_gram(cols))
    image = _apply(cols, v)
    return normalised(image, _axis(image)), max_value(cols), v


def min_value(cols: list[Column]) -> Scalar:
    """sigma_min, the volume over the largest value of the cofactors; 0 where the columns are dependent."""
    if len(cols) == 1:
        return max_value(cols)
    E, R = _square(cols)
    if len(cols) == 3:
        return _min_value3(*_cofactors(R))
    volume = lax.abs(det2(*R[0], *R[1])) if E is None else R[0][0] * R[1][1]
    return _quotient(volume, max_value(cols))


def min_triple(cols: list[Column]) -> Triple:
    """(u, sigma, v): the top triple of the cofactors; where they vanish, null vectors on both sides."""
    if len(cols) == 1:
        return max_triple(cols)
    E, R = _square(cols)
    u, sigma, v = _min_triple2(R) if len(cols) == 2 else _min_triple3(R)
    if E is not None:
        u = _apply(completed(E, [R[i][i] != 0 for i in range(len(R))]), u)
    return u, sigma, v


def _min_triple2(R: list[Column]) -> Triple:
    """A quarter turn from the top vectors on both sides, one of them reversed where the determinant is negative."""
    u, top, v = max_triple(_transposed(R))
    volume = det2(*R[0], *R[1])
    sign = where(volume < 0, -1, 1).astype(volume.dtype)
    return [-sign * u[1], sign * u[0]], _quotient(lax.abs(volume), top), [-v[1], v[0]]


def _min_value3(C: list[Column], det: Scalar, scale: Scalar) -> Scalar:
    return _quotient(lax.abs(det), scale * max_value(C))


def _min_triple3(R: list[Column]) -> Triple:
    C, det, scale = _cofactors(R)
    u, _, v = max_triple(C)
    sign = where(det < 0, -1, 1).astype(det.dtype)
    # Rank one or zero: all cofactors vanish; vectors normal to any non-zero row and to any non-zero column will do.
    rank_two = largest([lax.abs(c) for col in C for c in col]) > 0
    v_null = unit_normal([normalised(_longest(R), zeros(v))], v)
    u_null = unit_normal([normalised(_longest(_transposed(R)), zeros(u))], u)
    u = [where(rank_two, sign * x, y) for x, y in zip(u, u_null)]
    v = [where(rank_two, x, y) for x, y in zip(v, v_null)]
    return u, _min_value3(C, det, scale), v


def _longest(lines: list[Column]) -> Column:
    """The line of largest length."""
    best = lines[0]
    for line in lines[1:]:
        longer = inner(line, line) > inner(best, best)
        best = [where(longer, x, y) for x, y in zip(line, best, strict=True)]
    return best


def _square(cols: list[Column]) -> tuple[list[Column] | None, list[Column]]:
    """(E, R) with columns E R and R square, by rows; E is None where the matrix is square already."""
    if len(cols[0]) == len(cols):
        return None, _transposed(cols)
    return triangularise(cols)


def _cofactors(R: list[Column]) -> tuple[list[Column], Scalar, Scalar]:
    """(columns of the cofactors over a power of two, determinant, that power) of a 3 by 3 matrix by rows."""
    pairs = cofactor_pairs3(R)
    det = dot_pairs(R[0], pairs[0])
    C = [[high + low for high, low in row] for row in pairs]
    scale, inverse = power_of_two_scale(largest([lax.abs(c) for row in C for c in row]))
    return [[C[i][j] * inverse for i in range(3)] for j in range(3)], det, scale


def _gram(cols: list[Column]) -> list[list[Scalar]]:
    return [[inner(a, b) for b in cols] for a in cols]


def _apply(cols: list[Column], v: Column) -> Column:
    return [total([v_j * col[i] for v_j, col in zip(v, cols, strict=True)]) for i in range(len(cols[0]))]


def _transposed(lines: list[Column]) -> list[Column]:
    return [list(line) for line in zip(*lines, strict=True)]


def _axis(x: Column) -> Column:
    return [jnp.ones_like(x[0]), *zeros(x[1:])]


def _quotient(a: Scalar, b: Scalar) -> Scalar:
    """a / b, and 0 where both vanish."""
    return a / where(b == 0, 1, b)
