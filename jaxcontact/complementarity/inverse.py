"""An inverse that survives dependent rows: Gauss-Jordan with complete pivoting, in rank-one updates.

For a singular matrix it returns the inverse of a largest regular block, padded with zeros: K G K = K up to rounding.
Pivots far below the size of the (balanced) matrix count as zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxcontact.complementarity.scaling import exponent, power_of_two
from jaxcontact.complementarity.short import counted, dot, first, greatest, largest, largest_of_rows

PIVOT_FLOOR = 16
"""A pivot below PIVOT_FLOOR * n * eps of the largest balanced entry is rounding, and ends the elimination."""


class Inverse(NamedTuple):
    """A generalised inverse and what it cost."""

    matrix: jax.Array
    """(n, n) G with K G K = K."""
    deficiency: jax.Array
    """int: n minus the numerical rank."""
    condition: jax.Array
    """|K| |G| in the largest-row-sum norm, of the balanced matrix."""


@jax.custom_jvp
def inverse(K):
    """(n, n) generalised inverse of K (n, n); its derivative is -G dK G, exact while the rank and the block stay.

    >>> inverse(jnp.array([[0.0, 2.0], [4.0, 0.0]]))     # [[0, 1/4], [1/2, 0]]
    """
    return analysed_inverse(K).matrix


@inverse.defjvp
def _(primals, tangents):
    G = inverse(primals[0])
    return G, -dot(G, dot(tangents[0], G))


def analysed_inverse(K):
    """`Inverse` of K (n, n): rows, then columns, are balanced by powers of two first."""
    n = K.shape[0]
    if n == 0:
        return Inverse(K, jnp.zeros((), jnp.int32), jnp.ones((), K.dtype))
    B, rows, columns = balanced(K)
    G, rank = _gauss_jordan(B)
    G = jnp.where(rank == n, G + dot(G, jnp.eye(n, dtype=K.dtype) - dot(B, G)), G)
    condition = _row_sum_norm(B) * _row_sum_norm(G)
    return Inverse(columns[:, None] * G * rows[None, :], n - rank, condition)


def balanced(K):
    """(B, rows, columns): B_ij = rows_i K_ij columns_j with powers of two, entries below one."""
    rows = power_of_two(-exponent(largest_of_rows(K)), K.dtype)
    B = K * rows[:, None]
    columns = power_of_two(-exponent(largest_of_rows(B.T)), K.dtype)
    return B * columns[None, :], rows, columns


def _gauss_jordan(B):
    """In-place inversion: after n sweeps, T holds the inverse with rows and columns in pivot pairing."""
    n = B.shape[0]
    floor = PIVOT_FLOOR * n * jnp.finfo(B.dtype).eps * largest(B)
    free = jnp.ones(n, bool)
    carry = (B, free, free, jnp.zeros((n, n), B.dtype))
    T, _, _, pairing = counted(n, lambda _, c: _sweep(c, floor), carry)
    return dot(pairing.T, dot(T, pairing.T)), jnp.sum(pairing).astype(jnp.int32)


def _sweep(carry, floor):
    """Exchange one row with one column at the largest entry left (Jordan exchange), or do nothing below the floor."""
    T, rows_free, columns_free, pairing = carry
    size = jnp.where(rows_free[:, None] & columns_free[None, :], jnp.abs(T), -1)
    best = greatest(size, -1)
    across = jnp.max(size, axis=1)
    row = first(across == best)
    column = first((jnp.where(row[:, None], size, -2).max(axis=0) == best) & columns_free)
    go = best > floor
    pivot = jnp.where(go, jnp.sum(jnp.where(row[:, None] & column[None, :], T, 0)), 1)
    pivot_row = jnp.sum(jnp.where(row[:, None], T, 0), axis=0)
    pivot_column = jnp.sum(jnp.where(column[None, :], T, 0), axis=1)
    exchanged = T - pivot_column[:, None] * (pivot_row / pivot)[None, :]
    exchanged = jnp.where(row[:, None], (pivot_row / pivot)[None, :], exchanged)
    exchanged = jnp.where(column[None, :], -(pivot_column / pivot)[:, None], exchanged)
    exchanged = jnp.where(row[:, None] & column[None, :], 1 / pivot, exchanged)
    kept = rows_free & ~(row & go), columns_free & ~(column & go)
    paired = pairing + jnp.where(row[:, None] & column[None, :] & go, 1, 0).astype(T.dtype)
    return jnp.where(go, exchanged, T), *kept, paired


def _row_sum_norm(A):
    return largest(jnp.sum(jnp.abs(A), axis=1))
