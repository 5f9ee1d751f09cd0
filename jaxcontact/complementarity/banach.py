"""The fixed point x <- A^-1 (B|x| - w) of an absolute value equation (tutorial, Proposition 10).

It contracts with rate |A^-1 B|_2 where that is below one, whatever w; beyond, nothing is promised.
"""

import dataclasses
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.complementarity.forms import normal_form
from jaxcontact.complementarity.inverse import inverse
from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.problems import AbsoluteValueEquation
from jaxcontact.complementarity.residuals import residuals
from jaxcontact.complementarity.short import dot
from jaxcontact.complementarity.status import Status

STOP_AT = 4
"""Without a tolerance, the iteration stops at a backward error of STOP_AT eps, well inside what the judge accepts."""


class FixedPoint(NamedTuple):
    """Where the iteration stands."""

    x: jax.Array
    """(m,)"""
    inverse: jax.Array
    """(m, m) A^-1, constant"""
    error: jax.Array
    """backward error of x, as the judge measures it"""
    done: jax.Array
    """bool"""


@dataclasses.dataclass(frozen=True)
class Banach:
    """The Banach iteration, with a budget of iterations. Problems of other kinds are first written as absolute value
    equations, an LCP with A = (I + M)/2 and B = (I - M)/2. Raises ValueError for a budget below one.

    >>> solve(AbsoluteValueEquation(A, B, w), Banach())
    """

    iterations: int = 1000
    kind: ClassVar = AbsoluteValueEquation

    def __post_init__(self):
        if self.iterations < 1:
            raise ValueError(f"Banach: iterations must be at least 1, got {self.iterations}")

    def budget(self, m):
        """Iterations allowed."""
        return self.iterations

    def init(self, problem: AbsoluteValueEquation, start):
        """x = A^-1 (B start - w); start is |x| or zero."""
        G = inverse(problem.A)
        size = jnp.zeros_like(problem.w) if start is None else start.astype(problem.w.dtype)
        return self._measured(problem, G, dot(G, dot(problem.B, size) - problem.w))

    def step(self, problem: AbsoluteValueEquation, state: FixedPoint):
        """One application of the map."""
        return self._measured(problem, state.inverse, dot(state.inverse, dot(problem.B, lax.abs(state.x)) - problem.w))

    def read(self, problem: AbsoluteValueEquation, state: FixedPoint):
        """x."""
        outcome = jnp.where(state.done, int(Status.SOLVED), int(Status.MAX_STEPS)).astype(jnp.int32)
        return Answer(state.x, outcome, jnp.zeros_like(state.x))

    def _measured(self, problem, G, x):
        error = residuals(problem, normal_form(problem), x[:0], jnp.maximum(x, 0), jnp.maximum(-x, 0))[0]
        target = STOP_AT * jnp.finfo(x.dtype).eps
        return FixedPoint(x, G, error, (error <= target) | ~lax.is_finite(error))


def contraction_rate(problem: AbsoluteValueEquation):
    """|A^-1 B|_2, the factor by which each Banach iteration reduces the error; below one the solution is unique.

    >>> contraction_rate(AbsoluteValueEquation([[2.0]], [[1.0]], [-3.0]))     # 1/2
    """
    if problem.w.shape[0] == 0:
        return jnp.zeros((), problem.w.dtype)
    return jnp.linalg.norm(dot(inverse(problem.A), problem.B), 2)
