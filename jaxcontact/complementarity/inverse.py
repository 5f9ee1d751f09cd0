"""An inverse that survives dependent rows.

For a singular matrix it is the inverse of a largest regular block, padded with zeros: K G K = K up to rounding. The
block is that of Gauss-Jordan elimination with complete pivoting, where pivots far below the size of the (balanced)
matrix count as zero. Two by two is a closed form. A larger matrix, or a batch of them, goes to the library first, and
is eliminated only where its condition leaves the rank in doubt; a small one by itself is eliminated at once.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxcontact import linalg
from jaxcontact.complementarity.scaling import exponent, power_of_two
from jaxcontact.complementarity.short import dot, first, greatest, largest, largest_of_rows
from jaxcontact.linalg import det2, where_needed

PIVOT_FLOOR = 16
"""A pivot below PIVOT_FLOOR * n * eps of the largest balanced entry is rounding, and ends the elimination."""

DOUBT = 2.0**-10
"""Above DOUBT / eps the condition number says nothing of the rank."""


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


@jax.jit  # traced once for all who ask
def analysed_inverse(K):
    """`Inverse` of K (n, n): rows, then columns, are balanced by powers of two first."""
    n = K.shape[0]
    if n == 0:
        return Inverse(K, jnp.zeros((), jnp.int32), jnp.ones((), K.dtype))
    B, rows, columns = balanced(K)
    found = _closed if n <= CLOSED else _eliminated_alone if n <= ELIMINATED else _eliminated_if_needed
    G, rank = found(B)
    condition = _row_sum_norm(B) * _row_sum_norm(G)
    return Inverse(columns[:, None] * G * rows[None, :], n - rank, condition)


def condition_number(K):
    """|K| |K^-1| of the balanced K (n, n), for when nothing else is asked: infinite or NaN where K is singular."""
    if K.shape[0] <= CLOSED:
        found = analysed_inverse(K)
        return linalg.where(found.deficiency > 0, jnp.inf, found.condition)
    B = balanced(K)[0]
    return _row_sum_norm(B) * _row_sum_norm(jnp.linalg.inv(B))


def balanced(K):
    """(B, rows, columns): B_ij = rows_i K_ij columns_j with powers of two, entries below one."""
    rows = power_of_two(-exponent(largest_of_rows(K)), K.dtype)
    B = K * rows[:, None]
    columns = power_of_two(-exponent(largest_of_rows(B.T)), K.dtype)
    return B * columns[None, :], rows, columns


CLOSED = 2
"""Largest size with a closed form."""

ELIMINATED = 8
"""Largest size that is eliminated at once: the library would not be quicker, and its first call in a process takes
0.2 s, in which JAX loads LAPACK."""


def _closed(B):
    """(inverse, rank) of one or two rows, by the same rule as the elimination: the second pivot is the determinant,
    free of cancellation in compensated arithmetic, over the first."""
    n = B.shape[0]
    entries = [B[i, j] for i in range(n) for j in range(n)]
    pivot = largest(B)
    single = pivot > 0
    if n == 1:
        return linalg.where(single, 1 / linalg.where(single, B, 1), 0), single.astype(jnp.int32)
    a, b, c, d = entries
    volume = det2(a, b, c, d)
    regular = lax.abs(volume) > PIVOT_FLOOR * n * jnp.finfo(B.dtype).eps * pivot * pivot
    scale = 1 / linalg.where(regular, volume, 1)
    taken, alone = jnp.zeros((), bool), []
    for entry in entries:
        here = single & ~taken & (lax.abs(entry) == pivot)
        alone.append(linalg.where(here, 1 / linalg.where(here, entry, 1), 0))
        taken = taken | here
    full, part = (d, -b, -c, a), (alone[0], alone[2], alone[1], alone[3])
    G = [linalg.where(regular, scale * x, y) for x, y in zip(full, part, strict=True)]
    rank = linalg.where(regular, 2, single.astype(jnp.int32)).astype(jnp.int32)
    return jnp.stack([jnp.stack(G[:2]), jnp.stack(G[2:])]), rank


@custom_vmap
def _eliminated_alone(B):
    """(inverse, rank) by elimination; of a batch as below, which is quicker there."""
    return _gauss_jordan(B)


@_eliminated_alone.def_vmap
def _(size, batched, B):
    return jax.vmap(_eliminated_if_needed)(B), (True, True)


def _eliminated_if_needed(B):
    """(inverse, rank) by the library, corrected once; by elimination where that does not settle the rank."""
    n = B.shape[0]
    G = jnp.linalg.inv(B)
    clear = _row_sum_norm(B) * _row_sum_norm(G) < DOUBT / jnp.finfo(B.dtype).eps
    G = G + dot(G, jnp.eye(n, dtype=B.dtype) - dot(B, G))
    return where_needed(~clear, _gauss_jordan, (linalg.where(clear, G, 0), jnp.int32(n)), B)


def _gauss_jordan(B):
    """In-place inversion: after n sweeps, T holds the inverse with rows and columns in pivot pairing."""
    n = B.shape[0]
    floor = PIVOT_FLOOR * n * jnp.finfo(B.dtype).eps * largest(B)
    free = jnp.ones(n, bool)
    carry = (B, free, free, jnp.zeros((n, n), B.dtype))
    T, _, _, pairing = lax.fori_loop(0, n, lambda _, c: _sweep(c, floor), carry)
    G, rank = dot(pairing.T, dot(T, pairing.T)), jnp.sum(pairing).astype(jnp.int32)
    return linalg.where(rank == n, G + dot(G, jnp.eye(n, dtype=B.dtype) - dot(B, G)), G), rank


def _sweep(carry, floor):
    """Exchange one row with one column at the largest entry left (Jordan exchange), or do nothing below the floor."""
    T, rows_free, columns_free, pairing = carry
    size = linalg.where(rows_free[:, None] & columns_free[None, :], lax.abs(T), -1)
    best = greatest(size, -1)
    across = linalg.greatest(size, axis=1)
    row = first(across == best)
    column = first((linalg.greatest(linalg.where(row[:, None], size, -2), 0) == best) & columns_free)
    go = best > floor
    pivot = linalg.where(go, jnp.sum(linalg.where(row[:, None] & column[None, :], T, 0)), 1)
    pivot_row = jnp.sum(linalg.where(row[:, None], T, 0), axis=0)
    pivot_column = jnp.sum(linalg.where(column[None, :], T, 0), axis=1)
    exchanged = T - pivot_column[:, None] * (pivot_row / pivot)[None, :]
    exchanged = linalg.where(row[:, None], (pivot_row / pivot)[None, :], exchanged)
    exchanged = linalg.where(column[None, :], -(pivot_column / pivot)[:, None], exchanged)
    exchanged = linalg.where(row[:, None] & column[None, :], 1 / pivot, exchanged)
    kept = rows_free & ~(row & go), columns_free & ~(column & go)
    paired = pairing + linalg.where(row[:, None] & column[None, :] & go, 1, 0).astype(T.dtype)
    return linalg.where(go, exchanged, T), *kept, paired


def _row_sum_norm(A):
    return largest(jnp.sum(lax.abs(A), axis=1))
