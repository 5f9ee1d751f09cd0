"""Largest eigenvalue of a symmetric 2 by 2 or 3 by 3 matrix in closed form, with its vector."""

import math

import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.tracing import where
from jaxcontact.linalg.unrolled import Scalar, inner, shield, total

SymmetricRows = list[list[Scalar]]

NEWTON_STEPS = {4: 2, 8: 3}
"""Steps, by bytes of the dtype, from a start right to 2e-3 to full precision; each squares the error."""


def top_value(S: SymmetricRows) -> Scalar:
    """The largest eigenvalue of the nested list S, 1 <= m <= 3."""
    if len(S) == 1:
        return S[0][0]
    if len(S) == 2:
        mean, radius, _ = _circle(S[0][0], S[0][1], S[1][1])
        return mean + radius
    return _top3(S)[0]


def top_vector(S: SymmetricRows) -> list[Scalar]:
    """A unit eigenvector of the largest eigenvalue of S; any of the eigenspace where it is repeated."""
    if len(S) == 1:
        return [jnp.ones_like(S[0][0])]
    if len(S) == 2:
        _, radius, half = _circle(S[0][0], S[0][1], S[1][1])
        return list(_half_angle(half, S[0][1], radius))
    return _top3(S)[1]


def _circle(a: Scalar, b: Scalar, d: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Mohr's circle of [[a, b], [b, d]]: (centre, radius, (a - d) / 2); the eigenvalues are centre +- radius."""
    half = (a - d) * 0.5
    return (a + d) * 0.5, shield(lax.sqrt(half * half + b * b)), half


def _half_angle(x: Scalar, y: Scalar, radius: Scalar) -> tuple[Scalar, Scalar]:
    """(cos, sin) of half the angle of the point (x, y) on the circle of this radius; (1, 0) at the origin.

    The larger of the two is computed by the half-angle formula, the other from sin(2 a) = y / radius: nothing cancels.
    """
    point = radius == 0
    inverse = shield(1 / where(point, 1, radius))
    large = shield(lax.sqrt(where(point, 1, 0.5 + 0.5 * lax.abs(x) * inverse)))
    small = shield(0.5 * y * inverse / large)
    right = x >= 0
    # On the left the sine is the larger; both change sign together with y, which leaves the axis the same.
    return where(right, large, small), where(right, small, large)


def _top3(S: SymmetricRows) -> tuple[Scalar, list[Scalar]]:
    """The well separated eigenvalue in closed form, the other two as a 2 by 2 problem in the plane normal to it.

    With B = S - (trace / 3) 1 and p^2 = |B|^2 / 6 the eigenvalues of B are 2 p cos(phi + 2 pi k / 3), cos(3 phi) =
    det(B) / (2 p^3) (O. K. Smith, Commun. ACM 4 (1961) 168). For det >= 0 the top one is at least sqrt(3) p away from
    both others, for det < 0 the bottom one: it and its vector are right to rounding, which the other two, possibly
    close together, are not until deflation.
    """
    centre = (S[0][0] + S[1][1] + S[2][2]) * (1 / 3)
    b = [S[i][i] - centre for i in range(3)]
    off = [S[1][2], S[0][2], S[0][1]]
    p = shield(lax.sqrt((inner(b, b) + 2 * inner(off, off)) * (1 / 6)))
    isotropic = p == 0
    inverse = shield(1 / where(isotropic, 1, p))
    # From here on B / p, of Frobenius norm sqrt(6), and its negative where the bottom eigenvalue is the separated one.
    b, off = [x * inverse for x in b], [x * inverse for x in off]
    half_det = 0.5 * (b[0] * (b[1] * b[2] - off[0] * off[0]) - off[2] * (off[2] * b[2] - off[0] * off[1]))
    half_det = half_det + 0.5 * off[1] * (off[2] * off[0] - b[1] * off[1])
    top_is_separated = half_det >= 0
    sign = where(top_is_separated, 1, -1).astype(p.dtype)
    separated = 2 * _third_of_angle(lax.abs(half_det))
    w = _null_vector([sign * x - separated for x in b], [sign * x for x in off])
    y, z = _plane_normal_to(w)
    a, c, d = _form(b, off, y, y), _form(b, off, y, z), _form(b, off, z, z)
    mean, radius, half = _circle(a, c, d)
    cosine, sine = _half_angle(half, c, radius)
    in_plane = [cosine * y_i + sine * z_i for y_i, z_i in zip(y, z)]
    value = where(top_is_separated, separated, mean + radius)
    vector = [where(top_is_separated, w_i, x) for w_i, x in zip(w, in_plane)]
    return centre + p * value, vector


def _third_of_angle(cos3: Scalar) -> Scalar:
    """cos(acos(x) / 3) for 0 <= x <= 1: the root in [sqrt(3)/2, 1] of 4 c^3 - 3 c = x, by Newton's method.

    The start interpolates: value and slope 1 / 6 at x = 0, value 1 at x = 1.
    """
    x = lax.min(cos3, jnp.ones_like(cos3))
    bottom = math.sqrt(3) / 2
    c = bottom + x * (1 / 6 - (bottom + 1 / 6 - 1) * x)
    for _ in range(NEWTON_STEPS[jnp.dtype(x.dtype).itemsize]):
        square = c * c
        c = shield(c - (c * (4 * square - 3) - x) / (12 * square - 3))
    return c


def _null_vector(b: list[Scalar], off: list[Scalar]) -> list[Scalar]:
    """The unit null vector of a symmetric rank two matrix (diagonal b, off-diagonal entries 23, 13, 12).

    Its matrix of cofactors is a multiple of v v^T: the column with the largest diagonal entry is taken.
    """
    f, g, h = off
    c00, c11, c22 = b[1] * b[2] - f * f, b[0] * b[2] - g * g, b[0] * b[1] - h * h
    c01, c02, c12 = f * g - h * b[2], h * f - b[1] * g, g * h - b[0] * f
    size0, size1, size2 = lax.abs(c00), lax.abs(c11), lax.abs(c22)
    use1 = size1 > size0
    x = [where(use1, s, r) for r, s in zip([c00, c01, c02], [c01, c11, c12])]
    use2 = size2 > lax.max(size0, size1)
    x = [where(use2, t, r) for r, t in zip(x, [c02, c12, c22])]
    square = inner(x, x)
    scale = shield(lax.rsqrt(where(square == 0, 1, square)))
    x = [x_i * scale for x_i in x]
    return [where(square == 0, 1, x[0]), x[1], x[2]]


def _plane_normal_to(w: list[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
    """Two unit vectors normal to the unit vector w and each other (Duff et al., JCGT 6 (2017) 1-8)."""
    sign = where(w[2] >= 0, 1, -1).astype(w[2].dtype)
    a = shield(-1 / (sign + w[2]))
    b = w[0] * w[1] * a
    return [1 + sign * w[0] * w[0] * a, sign * b, -sign * w[0]], [b, sign + w[1] * w[1] * a, -w[1]]


def _form(b: list[Scalar], off: list[Scalar], y: list[Scalar], z: list[Scalar]) -> Scalar:
    """y^T B z for the symmetric B with diagonal b and off-diagonal entries 23, 13, 12."""
    f, g, h = off
    Bz = [b[0] * z[0] + h * z[1] + g * z[2], h * z[0] + b[1] * z[1] + f * z[2], g * z[0] + f * z[1] + b[2] * z[2]]
    return total([y_i * x for y_i, x in zip(y, Bz)])
