"""What is measured of an answer, in a few loops over a batch: residuals, dependence, contradiction, uniqueness."""

from dataclasses import replace
from typing import NamedTuple

from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus, Terms
from .residuals import Motion, Residuals, residuals
from .sliding import Sliding, contradiction, length_of
from .span import dependence


class Looked(NamedTuple):
    """What is measured of an answer."""

    misses: Residuals
    deficient: Array
    """bool: the linear contacts depend on one another"""
    contradictory: Array
    """bool: and no acceleration satisfies them all"""
    unique: Array
    """bool: W - Wt D is positive definite for all signs of the forces"""


def looked_at(parts: Terms, operators: Delassus, free, friction, found: Sliding, normal, a) -> Looked:
    """`Looked`, in a few loops over a batch."""
    contacts = operators.contacts

    def measured(parts, operators, free, friction, found, normal, a):
        load = length_of(free[:, None])[0]
        motion = Motion(a, normal, -friction * lax.abs(normal), friction, length_of(operators.N), load)
        misses, unique = residuals(contacts, parts, motion), _certified(found.N, found.D)
        return Looked(misses, found.span.deficient, contradiction(operators, found), unique)

    operators, found = replace(operators, L=None, terms=None), found._replace(problem=None)  # not needed
    return linalg.packed(measured)(parts, operators, free, friction, found, normal, a)


def _certified(N: Array, D: Array) -> Array:
    """bool: sigma_min(N)^2 > sigma_max(N^T D), so that W - Wt D is positive definite for all signs and the solution is
    unique (the direct bound of the mixed problem)."""
    noise = dependence(sum(N.shape), N.dtype)
    least, greatest = linalg.singular_value_min(N), linalg.singular_value_max(N)
    pulled = linalg.singular_value_max(linalg.gram(N, D))
    return (least > noise * greatest) & (least**2 * (1 - noise) > pulled)
