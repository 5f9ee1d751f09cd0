"""The sign-real spectral radius of a matrix: the largest real eigenvalue of X S over all signatures S.

Rump, "Theorems of Perron-Frobenius type for matrices without sign restrictions", Linear Algebra Appl. 266 (1997) 1-42.
1 / radius is the largest r such that I - r X D is regular for every diagonal |D| <= 1, which is how friction enters.

The set of r for which every vertex determinant det(I - r X S) is positive is an interval from 0, since the box of D
only grows. So the radius is the one sign change of the smallest vertex determinant, found by a bracketing root
finder: no eigenvalue has to be told real from nearly real, no other eigenvalue matters, and the same program runs on
any device. The determinants of all vertices share their eliminations: 2 + 4 + ... + 2^k pivots.
"""

import itertools
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..linalg.unrolled import entries, total
from .root import sign_change

UNROLLED_LEVELS = 3
"""The last eliminations are written out branch by branch; those before double an array axis."""

MINORS_LIMIT = 4
"""Up to this order the determinants are those of the principal minors, expanded; beyond, eliminations cost less."""

BALANCING_SWEEPS = 6
"""Sweeps of the diagonal scaling that leaves the radius as it is and brings the bracket closer."""


class Box(NamedTuple):
    """The two ends of each diagonal entry of D: (1, -1), or (xi, 0) where friction has one known direction."""

    first: Array
    second: Array


def radius_of_two(X: Array) -> Array:
    """The sign-real spectral radius of X (1, 1) or (2, 2), in closed form with derivatives.

    For [[a, b], [c, d]]: (|a + d'| + sqrt((a - d')^2 + 4 |b c|)) / 2 with d' = d if b c >= 0 else -d: the scaling that
    balances |b| = |c| makes X S symmetric for one S. Where the root vanishes (two equal contacts that do not feel each
    other) the derivative is the mean of the two one-sided ones.

    `radius_of_two(jnp.array([[0.0, 2.0], [2.0, 0.0]]))` is 2.
    """
    if X.shape[0] == 1:
        return lax.abs(X[0, 0])
    a, b, c, d = X[0, 0], X[0, 1], X[1, 0], X[1, 1]
    # b and c separately, since their product may underflow, and the sign by their signs.
    alike = ~((jnp.sign(b) * jnp.sign(c)) < 0)
    d = jnp.where(alike, d, -d)
    square = (a - d) * (a - d) + 4 * lax.abs(b * c)
    apart = square > 0
    root = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1)), 0 * square)
    return 0.5 * (lax.abs(a + d) + root)


def balanced(X: Array) -> Array:
    """D^-1 X D with the row and the column of each index of like size; exact for the radius, and differentiable.

    All indices at once by the fourth root of row over column: half of Osborne's step, which one index alone would take.
    """
    k = X.shape[0]
    off = lax.stop_gradient(abs(X)) * (1 - jnp.eye(k, dtype=X.dtype))

    def swept(_, scale):
        now = off * scale[None, :] / scale[:, None]
        row, column = jnp.sum(now, axis=1), jnp.sum(now, axis=0)
        useful = (row > 0) & (column > 0) & (row < jnp.inf) & (column < jnp.inf)
        step = jnp.where(useful, row, 1) / jnp.where(useful, column, 1)
        return scale * jnp.sqrt(jnp.sqrt(step))

    scale = lax.fori_loop(0, BALANCING_SWEEPS, swept, jnp.ones(k, X.dtype))
    return X * scale[None, :] / scale[:, None]


def radius_in_box(X: Array, box: Box) -> tuple[Array, Array]:
    """(largest lambda > 0 with det(lambda - X D) = 0 for a D in the box, the vertex D (k,) where it is); no derivative.

    0, with an arbitrary vertex, if there is none. For |D| <= 1 this is the sign-real spectral radius.
    """
    X = lax.stop_gradient(X)
    size = linalg.least(jnp.stack([linalg.greatest(jnp.sum(abs(X), axis=axis)) for axis in (0, 1)]))
    usable = (size > 0) & (size < jnp.inf)
    X = jnp.where(usable, X, 0) / jnp.where(usable, size, 1)
    low = jnp.maximum(linalg.greatest(jnp.maximum(jnp.diag(X) * box.first, jnp.diag(X) * box.second)), 0)
    eps = float(jnp.finfo(X.dtype).eps)
    # Without a diagonal entry to start from, what is below rounding of the norm is nothing.
    floor = jnp.where(low > 0, 0, eps).astype(X.dtype)
    # Both ends are moved out by a few roundings, so that the sign change lies between them.
    ends = low * (1 - 4 * eps), jnp.ones_like(low) * (1 + 4 * eps)

    minors = _principal_minors(X) if len(X) <= MINORS_LIMIT else None

    def smallest(value):
        if minors is not None:
            # One number behind a wall: the bracket has ten results, each of which would repeat all determinants.
            packed = linalg.walled(_least_packed)(minors, value, box)
            return jnp.real(packed), jnp.imag(packed).astype(jnp.int32)
        every = _determinants(X, value, box)
        return linalg.least(every), jnp.argmin(every)

    value, place = sign_change(smallest, *ends, floor)
    vertex = _vertices(box, UNROLLED_LEVELS if minors is None else len(X))[place]
    value = jnp.where(value <= 4 * floor, 0, value) * size
    return jnp.where(usable, value, size), vertex


def _principal_minors(X: Array) -> list[Array]:
    """The 2^k principal minors of X (k, k); bit i from the left says whether index i is in.

    Not compensated: a rounding of X moves them as much, and the eigenvalue found is refined at its vertex.
    """
    rows, known = entries(X), {}

    def minor(rows_in, columns_in):
        """Expanded along its first row, the minors of the others computed once."""
        if not rows_in:
            return jnp.ones((), X.dtype)
        if (rows_in, columns_in) not in known:
            terms = [
                (-1) ** c * rows[rows_in[0]][j] * minor(rows_in[1:], columns_in[:c] + columns_in[c + 1 :])
                for c, j in enumerate(columns_in)
            ]
            known[rows_in, columns_in] = total(terms)
        return known[rows_in, columns_in]

    sets = [itertools.compress(range(len(X)), bits) for bits in itertools.product((0, 1), repeat=len(X))]
    return [minor(members, members) for members in map(tuple, sets)]


def _expanded(minors: list[Array], value: Array, box: Box) -> list[Array]:
    """det(value - X D) at the 2^k vertices, the first index slowest: affine in each D_i, one index after the other."""
    found = [minors]
    for ends in zip(*box, strict=True):
        halves = [(part[: len(part) // 2], part[len(part) // 2 :]) for part in found]
        found = [[value * x - end * y for x, y in zip(*both, strict=True)] for both in halves for end in ends]
    return [part[0] for part in found]


def _least_packed(minors: list[Array], value: Array, box: Box) -> Array:
    """The smallest determinant, NaN if one is, and the number of its vertex, as real and imaginary part."""
    numbers = _expanded(minors, value, box)
    best, place = numbers[0], jnp.zeros_like(value)
    for i, x in enumerate(numbers[1:], 1):
        place = jnp.where(x < best, i, place)
        best = lax.min(best, x)
    return linalg.as_one([best, place])


def _determinants(X: Array, value: Array, box: Box) -> Array:
    """det(value - X D) at the 2^k vertices, ordered as `_vertices`.

    Eliminating the first index of value - X D with D_1 = s leaves value - X' D', where X' = X + s X_i1 X_1j / pivot and
    pivot = value - s X_11: the remaining signs stay undecided. Above the root all pivots are positive; below it some
    determinant is negative.
    """
    rows = [[x[None] for x in row] for row in entries(X)]
    found = jnp.ones((1,), X.dtype)
    level = 0
    while len(rows) > UNROLLED_LEVELS:
        branches = [_eliminated(rows, found, value, side[level]) for side in box]
        rows = [[jnp.concatenate(pair) for pair in zip(*both)] for both in zip(*(b[0] for b in branches))]
        found = jnp.concatenate([b[1] for b in branches])
        level += 1
    leaves = [(rows, found)]
    while leaves[0][0]:
        leaves = [_eliminated(rows, found, value, side[level]) for rows, found in leaves for side in box]
        level += 1
    return jnp.concatenate([found for _, found in leaves])


def _eliminated(rows, found, value, s):
    pivot = value - s * rows[0][0]
    safe = jnp.where(pivot == 0, jnp.finfo(pivot.dtype).eps * value, pivot)
    share = s / safe
    rest = [[row[j] + (row[0] * share) * rows[0][j] for j in range(1, len(rows))] for row in rows[1:]]
    return rest, found * pivot


def _vertices(box: Box, unrolled: int) -> Array:
    """(2^k, k) vertices in the order of `_determinants`: doubled axes first (fastest), then branch by branch."""
    k = box.first.shape[0]
    doubled = max(k - unrolled, 0)
    table = []
    for leaf in range(2**k):
        branch, lane = divmod(leaf, 2**doubled)
        sides = [lane >> level & 1 for level in range(doubled)]
        sides += [branch >> (k - 1 - level) & 1 for level in range(doubled, k)]
        table.append(sides)
    sides = jnp.array(table, bool).reshape(2**k, k)
    return jnp.where(sides, box.second[None, :], box.first[None, :])
