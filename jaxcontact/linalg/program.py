"""A function of a few vectors as a program on scalars, traced once and then evaluated and differentiated many times."""

from collections.abc import Callable, Sequence
from functools import cached_property

import jax
import numpy as np
from jax.extend import core

from jaxcontact.linalg.reader import Reader
from jaxcontact.linalg.scalar_rules import Entries, entries_of
from jaxcontact.linalg.survey import of_all_inputs
from jaxcontact.linalg.unrolled import Scalar, in_a_row


class Program:
    """What a function computes, on scalars: the entries of its arguments in, the entries of its one result out.

    Its Python runs once. Zeros, ones and repetitions fall away before it is differentiated and again where its scalars
    are constants, of numpy, so that the derivative along a unit vector costs what depends on that one scalar.

    >>> Program.of(lambda x: x * x, x).partials(in_a_row(x), 1)  # [[2 * x[0], 0]]
    """

    def __init__(self, program: core.Jaxpr, known: Sequence):
        """`known`: the values of the first inputs."""
        self._program, self._known = program, known

    @classmethod
    def of(cls, function: Callable, *arguments: jax.Array) -> "Program":
        """The program of function(*arguments)."""
        traced = jax.make_jaxpr(function)(*arguments)

        def on_scalars(*scalars):
            rest, inputs = list(scalars), []
            for x in arguments:
                inputs.append(Entries(x.shape, x.dtype, rest[: x.size]))
                rest = rest[x.size :]
            (result,) = Reader(False).run(traced.jaxpr, traced.consts, inputs)
            return entries_of(result).flat

        return cls._traced(on_scalars, [entry for x in arguments for entry in in_a_row(x)])

    @classmethod
    def _traced(cls, function: Callable, scalars: Sequence) -> "Program":
        traced = jax.make_jaxpr(function)(*scalars)
        return cls(of_all_inputs(traced), traced.consts)

    @property
    def _inputs(self) -> list[jax.ShapeDtypeStruct]:
        return [jax.ShapeDtypeStruct((), v.aval.dtype) for v in self._program.invars[len(self._known) :]]

    def __call__(self, scalars: list[Scalar]) -> list[Scalar]:
        """The entries of the result."""
        return self.at([scalars])[0]

    def at(self, points: list[list[Scalar]]) -> list[list[Scalar]]:
        """The entries of the result at several points; what these have in common is computed once."""
        reader = Reader(False)
        results = [reader.run(self._program, [], [*self._known, *map(_entry, point)]) for point in points]
        return [[entries_of(x).flat[0] for x in result] for result in results]

    @cached_property
    def derivative(self) -> "Program":
        """The program that takes scalars and a direction to the derivatives of the entries."""
        count = len(self._inputs)

        def along(*both):
            return jax.jvp(lambda *x: self(x), both[:count], both[count:])[1]

        return self._traced(along, self._inputs * 2)

    def gradient(self, first: int) -> "Program":
        """The program of the derivatives of the one entry in the scalars from the `first` on."""

        def slopes(*scalars):
            return [slope for (slope,) in self.derivative.given(scalars).at(units(self._inputs)[first:])]

        return self._traced(slopes, self._inputs)

    def partials(self, scalars: list[Scalar], count: int) -> list[list[Scalar]]:
        """The derivatives in each of the first `count` scalars."""
        return self.derivative.given(scalars).at(units(scalars)[:count])

    def given(self, scalars: list[Scalar]) -> "Program":
        """The program of the remaining arguments, the first ones given: what depends on these alone is computed now."""
        program = self._program
        values = [*self._known, *map(_entry, scalars)]
        known, unknown = program.invars[: len(values)], program.invars[len(values) :]
        found, now, later = set(known), [], []
        for step in program.eqns:
            if all(isinstance(v, core.Literal) or v in found for v in step.invars) and not step.effects:
                now.append(step)
                found.update(step.outvars)
            else:
                later.append(step)
        needed = [v for step in later for v in step.invars] + program.outvars
        carried = list(dict.fromkeys(v for v in needed if not isinstance(v, core.Literal) and v in found))
        first = program.replace(invars=known, outvars=carried, eqns=now)
        rest = program.replace(invars=[*carried, *unknown], eqns=later)
        return Program(rest, Reader(False).run(first, [], values))


def units(scalars: list[Scalar]) -> list[list[np.generic]]:
    """The unit vectors of as many numbers, as constants."""
    return [list(row) for row in np.eye(len(scalars), dtype=scalars[0].dtype)] if scalars else []


def _entry(x: Scalar) -> Entries:
    """A scalar for the reader; one of numpy is a constant."""
    return Entries((), x.dtype, [x])
