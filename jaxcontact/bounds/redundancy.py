"""Redundant constraints: which gaps depend on which, and whether an acceleration satisfies them all."""

import itertools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus
from .classes import MOST_INDICES
from .coupling import DEPENDENT

ROUNDING = 1000
"""A constraint counts as satisfied when it is missed by at most this many roundings of the accelerations involved."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Redundancy:
    """Which gap gradients are combinations of earlier ones."""

    rank: Array
    """int32: the number of independent gaps."""
    dependent: Array
    """(m,) bool: the gaps that add nothing to the earlier ones."""
    combination: Array
    """(m, m): grad h_i = sum_j combination[i, j] grad h_j for a dependent i, j independent; zero rows elsewhere."""


def redundancy(operators: Delassus) -> Redundancy:
    """The dependent gaps, in the order of the contacts, and what they are made of.

    `redundancy(delassus(table_on_four_legs, state)).combination`
    """
    N = operators.N
    n, m = N.shape
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    E, dependent = jnp.zeros((n, 0), N.dtype), []
    for i in range(m):
        rest = N[:, i]
        for _ in range(2):
            rest = rest - _product(E, _product(E.T, rest))
        left = jnp.sqrt(jnp.sum(rest * rest))
        gone = left <= DEPENDENT * float(jnp.finfo(N.dtype).eps) * length[i]
        dependent.append(gone)
        E = jnp.concatenate([E, jnp.where(gone, 0, rest / jnp.where(gone, 1, left))[:, None]], axis=1)
    gone = jnp.stack(dependent) if dependent else jnp.zeros(0, bool)
    kept = jnp.where(gone[None, :], 0, N)
    combination = _product(_pseudo_inverse(kept), N).T if m else jnp.zeros((0, 0), N.dtype)
    combination = jnp.where(gone[:, None] & ~gone[None, :], combination, 0)
    return Redundancy(rank=jnp.sum(~gone).astype(jnp.int32), dependent=gone, combination=combination)


def missed(operators: Delassus) -> tuple[Array, Array]:
    """(by how much the constraints on accelerations are missed at best, its rounding), m/s^2: 0 iff K and K_b meet.

    K and K_b meet iff there is an acceleration a with G_b^T a + c_b = 0 and G_u^T a + c_u >= 0. If so, the one of least
    M-norm is the least-norm solution of G_I^T a + c_I = 0 for its active set I, bilateral contacts and some unilateral
    ones: every set is tried. Equivalent to solvability of the frictionless problem for every force (Propositions 3(iv),
    7(v), 8, corrected by errata B2 to B4). Zero for operators from matrices, whose gaps are independent.

    `missed(here)[0]`

    Raises:
        ValueError: for more than MOST_INDICES unilateral contacts.
    """
    N, b, u = operators.N, operators.bilateral, operators.unilateral
    zero = 0 * jnp.sum(N)
    if operators.terms is None or N.shape[1] == 0:
        return zero, zero
    if len(u) > MOST_INDICES:
        raise ValueError(f"every set of {len(u)} unilateral contacts would be tried, at most {MOST_INDICES} are")
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    length = jnp.where(length > 0, length, 1)
    N, c = N / length[None, :], operators.terms.c / length
    active = np.zeros((2 ** len(u), N.shape[1]))
    active[:, list(b)] = 1
    active[:, list(u)] = np.array(list(itertools.product((0, 1), repeat=len(u)))).reshape(2 ** len(u), len(u))
    both = jnp.asarray([contact.bilateral for contact in operators.contacts], bool)

    def worst(chosen):
        a = -_product(_pseudo_inverse(N * chosen[None, :]).T, c * chosen)
        gap = _product(N.T, a) + c
        missed = jnp.where(both, abs(gap), jnp.maximum(-gap, 0))
        return linalg.greatest(missed), linalg.greatest(abs(a)) + linalg.greatest(abs(c))

    misses, sizes = jax.vmap(worst)(jnp.asarray(active, N.dtype))
    best = jnp.argmin(misses)
    return misses[best], ROUNDING * float(jnp.finfo(N.dtype).eps) * sizes[best]


def determined_by_constraints(M: np.ndarray, G: np.ndarray, contacts: tuple) -> tuple[bool, bool]:
    """(ker M meets ker G_b^T in 0 only, ker M meets the tangent cone in 0 only), for M >= 0, on plain arrays.

    The first makes the acceleration unique with bilateral constraints, redundant or not (Proposition 1(ii)); the second
    makes the frictionless problem solvable if K and K_b meet (Propositions 3(vi), 7(vii), erratum B3). The tangent cone
    is {x: G_b^T x = 0, G_u^T x >= 0}.

    `determined_by_constraints(np.diag([0.0, 1.0]), np.array([[1.0], [0.0]]), contacts)`
    """
    both = np.array([contact.bilateral for contact in contacts], bool)
    M, G = np.asarray(M), np.asarray(G)
    free = _null_space(np.vstack([M / (np.abs(M).max() or 1), G[:, both].T]))
    if free.shape[1] == 0:
        return True, True
    return False, not _has_ray(G[:, ~both].T @ free)


def _has_ray(A: np.ndarray) -> bool:
    """Is there a y, not zero, with A y >= 0? An extreme ray makes d - 1 independent rows vanish; a line makes all."""
    d = A.shape[1]
    lines = _null_space(A)
    if lines.shape[1]:
        return True
    for rows in itertools.combinations(range(A.shape[0]), d - 1):
        rays = _null_space(A[list(rows)])
        for y in (rays[:, 0], -rays[:, 0]) if rays.shape[1] == 1 else ():
            if (A @ y >= -ROUNDING * np.finfo(A.dtype).eps * np.abs(A).max()).all():
                return True
    return False


def _null_space(A: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the null space, in columns."""
    if A.shape[0] == 0:
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    rank = int((s > ROUNDING * np.finfo(A.dtype).eps * max(s[0], np.finfo(A.dtype).tiny)).sum())
    return Vt[rank:].T


def _pseudo_inverse(X: Array) -> Array:
    return jnp.linalg.pinv(X, rtol=DEPENDENT * float(jnp.finfo(X.dtype).eps))


def _product(A: Array, B: Array) -> Array:
    return jnp.matmul(A, B, precision=lax.Precision.HIGHEST)
