"""A function of a few vectors as a program on scalars, traced once and then evaluated and differentiated many times."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.extend import core

from jaxcontact.linalg.reader import Reader
from jaxcontact.linalg.scalar_rules import Entries, entries_of
from jaxcontact.linalg.unrolled import Scalar, in_a_row


class Program:
    """What a function computes, on scalars: the entries of its arguments in, the entries of its one result out.

    Its Python runs once, and zeros, ones and repetitions are gone before anything is differentiated.

    >>> Program.of(lambda x: x * x, x).partial(0, in_a_row(x))  # [2 * x[0], 0]
    """

    def __init__(self, closed: core.ClosedJaxpr):
        self._closed = closed

    @classmethod
    def of(cls, function: Callable, *arguments: jax.Array) -> "Program":
        """The program of function(*arguments)."""
        traced = jax.make_jaxpr(function)(*arguments)

        def on_scalars(scalars):
            rest, inputs = list(scalars), []
            for x in arguments:
                inputs.append(Entries(x.shape, x.dtype, rest[: x.size]))
                rest = rest[x.size :]
            (result,) = Reader(False, read_again=True).run(traced.jaxpr, traced.consts, inputs)
            return [jnp.asarray(entry, result.dtype) for entry in entries_of(result).flat]

        scalars = [entry for x in arguments for entry in in_a_row(x)]
        return cls(jax.make_jaxpr(on_scalars)(scalars))

    def __call__(self, scalars: list[Scalar]) -> list[Scalar]:
        """The entries of the result."""
        return core.jaxpr_as_fun(self._closed)(*scalars)

    def derivative(self, scalars: list[Scalar], direction: list[Scalar]) -> list[Scalar]:
        """The derivatives of the entries along a direction."""
        return jax.jvp(lambda *x: self(x), tuple(scalars), tuple(direction))[1]

    def partial(self, i: int, scalars: list[Scalar]) -> list[Scalar]:
        """The derivatives of the entries in the i-th scalar."""
        x = scalars[i]
        return jax.jvp(lambda x: self([*scalars[:i], x, *scalars[i + 1 :]]), (x,), (jnp.ones_like(x),))[1]

    def partials(self, scalars: list[Scalar], count: int) -> list[list[Scalar]]:
        """The derivatives in each of the first `count` scalars."""
        return [self.partial(i, scalars) for i in range(count)]

    def given(self, scalars: list[Scalar]) -> "Program":
        """The program of the remaining arguments, the first ones given: what depends on these alone is computed now."""
        program, values = self._closed.jaxpr, list(self._closed.consts)
        known = [*program.constvars, *program.invars[: len(scalars)]]
        found, now, later = set(known), [], []
        for step in program.eqns:
            if all(isinstance(v, core.Literal) or v in found for v in step.invars) and not step.effects:
                now.append(step)
                found.update(step.outvars)
            else:
                later.append(step)
        needed = [v for step in later for v in step.invars] + program.outvars
        carried = list(dict.fromkeys(v for v in needed if not isinstance(v, core.Literal) and v in found))
        first = program.replace(constvars=[], invars=known, outvars=carried, eqns=now)
        rest = program.replace(constvars=carried, invars=program.invars[len(scalars) :], eqns=later)
        carried = core.jaxpr_as_fun(core.ClosedJaxpr(first, []))(*values, *scalars)
        return Program(core.ClosedJaxpr(rest, carried))
