"""Powers of two, exactly: scaling by them changes no digit of a problem.

D M D and D q with D_i about 1/sqrt(M_ii) make every contact's own stiffness about one, whatever the units and masses;
then one power of two each brings matrix and vector to a size about one. All factors are built from exponent bits, so
that a solve of M 2^a, q 2^b or D M D, D q runs through the same numbers bit by bit.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact import linalg
from jaxcontact.complementarity.short import first, greatest, largest_of_rows, seldom

EXPONENT_MARGIN = 2
"""Exponents stay this far from the ends of the format, where subnormal numbers lose digits."""


class Scaled(NamedTuple):
    """M and q of about unit size, and the exponents that lead back."""

    M: jax.Array
    q: jax.Array
    rows: jax.Array
    """(m,) int: M_scaled = 2^(rows_i + rows_j - size_M) M, q_scaled = 2^(rows_i - size_q) q."""
    size_M: jax.Array
    size_q: jax.Array

    def unscale(self, z):
        """z of the caller from z of the scaled problem."""
        return times_power_of_two(z, self.rows + self.size_q - self.size_M)

    def rescale(self, z):
        """z of the scaled problem from z of the caller."""
        return times_power_of_two(z, self.size_M - self.size_q - self.rows)


def scaled(M, q):
    """Scale LCP data (m, m), (m,), m >= 1, by powers of two. Zero rows and non-positive diagonals fall back on the
    largest entries of row and column (numerics of Lemke's method).

    >>> scaled(jnp.diag(jnp.array([4.0, 1.0])), jnp.array([-2.0, -1.0])).rows     # -1, 0
    """
    rows = row_exponents(M)
    both = rows[:, None] + rows[None, :]
    size_M, size_q = _largest_exponent(M, both), _largest_exponent(q, rows)
    return Scaled(times_power_of_two(M, both - size_M), times_power_of_two(q, rows - size_q), rows, size_M, size_q)


def _largest_exponent(x, shift):
    """int: exponent of the largest |x| 2^shift, found without forming numbers that might overflow; 0 if x is 0."""
    usable = (x != 0) & lax.is_finite(x)
    least = jnp.iinfo(shift.dtype).min
    largest = greatest(linalg.where(usable, exponent(x) + shift, least), least)
    return linalg.where(largest == least, 0, largest)


@jax.jit  # traced once for all who ask
def row_exponents(M):
    """(m,) int e with 2^e about 1/sqrt(M_ii): 2^e_i M_ij 2^e_j has a diagonal in [1/2, 4). Where M_ii <= 0 the
    largest entries of row and column stand in: those that couple to rows with M_ii > 0, in their units, if there are
    any. The parity of the first such row goes into every row, so that M 2^a moves all e alike for odd a too."""
    diagonal = linalg.diagonal(M)
    if len(M) == 0:
        return exponent(diagonal)
    sizes = exponent(diagonal)
    found = -((sizes - (sizes[0] & 1)) >> 1)
    return seldom(~lax.reduce_and(diagonal > 0, (0,)), _row_exponents_without_diagonal, found, M)


def _row_exponents_without_diagonal(M):
    """`row_exponents` where M_ii <= 0 for some i."""
    diagonal = linalg.diagonal(M)
    own = diagonal > 0
    across, down = largest_of_rows(M), largest_of_rows(M.T)
    sizes = linalg.where(own, exponent(diagonal), _one_or_both(across, down) >> 1)
    leader = linalg.where(lax.reduce_or(own, (0,)), first(own), np.arange(len(M)) == 0)
    odd = lax.reduce_sum(linalg.where(leader, sizes & 1, 0), (0,))
    found = -((sizes - odd) >> 1)
    unit = linalg.where(own, power_of_two(found, M.dtype), 0)
    across, down = largest_of_rows(M * unit[None, :]), largest_of_rows((M * unit[:, None]).T)
    coupled = -((_one_or_both(across, down) - 2 * odd) >> 1)
    return linalg.where(~own & ((across > 0) | (down > 0)), coupled, found)


def _one_or_both(across, down):
    """The sum of two exponents, or twice one of them where the other belongs to zero."""
    across, down = linalg.where(across > 0, across, down), linalg.where(down > 0, down, across)
    return exponent(across) + exponent(down)


@partial(jax.jit, inline=True)  # traced once for all of a shape
def exponent(x):
    """(…) int e with 2^(e-1) <= |x| < 2^e; 0 at zero, at NaN and at infinity.

    >>> exponent(jnp.array([1.0, 0.75, 8.0]))     # 1, 0, 4
    """
    bits, integer, bias = _layout(x.dtype)
    word = lax.bitcast_convert_type(x, integer)
    field = lax.shift_right_arithmetic(word, lax.full_like(word, bits))
    field = lax.bitwise_and(field, lax.full_like(word, 2 * bias + 1))
    usable = lax.bitwise_and(lax.ne(x, lax.full_like(x, 0)), lax.is_finite(x))
    return lax.select(usable, lax.sub(field, lax.full_like(field, bias - 1)), lax.full_like(field, 0))


@partial(jax.jit, static_argnames="dtype", inline=True)
def power_of_two(k, dtype):
    """2^k exactly, k clipped to the normal numbers of the dtype."""
    bits, integer, bias = _layout(dtype)
    held = lax.clamp(np.array(EXPONENT_MARGIN - bias, k.dtype), k, np.array(bias - EXPONENT_MARGIN, k.dtype))
    field = lax.convert_element_type(lax.add(held, lax.full_like(held, bias)), integer)
    return lax.bitcast_convert_type(lax.shift_left(field, lax.full_like(field, bits)), jnp.dtype(dtype))


def times_power_of_two(x, k):
    """x 2^k in two steps, so that only the product can overflow and not the factor."""
    half = k >> 1
    return x * power_of_two(half, x.dtype) * power_of_two(k - half, x.dtype)


def _layout(dtype):
    """Bits of the fraction, integer of the same width, exponent bias of an IEEE format."""
    information = jnp.finfo(dtype)
    integer = jnp.int64 if information.bits == 64 else jnp.int32
    return information.nmant, integer, information.maxexp - 1
