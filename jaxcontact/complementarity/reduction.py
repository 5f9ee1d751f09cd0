"""Any normal form as an LCP: elimination of the free unknowns and of one unknown of every pair."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact import linalg
from jaxcontact.complementarity.forms import NormalForm, mode_matrix
from jaxcontact.complementarity.inverse import PIVOT_FLOOR, analysed_inverse, balanced
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.records import unchecked
from jaxcontact.complementarity.short import counted, dot, first, largest_of_rows

RELUCTANCE = 2.0**-6
"""P_j is chosen over N_j, and a row of D over one of A, only for a pivot 1 / RELUCTANCE times larger: the basis of all
w, with u from its own equations, is the natural one."""


class Reduction(NamedTuple):
    """An LCP in the unknowns that were not eliminated, and what leads back."""

    lcp: LCP
    eliminated: jax.Array
    """(m,) bool: z_j was eliminated, so that w_j is the unknown of the LCP; else the other way round"""
    offset: jax.Array
    """(k + m,) G q"""
    slope: jax.Array
    """(k + m, m) G Y, so that (u, ±eliminated) = -(offset + slope y)"""
    dependent: jax.Array
    """bool: no regular choice was found, some equations depend on others"""
    contradiction: jax.Array
    """(k + m,) y with y'K = 0 and y'q >= 0, positive if dependent equations contradict each other"""
    transform: jax.Array
    """(m, k + m): a certificate of the LCP times this is one of the normal form"""

    def back(self, y):
        """(free, z, w) of the normal form from the unknown y (m,) of the LCP."""
        k = self.offset.shape[0] - y.shape[0]
        solved = -(self.offset + dot(self.slope, y))
        partner = jnp.where(self.eliminated, solved[k:], -solved[k:])
        return solved[:k], jnp.where(self.eliminated, partner, y), jnp.where(self.eliminated, y, partner)


def reduce_to_lcp(form: NormalForm) -> Reduction:
    """The `Reduction` of a normal form; F or N may be singular as long as some mode is regular.

    >>> reduce_to_lcp(normal_form(MLCP(A, C, a, D, B, b))).lcp.M     # B - D A^-1 C
    """
    k = form.F.shape[1]
    eliminated = _regular_mode(form)
    K = mode_matrix(form, eliminated.astype(form.q.dtype))
    found = analysed_inverse(K)
    G = found.matrix
    sign = jnp.where(eliminated, 1, -1).astype(form.q.dtype)
    Y = jnp.where(eliminated[None, :], -form.N, form.P)
    slope, offset = _without_rounding(dot(G, Y), G, K, Y), dot(G, form.q)
    lcp = unchecked(LCP, M=-sign[:, None] * slope[k:], q=-sign * offset[k:])
    miss = form.q - dot(K, offset)
    contradiction = miss - dot(G.T, dot(K.T, miss))
    return Reduction(lcp, eliminated, offset, slope, found.deficiency > 0, contradiction, -sign[:, None] * G[k:])


def _without_rounding(slope, G, K, Y):
    """G Y with zeros for the entries that are rounding of the inverse: below PIVOT_FLOOR n eps |G| |K| |G| |Y|, and,
    since one correction of G leaves products of roundings, below eps^2 in the units that balance K. A diagonal entry
    that should vanish, as in [[M, I], [-I, 0]], would otherwise be taken for the stiffness of its row."""
    eps = jnp.finfo(slope.dtype).eps
    _, rows, columns = balanced(K)
    unit = columns[:, None] * largest_of_rows((rows[:, None] * Y).T)[None, :]
    error = dot(lax.abs(G), dot(lax.abs(K), dot(lax.abs(G), lax.abs(Y)))) + eps * unit
    return jnp.where(lax.abs(slope) > PIVOT_FLOOR * len(G) * eps * error, slope, 0)


def _regular_mode(form):
    """(m,) bool: the pairs whose P_j is taken, by elimination with the largest pivot left: columns of F, then pairs."""
    k, m = form.F.shape[1], form.P.shape[1]
    T, _, _ = balanced(jnp.concatenate([form.F, form.N, form.P], axis=1))
    rows, columns = jnp.arange(k + m), jnp.arange(k + 2 * m)
    of_free, of_P = columns < k, columns >= k + m
    own_rows = jnp.where(of_free[None, :], jnp.where(rows < k, 1, RELUCTANCE)[:, None], 0).astype(T.dtype)
    own_w = jnp.broadcast_to(jnp.where(of_free, 0, jnp.where(of_P, RELUCTANCE, 1))[None, :], T.shape).astype(T.dtype)
    carry = (T, jnp.ones(k + m, bool), jnp.ones(k + 2 * m, bool), jnp.zeros(k + 2 * m, bool))
    carry = counted(k, lambda _, c: _eliminate(c, own_rows, k), carry)
    carry = counted(m, lambda _, c: _eliminate(c, own_w, k), carry)
    return carry[3][k + m :]


def _eliminate(carry, weight, k):
    """Take the column with the largest weighted entry left, and spend its row, itself and its twin of the pair."""
    T, rows_left, columns_left, taken = carry
    size = jnp.where(rows_left[:, None] & columns_left[None, :], lax.abs(T) * weight, 0)
    best = linalg.greatest(size)
    row = first(linalg.greatest(size, axis=1) == best)
    column = first(linalg.greatest(jnp.where(row[:, None], size, -1), axis=0) == best)
    go = best > PIVOT_FLOOR * T.shape[0] * jnp.finfo(T.dtype).eps * RELUCTANCE
    pivot = jnp.where(go, jnp.sum(jnp.where(row[:, None] & column[None, :], T, 0)), 1)
    pivot_row = jnp.sum(jnp.where(row[:, None], T, 0), axis=0) / pivot
    rest = jnp.where(row, 0, jnp.sum(jnp.where(column[None, :], T, 0), axis=1))
    m = T.shape[1] - T.shape[0]
    twin = jnp.concatenate([jnp.zeros(k, bool), column[k + m :], column[k : k + m]])
    return (
        jnp.where(go, T - rest[:, None] * pivot_row[None, :], T),
        rows_left & ~(row & go),
        columns_left & ~((column | twin) & go),
        taken | (column & go),
    )
