"""Small matrices as nested lists of scalars, and what keeps a program on them in one fused loop.

Under jit(vmap) XLA folds the indexing and the final stack away, so algebra written on the scalars becomes one loop
over the batch, where arrays of shape (m, m) would be materialised for every lane.
"""

from functools import reduce

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact.linalg.batches import walled
from jaxcontact.linalg.rows import entries_of_row, row_of
from jaxcontact.linalg.screens import SHIELD, screen

Scalar = jax.Array

UNROLL_LIMIT = 8
"""Largest number of rows or columns that is unrolled on scalars; beyond it compile time grows faster than speed."""


def in_a_row(A: jax.Array) -> list[Scalar]:
    """All entries, row by row: of one long row, which is how matrices are put together here."""
    if not A.ndim:
        return [A]
    return entries_of_row(A if A.ndim == 1 else lax.reshape(A, (A.size,))) if A.size else []


def entries(A: jax.Array) -> list[list[Scalar]]:
    """The rows of a matrix (n, m) as lists of scalars."""
    row, m = in_a_row(A), A.shape[1]
    return [row[i * m : (i + 1) * m] for i in range(A.shape[0])]


def diagonal(A: jax.Array) -> jax.Array:
    """(n,) A_ii; of a small matrix as a sum over rows with one entry left, which fuses.

    >>> diagonal(jnp.eye(2))     # ones
    """
    if len(A) <= UNROLL_LIMIT:
        return lax.reduce_sum(lax.select(np.eye(*A.shape, dtype=bool), A, lax.full_like(A, 0)), (1,))
    return jnp.diagonal(A)


def columns(A: jax.Array) -> list[list[Scalar]]:
    """The columns of a matrix (n, m) as lists of scalars."""
    return [list(column) for column in zip(*entries(A), strict=True)] if A.shape[0] else [[]] * A.shape[1]


def from_columns(cols: list[list[Scalar]], rows: int, dtype) -> jax.Array:
    """The array (rows, len(cols)) with these columns; rows and dtype settle the empty cases."""
    if rows == 0 or not cols:
        return jnp.zeros((rows, len(cols)), dtype)
    return row_of([col[i] for i in range(rows) for col in cols]).reshape(rows, len(cols))


def from_rows(rows: list[list[Scalar]]) -> jax.Array:
    """The array with these (non-empty) rows."""
    return row_of([x for row in rows for x in row]).reshape(len(rows), -1)


def total(terms: list[Scalar]) -> Scalar:
    """Sum of a non-empty list, left to right."""
    return reduce(lax.add, terms)


def inner(a: list[Scalar], b: list[Scalar]) -> Scalar:
    """Sum of a_i b_i over non-empty lists."""
    return total([lax.mul(x, y) for x, y in zip(a, b, strict=True)])


def largest(terms: list[Scalar]) -> Scalar:
    """Maximum of a non-empty list; NaN if one of them is."""
    return reduce(lax.max, terms)


def shield(x: Scalar) -> Scalar:
    """x, behind an operation that XLA cannot drop; for `fused` a promise that x is finite wherever that matters.

    XLA:CPU does not fuse an expensive producer (division, square root) that has several users; behind a cheap single
    user it does, and the program stays one loop.
    """
    return screen(x, SHIELD)


@jax.jit
def milestone(x: Scalar) -> Scalar:
    """x, of which little is needed to go on: where `fused` cuts a program that is too long for one loop.

    `fused` sees the call; XLA a wall, where its loops end as well. Not to be differentiated.
    """
    return walled(lambda x: x)(x)


def power_of_two_scale(size: Scalar) -> tuple[Scalar, Scalar]:
    """(s, 1 / s) with s a power of two near `size` >= 0, read off its exponent: scaling by s rounds nothing.

    Both are kept normal numbers: the exponent is clipped, so size 0, infinite or NaN gives a finite scale.
    """
    info = jnp.finfo(size.dtype)
    word = jnp.dtype(f"int{info.bits}")
    bias = info.maxexp - 1
    exponent = lax.bitcast_convert_type(size, word) >> jnp.array(info.nmant, word)
    exponent = lax.clamp(jnp.array(1, word), exponent, jnp.array(2 * bias - 1, word))
    shift = jnp.array(info.nmant, word)
    scale = lax.bitcast_convert_type(exponent << shift, size.dtype)
    inverse = lax.bitcast_convert_type((jnp.array(2 * bias, word) - exponent) << shift, size.dtype)
    return scale, inverse
