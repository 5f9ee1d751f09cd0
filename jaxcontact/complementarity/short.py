"""Products, maxima and loops of short vectors, written so that a batch of them stays one fused loop."""

import functools

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact import linalg

SCALARS = 4
"""Vectors up to this length are handled entry by entry: one fused loop over a batch instead of many small ones."""

UNROLLED = 4
"""Loops of up to this many steps are unrolled, so that XLA fuses them over a batch; beyond, a loop compiles faster."""


def entrywise(function, size):
    """`function` as a program on scalars where the arrays are short."""
    return linalg.fused(function) if size <= SCALARS else function


def dot(A, x):
    """A @ x in the full precision of the dtype (accelerators default to less).

    Small products are sums of scalars, which XLA fuses with their surroundings.
    """
    if A.ndim == 2 and x.ndim == 1 and A.size and max(A.shape) <= SCALARS:
        return jnp.stack([sum(A[i, j] * x[j] for j in range(A.shape[1])) for i in range(A.shape[0])])
    if A.ndim == 1 and x.ndim == 2:
        return dot(x.T, A)
    return jnp.matmul(A, x, precision=lax.Precision.HIGHEST)


def largest(x):
    """max |x_i| over an array; 0 if it is empty, NaN if one entry is."""
    return greatest(jnp.abs(x), 0)


def greatest(x, initial):
    """The largest entry of an array, or `initial` if that is larger or there is none; NaN if one entry is."""
    if 0 < x.size <= SCALARS:
        return functools.reduce(jnp.maximum, [x[i] for i in np.ndindex(*x.shape)], jnp.array(initial, x.dtype))
    return linalg.greatest(x, initial=initial)


def largest_of_rows(A):
    """(n,) max_j |A_ij|; 0 where there is no column."""
    if 0 < len(A) <= SCALARS:
        return jnp.stack([largest(row) for row in A])
    return linalg.greatest(jnp.abs(A), 1, initial=0)


def diagonal_of(A):
    """(n,) A_ii, as a sum over a row with one entry left."""
    return jnp.sum(jnp.where(np.eye(len(A), dtype=bool), A, 0), axis=1)


def counted(times, advance, carry):
    """carry after `advance(i, carry)` for i = 0 ... times - 1, unrolled where that is short."""
    if times > UNROLLED:
        return lax.fori_loop(0, times, advance, carry)
    for i in range(times):
        carry = advance(i, carry)
    return carry


def first(mask):
    """(n,) bool: the first true entry of a mask, alone."""
    return mask & (jnp.cumsum(mask.astype(jnp.int32)) == 1)
