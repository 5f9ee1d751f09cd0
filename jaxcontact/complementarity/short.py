"""Products, maxima and loops of short vectors, written so that a batch of them stays one fused loop."""

import functools

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact import linalg
from jaxcontact.linalg.rows import row_of
from jaxcontact.linalg.unrolled import entries, in_a_row, inner

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
        scalars = in_a_row(x)
        return row_of([inner(row, scalars) for row in entries(A)])
    if A.ndim == 1 and x.ndim == 2:
        return dot(x.T, A)
    return jnp.matmul(A, x, precision=lax.Precision.HIGHEST)


def size_dot(A, x):
    """|A| |x|, the sum of the sizes of the terms of A @ x, without |A| being formed."""
    if A.size and max(A.shape) <= SCALARS:
        return dot(lax.abs(A), lax.abs(x))
    return jnp.sum(lax.abs(A) * lax.abs(x)[None, :], axis=1)


def largest(x):
    """max |x_i| over an array; 0 if it is empty, NaN if one entry is."""
    return greatest(lax.abs(x), 0)


def greatest(x, initial):
    """The largest entry of an array, or `initial` if that is larger or there is none; NaN if one entry is."""
    if 0 < x.size <= SCALARS:
        return functools.reduce(lax.max, in_a_row(x), np.array(initial, x.dtype))
    return linalg.greatest(x, initial=initial)


def largest_of_rows(A):
    """(n,) max_j |A_ij|; 0 where there is no column."""
    if A.size and max(A.shape) <= SCALARS:
        zero = np.zeros((), A.dtype)
        return row_of([functools.reduce(lax.max, row, zero) for row in entries(lax.abs(A))])
    return linalg.greatest(lax.abs(A), 1, initial=0)


def seldom(needed, function, otherwise, *arguments):
    """`function(*arguments)` where the rare `needed` holds, else `otherwise`: skipped by a batch that does not need it,
    but computed anyway where arrays are so short that a branch costs more."""
    if all(max(x.shape, default=0) <= SCALARS for x in arguments):
        return linalg.where(needed, function(*arguments), otherwise)
    return linalg.where_needed(needed, function, otherwise, *arguments)


def counted(times, advance, carry):
    """carry after `advance(i, carry)` for i = 0 ... times - 1, unrolled where that is short."""
    if times > UNROLLED:
        return lax.fori_loop(0, times, advance, carry)
    for i in range(times):
        carry = advance(i, carry)
    return carry


def first(mask):
    """(n,) bool: the first true entry of a mask, alone."""
    if len(mask) == 0:
        return mask
    if len(mask) <= SCALARS:
        alone, taken = [], None
        for here in in_a_row(mask):
            alone.append(here if taken is None else lax.bitwise_and(here, lax.bitwise_not(taken)))
            taken = here if taken is None else lax.bitwise_or(taken, here)
        return row_of(alone)
    return mask & (rows_of(mask) == first_index(mask))


def entry(A, i, axis=0):
    """A[i], or A[:, i], for a computed i inside the array; trailing axes of A beyond those of one problem go with i."""
    at = i.reshape((1,) * (A.ndim - i.ndim) + i.shape)
    return jnp.take_along_axis(A, at, axis, mode="promise_in_bounds").squeeze(axis)


def rows_of(x):
    """int32 like x: the index along the first axis."""
    return lax.broadcasted_iota(jnp.int32, x.shape, 0)


def first_index(mask):
    """int32: the first index along the first axis where the mask holds, 0 if nowhere."""
    return jnp.argmax(mask, axis=0).astype(jnp.int32)


def greatest_numbers(*arrays):
    """Of each array >= 0 the largest entry along the first axis, all in one pass. NaN may be dropped (see
    `linalg.extrema`): for choices that are checked later."""
    zeros = [jnp.zeros((), x.dtype) for x in arrays]
    return lax.reduce(arrays, tuple(zeros), lambda a, b: tuple(map(jnp.maximum, a, b)), (0,))


def least_entry(x):
    """The smallest entry along the first axis and the first index where it stands, int32; no NaN in x."""

    def smaller(a, b):
        take = (b[0] < a[0]) | ((b[0] == a[0]) & (b[1] < a[1]))
        return tuple(linalg.where(take, new, old) for new, old in zip(b, a, strict=True))

    last = jnp.array(jnp.inf, x.dtype), jnp.array(len(x), jnp.int32)
    return lax.reduce((x, rows_of(x)), last, smaller, (0,))
