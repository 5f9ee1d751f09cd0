"""The class of a sliding problem at given friction: one solution for every load, and how far the forces can move."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from .. import linalg
from ..dynamics import Delassus
from ..dynamics.numbers import as_float_array
from .classes import MOST_INDICES, Membership, _membership, _norm, _norm_inf_of_inverse, _reciprocal
from .ratio import ratio_of

_ENTRIES = {
    (True, True): (1.0, -1.0),
    (True, False): (1.0,),
    (False, True): (1.0, -1.0, 0.0),
    (False, False): (1.0, 0.0),
}
"""By (bilateral, frictional): what a contact may do, closed with a sign of friction, or open (0)."""


@dataclass(frozen=True)
class _Vertices:
    members: np.ndarray
    signs: np.ndarray


def uniqueness(operators: Delassus, mu: Array) -> Membership:
    """Has the sliding problem exactly one solution for every load, every sign of sliding and all |mu_i'| <= mu_i?

    All det (W - Wt [mu S])_I positive (mathematics 3(b), (d), (e)). Its margin is the distance, in the spectral norm of
    these matrices, to a problem that has not; `members` and `signs` are the set of closed contacts and the signs that
    decide. `uniqueness(here, jnp.array([0.3, 0.3])).verdict`

    Raises:
        ValueError: for more than MOST_INDICES contacts, or a mu that `critical` would not take as ratio.
    """
    rates = ratio_of(operators.contacts, as_float_array("mu", mu), operators.N.dtype)
    W, Wt = operators.W, operators.Wt * rates[None, :]
    every = _vertices(operators)

    def at(member, sign):
        inside = (member[:, None] * member[None, :]) > 0
        return jnp.where(inside, W - Wt * sign[None, :], jnp.eye(W.shape[0], dtype=W.dtype))

    return _membership(at, every.members, every.signs, _norm(W) + _norm(Wt))


def lipschitz(operators: Delassus, mu: Array) -> Array:
    """The Lipschitz constant of load -> normal forces, N per (m/s^2), 2-norms, over all signs of sliding.

    max |((W - Wt [mu S])_I)^-1|_2: every piece of the piecewise-linear map occurs. Meaningful where `uniqueness` holds.
    `lipschitz(here, jnp.array([0.3, 0.3]))`
    """
    rates = ratio_of(operators.contacts, as_float_array("mu", mu), operators.N.dtype)
    W, Wt = operators.W, operators.Wt * rates[None, :]
    size = _norm(W) + _norm(Wt)
    every = _vertices(operators)

    def at(member, sign):
        inside = (member[:, None] * member[None, :]) > 0
        X = jnp.where(inside, W - Wt * sign[None, :], size * jnp.eye(W.shape[0], dtype=W.dtype))
        return _reciprocal(jnp.linalg.svd(X, compute_uv=False)[-1])

    return linalg.greatest(jax.vmap(at)(jnp.asarray(every.members, W.dtype), jnp.asarray(every.signs, W.dtype)))


def guaranteed_error(operators: Delassus, mu: Array, xi: Array, normal: Array) -> Array:
    """A bound of |normal - solution|_inf, N, for any computed normal forces, from their residual alone.

    c |r|_inf with r_i = (W lambda - Wt [mu xi] |lambda| + w)_i at bilateral contacts and min(lambda_i, that) at
    unilateral ones, lambda_u in place of |lambda_u|; c is the maximum of |X^-1|_inf over the matrices between any two
    points (Chen & Xiang 2006 for the LCP; the same ratio of affine functions in each sign for |lambda|). A guarantee
    where `uniqueness` holds, up to the rounding of the residual. `guaranteed_error(here, mu, xi, forces.normal)`
    """
    rates = ratio_of(operators.contacts, as_float_array("mu", mu), operators.N.dtype)
    m, dtype = len(operators.contacts), operators.N.dtype
    rough = jnp.asarray([contact.frictional for contact in operators.contacts], bool)
    pull = jnp.where(rough, rates * jnp.asarray(xi).astype(dtype), 0)
    both = jnp.asarray([contact.bilateral for contact in operators.contacts], bool)
    W, Wt = operators.W, operators.Wt * pull[None, :]
    highest = jax.lax.Precision.HIGHEST
    felt = jnp.where(both, abs(normal), normal)
    gap = jnp.matmul(W, normal, precision=highest) - jnp.matmul(Wt, felt, precision=highest) + operators.w
    residual = linalg.greatest(abs(jnp.where(both, gap, jnp.minimum(normal, gap))), initial=0)
    every = _vertices(operators, directed=True)
    one = jnp.eye(m, dtype=dtype)

    def at(member, sign):
        return _norm_inf_of_inverse(jnp.where(member[:, None] > 0, W - Wt * sign[None, :], one))

    constants = jax.vmap(at)(jnp.asarray(every.members, dtype), jnp.asarray(every.signs, dtype))
    return linalg.greatest(constants) * residual


def _vertices(operators: Delassus, directed: bool = False) -> _Vertices:
    """All sets of closed contacts with all signs; `directed`: friction at unilateral contacts has one direction."""
    m = len(operators.contacts)
    if not 0 < m <= MOST_INDICES:
        raise ValueError(f"1 to {MOST_INDICES} contacts are looked at, got {m}: every set of closed contacts is tried")
    kinds = [(c.bilateral, c.frictional and (c.bilateral or not directed)) for c in operators.contacts]
    table = np.array(np.meshgrid(*[_ENTRIES[kind] for kind in kinds], indexing="ij")).reshape(m, -1).T
    return _Vertices(members=(table != 0).astype(float), signs=table)
