"""What pivoting methods share: the exchange, the cap on their pivots, and the correction at the end.

A tableau writes the basic variables by the others, basic = T nonbasic + values. To exchange the basic variable of row r
with the nonbasic one of column s is one rank-one update. The next pivot needs only one row and one column of the
result, so a method leaves the update to its next step: it is then one loop over the matrices of a batch, and everything
else is short. Functions index rows by the first axes of arrays, and any further axes run along, so that a batch may put
its lanes last, where one instruction takes several.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxcontact.complementarity.short import dot, entry, largest, rows_of

REFINEMENTS = 2
"""Correction steps with the final basis; the best of all candidates is kept."""

PIVOTS_PER_ROW = 50
PIVOTS_OF_A_CUBE = 12
"""The default budget is PIVOTS_PER_ROW m + 2^min(m, PIVOTS_OF_A_CUBE): Murty's and Fathi's cubes need 2^m pivots."""


class Exchange(NamedTuple):
    """A pivot that a tableau still has to take: T without row r and column s, minus left right'."""

    row: jax.Array
    """int32 r, or -1 for none"""
    column: jax.Array
    """int32 s, or -1 for none"""
    left: jax.Array
    """(m,) column s of T, 1 in row r"""
    right: jax.Array
    """(n,) row r of T over the pivot p, -1/p in column s; zeros for none"""


def no_exchange(T):
    """The `Exchange` that leaves T (m, n) as it is."""
    none = jnp.full((), -1, jnp.int32)
    return Exchange(none, none, jnp.zeros_like(T[:, 0]), jnp.zeros_like(T[0]))


def exchanged(T, exchange):
    """(m, n) T after the exchange."""
    gone = (rows_of(exchange.left) == exchange.row[None])[:, None]
    gone = gone | (rows_of(exchange.right) == exchange.column[None])[None, :]
    return jnp.where(gone, 0, T) - exchange.left[:, None] * exchange.right[None, :]


def exchange_of(go, r, s, across, down, values):
    """(`Exchange` of the basic variable of row r with the nonbasic one of column s, values (m,) after it); nothing
    changes unless `go`. across (n,), down (m,): row r and column s of T."""
    p, value = entry(down, r), entry(values, r)
    inverse = jnp.where(go, 1 / jnp.where(go, p, 1), 0)
    row, column = jnp.where(go, r, -1), jnp.where(go, s, -1)
    left = jnp.where(rows_of(down) == r[None], 1, down)
    right = jnp.where(rows_of(across) == column[None], -inverse[None], across * inverse[None])
    rest = jnp.where(rows_of(values) == row[None], 0, values)
    return Exchange(row, column, left, right), rest - left * (value * inverse)[None]


def check_cap(method):
    """Raise ValueError for a `max_steps` below one."""
    if method.max_steps is not None and method.max_steps < 1:
        owner = type(method).__name__
        raise ValueError(f"{owner}: max_steps must be at least 1, got {method.max_steps}; None chooses by size")


def pivot_budget(m):
    """Pivots allowed by default for m contacts."""
    return PIVOTS_PER_ROW * m + 2 ** min(m, PIVOTS_OF_A_CUBE)


def violation(M, q, z):
    """max |min(z_i, (M z + q)_i)|, for data balanced by powers of two."""
    return largest(jnp.minimum(z, dot(M, z) + q))


def refined(M, q, z, correction):
    """(m,) >= 0, the candidate with the least violation among z and z - correction(M z + q), repeated.

    Rounding may leave a basic z slightly negative: it is set to zero before the violation is measured, so that what is
    measured is what is returned.
    """
    best = jnp.maximum(z, 0)
    least = violation(M, q, best)
    for _ in range(REFINEMENTS):
        z = z - correction(dot(M, z) + q)
        held = jnp.maximum(z, 0)
        size = violation(M, q, held)
        better = size < least
        best, least = jnp.where(better, held, best), jnp.where(better, size, least)
    return best
