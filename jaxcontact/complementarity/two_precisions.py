"""float32 first, and float64 again where its answer is in doubt.

An answer of float32 is that of data rounded to float32, with a backward error of a few roundings; what it misses the
answer of the given data by is about that times the condition number of the active equations. So the condition tells
which lanes have to be solved again, and they alone are.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.complementarity.bars import backward_error_bound
from jaxcontact.complementarity.derivative import attach
from jaxcontact.complementarity.problems import AbsoluteValueEquation
from jaxcontact.complementarity.solution import Solution
from jaxcontact.complementarity.solve import solve
from jaxcontact.complementarity.status import Status
from jaxcontact.linalg import for_the_few

LANES_AGAIN = 256
"""Doubtful lanes of a batch are solved again by so many at a time."""


class TwoPrecisions(NamedTuple):
    """What `solve_in_two_precisions` returns."""

    solution: Solution
    """in float64; residuals and status of a lane are those of the precision in which it was solved"""
    redone: jax.Array
    """bool: float32 left the answer in doubt, and this is the one of float64"""


def solve_in_two_precisions(problem, method, start=None, *, accuracy: float = 1e-3) -> TwoPrecisions:
    """A float64 problem solved in float32 where that is good enough, else in float64; `jax.vmap` for batches, of which
    only the doubtful lanes are solved twice. `redone.sum()` says how many.

    It is meant for where float64 is much slower than float32 and few lanes are in doubt; on CPUs it hardly pays, nor on
    GPUs for computing (`python -m benchmarks tradeoff`, `limits`).

    Args:
        problem, method, start: as for `solve`; the problem in float64.
        accuracy: relative error of the answer, to first order, above which a lane is in doubt: BACKWARD_ERROR_BOUND
            eps of float32 times the condition of the active equations. inf: in doubt is what float32 did not solve,
            solved without margin (degenerate pairs) or only up to dependent equations.

    Raises:
        ValueError: a problem that is not float64, an accuracy that is not positive, and what `solve` raises.

    >>> solve_in_two_precisions(LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]), Lemke()).redone     # False
    """
    leaves = jax.tree.leaves(problem)
    if any(x.dtype != jnp.float64 for x in leaves):
        found = ", ".join(sorted({str(x.dtype) for x in leaves}))
        raise ValueError(f"solve_in_two_precisions: expected a float64 problem, got {found}; write solve(...)")
    if not accuracy > 0:
        raise ValueError(f"solve_in_two_precisions: accuracy must be positive, got {accuracy}")
    fixed, guess = lax.stop_gradient((problem, start))
    rounded = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (fixed, guess))
    rough = solve(rounded[0], method, rounded[1])
    first = jax.tree.map(lambda x: x.astype(jnp.float64) if x.dtype == jnp.float32 else x, rough)
    error = float(backward_error_bound(jnp.float32)) * first.condition
    clear = (first.status == int(Status.SOLVED)) & ~first.redundant & (first.degenerate == 0) & (error <= accuracy)
    given = (fixed,) if guess is None else (fixed, guess)
    again = for_the_few(~clear, lambda p, *s: solve(p, method, *s), first, *given, lanes=LANES_AGAIN)
    return TwoPrecisions(_with_derivative(problem, again), ~clear)


def _with_derivative(problem, found: Solution) -> Solution:
    """The solution with the derivative of the given problem, whoever found it."""
    twofold = isinstance(problem, AbsoluteValueEquation)
    free = found.free[:0] if twofold else found.free
    free, z, w = attach(problem, free, found.z, found.w)
    return replace(found, z=z, w=w, free=z - w if twofold else free)
