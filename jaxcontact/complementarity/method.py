"""What a method is: a frozen dataclass with the verbs init, step and read. The loop is in `solve`."""

from typing import Any, NamedTuple, Protocol

import jax

from jaxcontact.complementarity.problems import LCP


class Answer(NamedTuple):
    """What a method says at the end; the judge decides whether it is so."""

    z: jax.Array
    """(m,) proposed solution in the caller's units, without negative entries"""
    outcome: jax.Array
    """int32 `Status`: SOLVED, or the reason why not; NO_SOLUTION if z is the best of all candidates, so that nothing
    solves the problem unless z does"""
    certificate: jax.Array
    """(m,) y with y <= 0, M'y >= 0, q'y > 0 claimed on a ray; zeros otherwise"""


class Method(Protocol):
    """Configuration of a solver of LCP(M, q), m >= 1. States are pytrees with a boolean scalar `done`.

    A method may have more: `compiled(problem, start, certified)`, its `native.Answers`, taken where those kernels are
    at hand, with the certificate if `certified`; `of_pairs(P, N, q)` for up to `pairs` complementary pairs without free
    unknowns, as they are, and `compiled_pairs(P, N, q)`, `native.Pairs` (`Direct`);
    `kind = AbsoluteValueEquation`, and then it gets these instead of LCPs (`Banach`); `lanes_last = True` if `step`
    takes states whose arrays all have further axes at the end, and leaves alone what is done (`Lemke`).
    """

    def budget(self, m: int) -> int:
        """Most steps allowed for m contacts; 0 if `init` has the answer."""

    def init(self, problem: LCP, start: jax.Array | None) -> Any:
        """The first state; `start` (m,) is finite and non-negative, or None."""

    def step(self, problem: LCP, state: Any) -> Any:
        """The next state. It also runs for lanes of a batch that are done: every division in it must be safe."""

    def read(self, problem: LCP, state: Any) -> Answer:
        """The answer in the caller's units."""
