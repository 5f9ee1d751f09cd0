"""One or two complementary pairs in horizontal form, P z - N w + q = 0, in closed form: every vertex of every mode.

The two columns of a mode, P_j or -N_j for each pair, must combine to -q with coefficients y >= 0. The solutions of a
mode form a polyhedron without lines, hence with a vertex: both columns if they are independent, else one of them, or
none. Everything on scalars, so that a batch is one fused loop.
"""

from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.complementarity.inverse import PIVOT_FLOOR, balanced
from jaxcontact.complementarity.scaling import exponent, power_of_two
from jaxcontact.linalg import as_one, det2, from_one, fused, walled, where


class Pairs(NamedTuple):
    """The best candidate, and what is known if it is no solution."""

    z: jax.Array
    """(m,) >= 0"""
    w: jax.Array
    """(m,) >= 0, zero where z is not"""
    dependent: jax.Array
    """bool: no mode is regular"""
    certificate: jax.Array
    """(m,) y with y'P >= 0, y'N <= 0, y'q > 0 up to rounding if there is one"""


def best_of_pairs(P, N, q) -> Pairs:
    """`Pairs` of a horizontal problem with m <= 2.

    >>> best_of_pairs(jnp.eye(1), jnp.eye(1), -jnp.ones(1)).z     # 1
    """

    def alone(part):
        return walled(fused(lambda P, N, q: part(*_scaled(P, N, q))))(P, N, q)

    x = from_one(alone(_best))
    z, w = jnp.maximum(x, 0), jnp.maximum(-x, 0)
    return Pairs(z, w, alone(_no_regular_mode), from_one(alone(_separating)))


def _scaled(P, N, q):
    """Columns and load as scalars, in balanced units, and the units of rows and columns."""
    m = len(q)
    B, rows, scales = balanced(jnp.concatenate([P, -N], axis=1))
    load = -q * rows
    return [tuple(B[i, j] for i in range(m)) for j in range(2 * m)], [load[i] for i in range(m)], rows, scales


def _best(columns, load, rows, scales):
    """x = z - w of the candidate with the least violation, as one number."""
    zero = jnp.zeros((), load[0].dtype)
    best = [zero] * len(columns)
    least = _violation(columns, best, load)
    for taken, values, sound in _candidates(columns, load):
        candidate = [zero] * len(columns)
        for j, value in zip(taken, values, strict=True):
            candidate[j] = jnp.maximum(value, 0)
        violation = _violation(columns, candidate, load)
        better = sound & (violation < least)
        best = [where(better, new, old) for new, old in zip(candidate, best, strict=True)]
        least = where(better, violation, least)
    m = len(load)
    return as_one([best[j] * scales[j] - best[m + j] * scales[m + j] for j in range(m)])


def _no_regular_mode(columns, load, rows, scales):
    """bool: the columns of every mode are dependent."""
    return ~jnp.stack([sound for taken, _, sound in _candidates(columns, load) if len(taken) == len(load)]).any()


def _candidates(columns, load):
    """(columns taken, their coefficients, whether these are defined), all vertices but zero."""
    m = len(load)
    for j, column in enumerate(columns):
        for i in range(m):
            yield (j,), (_quotient(load[i], column[i]),), column[i] != 0
    if m == 1:
        return
    for j, k in product((0, m), (1, m + 1)):
        (a, c), (b, d) = columns[j], columns[k]
        volume = det2(a, b, c, d)
        size = jnp.maximum(jnp.maximum(lax.abs(a), lax.abs(b)), jnp.maximum(lax.abs(c), lax.abs(d)))
        regular = lax.abs(volume) > PIVOT_FLOOR * m * jnp.finfo(volume.dtype).eps * size * size
        y = _quotient(det2(load[0], b, load[1], d), volume), _quotient(det2(a, load[0], c, load[1]), volume)
        yield (j, k), y, regular


def _violation(columns, y, load):
    """The largest |sum_j y_j column_j - load|, relative to the largest sum of terms."""
    m = len(load)
    miss = [lax.abs(sum((y[j] * column[i] for j, column in enumerate(columns)), -load[i])) for i in range(m)]
    size = [sum((y[j] * lax.abs(column[i]) for j, column in enumerate(columns)), lax.abs(load[i])) for i in range(m)]
    most = _largest(size)
    return _largest(miss) / where(most > 0, most, 1)


def _separating(columns, load, rows, scales):
    """y as one number: the generator of {y : y'column >= 0 for all columns} with the lowest y'load, or zero."""
    zero = jnp.zeros((), load[0].dtype)
    best, lowest = [zero] * len(load), zero
    for y in _normals(columns, load):
        unit = power_of_two(-exponent(_largest([lax.abs(part) for part in y])), zero.dtype)
        y = [part * unit for part in y]  # no rounding: what is normal to a column stays so to the last bit
        rounding = PIVOT_FLOOR * jnp.finfo(zero.dtype).eps
        fits = [sum(a * b for a, b in zip(y, c, strict=True)) >= -rounding * _size(c) for c in columns]
        fall = sum(a * b for a, b in zip(y, load, strict=True))
        better = (fall < lowest) & jnp.stack(fits).all()
        best = [where(better, new, old) for new, old in zip(y, best, strict=True)]
        lowest = where(better, fall, lowest)
    return as_one([y * row for y, row in zip(best, rows, strict=True)])


def _normals(columns, load):
    """Candidates: the inner normals of the faces of the cone of the columns, the columns, the load reversed."""
    yield [-part for part in load]
    yield from map(list, columns)
    if len(load) == 2:
        for a, b in columns:
            yield [-b, a]
            yield [b, -a]


def _size(column):
    return sum(lax.abs(part) for part in column)


def _largest(scalars):
    return scalars[0] if len(scalars) == 1 else jnp.maximum(*scalars)


def _quotient(a, b):
    return a / where(b == 0, 1, b)
