"""A mass matrix that is singular but for the constraints, made regular by them.

If bilateral constraints G_b^T a + c_b = 0 hold, then M a + F and (M + Gamma) a + F + g with

    Gamma = gamma G_b G_b^T,   g = gamma G_b c_b,   gamma >= 0

are equal: the same accelerations and forces solve both. M + Gamma is positive definite if M is positive semi-definite
and ker M meets ker G_b^T in zero only, which is the condition of Proposition 1(ii) of the tutorial for the KKT system
(4) to determine the acceleration. Then everything goes on as with a regular mass matrix.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Contact, Terms
from ..dynamics.delassus import select, select_columns

SINGULAR = 16
"""A pivot of the Cholesky factorisation below SINGULAR n eps of its diagonal entry is rounding."""


def stiffening(parts: Terms, contacts: tuple[Contact, ...]) -> tuple[Array, Array]:
    """(gamma >= 0; whether the mass matrix is sound) where M is not definite by itself.

    Sound, a bool: M is symmetric positive semi-definite, and definite on what the bilateral constraints leave free.

    >>> gamma, sound = stiffening(terms(mechanism, state), mechanism.contacts)
    """
    held = _held(contacts)
    if not held:
        return jnp.zeros((), parts.M.dtype), jnp.zeros((), bool)
    G = select_columns(parts.G, held)
    gamma = _stiffness(parts.M, G)
    stiffer = gamma * _outer(G)
    return gamma, is_definite(parts.M + stiffer) & _is_semidefinite(parts.M, stiffer)


def stiffened(parts: Terms, contacts: tuple[Contact, ...], gamma: Array) -> Terms:
    """The terms with M + Gamma and F + g."""
    held = _held(contacts)
    if not held:
        return parts
    G, c = select_columns(parts.G, held), select(parts.c, held)
    return replace(parts, M=parts.M + gamma * _outer(G), F=parts.F + gamma * jnp.sum(G * c[None, :], axis=1))


def _outer(G: Array) -> Array:
    """G G^T (n, n) as one operation, which a program on scalars takes apart; `linalg.gram` would be many."""
    return lax.dot_general(G, G, (((1,), (1,)), ((), ())), precision=lax.Precision.HIGHEST)


def _held(contacts: tuple[Contact, ...]) -> tuple[int, ...]:
    return tuple(i for i, contact in enumerate(contacts) if contact.bilateral)


@jax.jit
def is_definite(M: Array) -> Array:
    """bool: M (n, n) is positive definite, beyond rounding."""
    n = M.shape[0]
    M = lax.stop_gradient(M)
    L = linalg.cholesky(M)
    noise = SINGULAR * n * float(jnp.finfo(M.dtype).eps)
    return jnp.all(linalg.diagonal(L) ** 2 > noise * linalg.diagonal(M)) & jnp.all(lax.is_finite(L))


def _stiffness(M: Array, G: Array) -> Array:
    """gamma: as stiff as the largest mass along the longest gradient. Any positive number would do."""
    size = linalg.greatest(jnp.sum(G * G, axis=0), initial=0)
    return lax.stop_gradient(linalg.greatest(lax.abs(M), initial=0) / linalg.where(size > 0, size, 1))


def _is_semidefinite(M: Array, stiffer: Array) -> Array:
    """bool: M has no negative direction, up to half the digits: M + sqrt(eps) (diag |M| + Gamma) is definite."""
    share = float(jnp.finfo(M.dtype).eps) ** 0.5
    return is_definite(M + share * (linalg.where(np.eye(len(M), dtype=bool), lax.abs(M), 0) + stiffer))
