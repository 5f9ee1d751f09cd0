"""Every solution of a sliding problem, and how many there are."""

from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..complementarity import all_solutions
from ..dynamics import Delassus
from .law import coefficients, signs
from .sliding import Sliding, contradiction, normal_forces, sliding, with_sign


class Multiplicity(IntEnum):
    """How many solutions a sliding problem has; `Multiplicity.flags()` labels a sweep."""

    NONE = 0
    ONE = 1
    MANY = 2
    INFINITE = 3
    UNDECIDED = 4
    """data that are not finite, or so close to singular that rounding decides"""

    @classmethod
    def flags(cls) -> dict[str, int]:
        """Meaning -> value, as `jaxcontact.sweep` reads it from a quantity: `quantity.flags = Multiplicity.flags()`."""
        return dict(zip(("none", "one", "several", "infinitely many", "undecided"), map(int, cls), strict=True))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Solutions:
    """All solutions of one sliding problem: one row for each mode, k = 2^r for r contacts that are unilateral or
    frictional. Rows that hold none, or one that an earlier row holds, are NaN and not valid."""

    normal: Array
    """(k, m) normal forces, N, in the user's order"""
    tangential: Array
    """(k, m) friction forces -mu xi |lambda_n|, N"""
    valid: Array
    """(k,) bool"""
    count: Array
    """int32: valid rows; with `infinite`, those of the families that are listed and the isolated ones"""
    infinite: Array
    """bool: some solutions form a segment, a ray or a space"""
    undecided: Array
    """bool: rounding decides, or the data are not finite; the list may miss solutions"""

    @property
    def multiplicity(self) -> Array:
        """int32, a `Multiplicity`."""
        counted = jnp.minimum(self.count, int(Multiplicity.MANY))
        known = linalg.where(self.infinite, int(Multiplicity.INFINITE), counted)
        return linalg.where(self.undecided, int(Multiplicity.UNDECIDED), known).astype(jnp.int32)


def solutions(operators: Delassus, mu: Array | None = None, xi: Array | None = None) -> Solutions:
    """Every solution of the sliding problem (60) at friction mu and slip signs xi; 2^r modes are tried.

    `solutions(jc.delassus(guides, state), mu=jnp.array([1.5, 1.5]), xi=jnp.array([-1.0, -1.0])).count`

    Args:
        operators: from `delassus`, at one state; batches through `jax.vmap`.
        mu, xi: (m,) coefficients and signs of the slips, -1 or 1; entries of frictionless contacts are ignored. None
            if nothing is frictional.

    Each row is differentiable as a branch of its own.

    Raises:
        ValueError: a shape that does not fit, a coefficient that is negative or not finite, a sign that is neither -1
            nor 1 (eager calls; in a trace: undecided), or more contacts than `all_solutions` takes.
    """
    mu = coefficients(operators.contacts, mu, operators.N.dtype)
    xi = jnp.ones_like(mu) if xi is None and not operators.frictional else xi
    if xi is None:
        raise ValueError("xi is None but some contacts are frictional: give the sign of each slip, -1 or 1")
    return _solutions(operators, mu * signs(operators.contacts, xi, operators.N.dtype))


def classify(operators: Delassus, mu: Array | None = None, xi: Array | None = None) -> Array:
    """int32: the `Multiplicity` of the sliding problem; arguments as in `solutions`.

    `jax.vmap(lambda theta: classify(jc.delassus(rod, rod.state(theta=theta)), mu, xi))(angles)`
    """
    return solutions(operators, mu, xi).multiplicity


classify.flags = Multiplicity.flags()
classify.long_name = "number of solutions"


@partial(jax.jit, inline=True)
def _solutions(operators: Delassus, friction: Array) -> Solutions:
    found = linalg.fused_in_batches(sliding)(operators, friction)
    rows, valid, infinite, undecided = _remaining(operators, found)
    possible = ~contradiction(operators, found)
    valid = valid & possible
    normal = jax.vmap(lambda row: normal_forces(operators, friction, found, row))(rows)
    normal = linalg.where(valid[:, None], normal, jnp.nan)
    return Solutions(
        normal=normal,
        tangential=-friction[None, :] * lax.abs(normal),
        valid=valid,
        count=jnp.sum(valid).astype(jnp.int32),
        infinite=(infinite | found.span.deficient) & jnp.any(valid),
        undecided=undecided & possible | ~linalg.all_finite(operators.N, friction),
    )


def _remaining(operators: Delassus, found: Sliding) -> tuple[Array, Array, Array, Array]:
    """(rows (k, r), valid (k,), infinite, undecided) of the contacts that the linear ones leave."""
    no = jnp.zeros((), bool)
    if found.problem is None:
        return jnp.zeros((1, 0), operators.N.dtype), lax.is_finite(jnp.sum(operators.w))[None], no, no
    every = all_solutions(found.problem)
    rows = jax.vmap(lambda z, w: with_sign(operators.contacts, z, w))(every.z, every.w)
    rows = linalg.where(every.valid[:, None], rows, 0)  # NaN would reach the derivatives of other rows
    return rows, every.valid, every.infinite, every.undecided
