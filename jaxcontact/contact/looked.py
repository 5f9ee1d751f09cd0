"""What is measured of an answer, in a few loops over a batch: residuals, dependence, contradiction, uniqueness."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
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
    """`Looked`, in a few loops over a batch; not differentiated."""
    contacts = operators.contacts

    def measured(parts, operators, free, friction, found, normal, a):
        load = length_of(free[:, None])[0]
        motion = Motion(a, normal, -friction * lax.abs(normal), friction, length_of(operators.N), load)
        misses, unique = residuals(contacts, parts, motion), _certified(found.N, found.D)
        return Looked(misses, found.span.deficient, contradiction(operators, found), unique)

    operators, found = replace(operators, L=None, terms=None), found._replace(problem=None)  # not needed
    return linalg.packed(measured)(*lax.stop_gradient((parts, operators, free, friction, found, normal, a)))


def _certified(N: Array, D: Array) -> Array:
    """bool: W - sigma_max(N^T D) I is positive definite, beyond rounding, so that W - Wt D is for all signs and the
    solution is unique: the direct bound of the mixed problem, each force in units of 1 / |N_k|."""
    lengths = length_of(N)
    lengths = linalg.where(lengths > 0, lengths, 1)[None, :]
    unit = N / lengths
    least = linalg.singular_value_max(linalg.gram(unit, D / lengths)) + N.shape[1] * dependence(sum(N.shape), N.dtype)
    return linalg.all_finite(linalg.cholesky(linalg.gram(unit, unit) - least * np.eye(N.shape[1], dtype=N.dtype)))
