"""How sure contact forces are: whether others solve the problem, how far a load moves them, how wrong they can be."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..bounds import guaranteed_error, lipschitz, uniqueness
from ..bounds.classes import Membership
from ..dynamics import Delassus


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Certificate:
    """What `jaxcontact.bounds` says of one sliding problem and its computed forces; not differentiated."""

    uniqueness: Membership
    """Is there one solution for every load, every sign of sliding and all friction up to mu? Verdict and margin."""
    lipschitz: Array
    """The most by which normal forces change with w = c - G^T M^-1 F, N per (m/s^2), 2-norms; where unique."""
    error: Array
    """|normal - solution|_inf is at most this, N, up to the rounding of the residual; NaN unless unique and solved."""


def certificate(operators: Delassus, mu: Array, xi: Array, normal: Array) -> Certificate:
    """The `Certificate` of normal forces (m,) at friction mu (m,) and signs of sliding xi (m,), in 3^m or 4^m work.

    Source: mathematics of 3(b), (d), (e); Chen and Xiang, Math. Program. 106 (2006), for the error bound.
    Raises ValueError for more contacts than `jaxcontact.bounds.classes.MOST_INDICES`, or none.

    >>> jc.contact_forces(guides, state, mu, certified=True).certificate.error
    """
    operators, mu, xi, normal = lax.stop_gradient((operators, mu, xi, normal))
    unique = uniqueness(operators, mu)
    error = guaranteed_error(operators, mu, xi, normal)
    return Certificate(unique, lipschitz(operators, mu), linalg.where(unique.verdict == 1, error, jnp.nan))
