"""Reads a traced program step by step, every small array as its separate entries; see `fused`."""

import itertools
from collections.abc import Sequence
from functools import reduce
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core

from jaxcontact.linalg.scalar_rules import (
    ELEMENTWISE,
    FOLD,
    PARTS,
    REDUCTIONS,
    STRUCTURE,
    Entries,
    entries_of,
    identity,
    is_milestone,
    is_shield,
    literal,
    may_be_infinite,
    places,
    whole,
)
from jaxcontact.linalg.screens import screen
from jaxcontact.linalg.shielded import SHIELDED
from jaxcontact.linalg.survey import ENTRIES_LIMIT, opened
from jaxcontact.linalg.unrolled import milestone


class Reader:
    """Reads a program step by step; `known` remembers what has been computed, by operation and operands.

    The values of the first milestones may be `given`. With `lanes` a scalar of a program that is taken apart throughout
    may be one number for each of as many lanes.
    """

    def __init__(self, final: bool, given: Sequence = (), *, lanes: int | None = None):
        self.final = final
        self.given = given
        self.lanes = lanes
        self.milestones: list = []
        self.known: dict = {}
        self.wild: set[int] = set()
        self.parts: dict = {}

    def run(self, program, constants, arguments) -> list:
        values = dict(zip(program.constvars, constants, strict=True))
        values |= dict(zip(program.invars, arguments, strict=True))
        for step in _used(program):
            inputs = [literal(v) if isinstance(v, core.Literal) else values[v] for v in step.invars]
            values |= dict(zip(step.outvars, self.apply(program, step, inputs), strict=True))
        return [literal(v) if isinstance(v, core.Literal) else values[v] for v in program.outvars]

    def apply(self, program, step, inputs: list) -> list:
        name, params = step.primitive.name, step.params
        if name in ELEMENTWISE and not any(v.aval.shape for v in (*step.invars, *step.outvars)):
            operands = [self._entries(x).flat[0] for x in inputs]
            return [Entries((), step.outvars[0].aval.dtype, [self._scalar(step.primitive, params, operands)])]
        if is_milestone(step):
            return [Entries((), step.outvars[0].aval.dtype, [self._milestone(self._entries(inputs[0]).flat[0])])]
        inner = opened(step, self.final)
        if inner is not None:
            return self.run(inner.jaxpr, inner.consts, inputs)
        small = all(var.aval.size <= ENTRIES_LIMIT for var in (*step.invars, *step.outvars) if hasattr(var, "aval"))
        if small and name in STRUCTURE:
            parts = [self._entries(x) for x in inputs]
            return [STRUCTURE[name](step.outvars[0].aval, params, *parts)]
        if small and name in PARTS:
            return PARTS[name]([v.aval for v in step.outvars], params, self._entries(inputs[0]))
        if small and name in ELEMENTWISE:
            return [self._elementwise(step, [self._entries(x) for x in inputs])]
        if small and name in REDUCTIONS and (step.invars[0].aval.size or name == "reduce_sum"):
            return [self._reduced(step, self._entries(inputs[0]))]
        if small and name == "cumsum":
            return [self._summed_up(step, self._entries(inputs[0]))]
        if small and name == "dot_general" and not params["dimension_numbers"][1][0]:
            return [self._dot(step, *map(self._entries, inputs))]
        if small and name == "custom_jvp_call":
            # From the entries again, so that each argument is taken apart once, and its cotangents add up as scalars.
            inputs = [self._entries(x) for x in inputs]
        results = _as_it_stands(program, step, inputs)
        self.wild |= {id(x) for x in results}
        return results

    def _entries(self, x) -> Entries:
        """The entries of an array, the same ones each time; those of a wild array are wild."""
        if isinstance(x, Entries):
            return x
        if id(x) not in self.parts:
            taken = entries_of(x)
            self.parts[id(x)] = (taken, x)
            if id(x) in self.wild:
                self.wild |= {id(entry) for entry in taken.flat}
        return self.parts[id(x)][0]

    def _elementwise(self, step, operands: list[Entries]) -> Entries:
        aval = step.outvars[0].aval
        spread = [[x.flat[i] for i in np.broadcast_to(places(x), aval.shape).flat] for x in operands]
        flat = [self._scalar(step.primitive, step.params, row) for row in zip(*spread, strict=True)]
        return Entries(aval.shape, aval.dtype, flat)

    def _reduced(self, step, x: Entries) -> Entries:
        aval = step.outvars[0].aval
        kept = [a for a in range(len(x.shape)) if a not in step.params["axes"]]
        rows = _lines(x, kept, step.params["axes"])
        join = REDUCTIONS[step.primitive.name]
        if join is lax.add_p:
            return Entries(aval.shape, aval.dtype, [self._total([x.flat[i] for i in row], aval.dtype) for row in rows])
        joined = [reduce(lambda a, b: self._scalar(join, {}, (a, b)), [x.flat[i] for i in row]) for row in rows]
        return Entries(aval.shape, aval.dtype, joined)

    def _summed_up(self, step, x: Entries) -> Entries:
        """Running sums along an axis."""
        lines = np.moveaxis(places(x), step.params["axis"], 0)
        lines = lines[::-1] if step.params["reverse"] else lines
        flat = list(x.flat)
        for before, after in itertools.pairwise(lines):
            for i, j in zip(np.ravel(before), np.ravel(after), strict=True):
                flat[j] = self._scalar(lax.add_p, None, (flat[i], flat[j]))
        return Entries(x.shape, x.dtype, flat)

    def _dot(self, step, a: Entries, b: Entries) -> Entries:
        aval = step.outvars[0].aval
        (over_a, over_b), _ = step.params["dimension_numbers"]
        free_a = [k for k in range(len(a.shape)) if k not in over_a]
        free_b = [k for k in range(len(b.shape)) if k not in over_b]
        rows = _lines(a, free_a, over_a)
        columns = _lines(b, free_b, over_b)
        flat = [
            self._total([self._scalar(lax.mul_p, None, (a.flat[i], b.flat[j])) for i, j in zip(r, c)], aval.dtype)
            for r in rows
            for c in columns
        ]
        return Entries(aval.shape, aval.dtype, flat)

    def _total(self, terms: list, dtype) -> Any:
        result = np.zeros((), dtype)[()]
        for term in terms:
            result = self._scalar(lax.add_p, None, (result, term))
        return result

    def _scalar(self, primitive, params: dict | None, operands) -> Any:
        """One scalar operation: folded, remembered, or bound; without params, a product or sum of our own."""
        wild = bool(self.wild) and any(id(x) in self.wild for x in operands)
        if not wild and primitive.name in FOLD:
            folded = FOLD[primitive.name](*operands)
            if folded is not None:
                return folded
        key = (primitive.name, str(params) if params else "", *map(identity, operands))
        if key not in self.known:
            # The operands are kept with the result: as long as they live, their identities are theirs alone.
            result = self._bind(primitive, params, operands)
            self.known[key] = (result, operands)
            if (wild or may_be_infinite(primitive.name, params, operands)) and not is_shield(primitive.name, params):
                self.wild.add(id(result))
        return self.known[key][0]

    def _milestone(self, x) -> Any:
        """The same scalar: a given one, marked again for a later reader, or behind a shield where none follows."""
        key = (milestone.__name__, identity(x))
        if key not in self.known:
            number = len(self.milestones)
            given = number < len(self.given)
            result = self.given[number] if given else screen(x) if self.final else milestone(x)
            self.known[key] = (result, (x,))
            self.milestones.append(result)
        return self.known[key][0]

    def _bind(self, primitive, params: dict | None, operands) -> Any:
        if self.lanes is not None and any(map(np.ndim, operands)):
            operands = [x if np.ndim(x) else self._for_all_lanes(x) for x in operands]
        if params is None:
            return {lax.mul_p: lax.mul, lax.add_p: lax.add}[primitive](*operands)
        if primitive.name in SHIELDED and jnp.issubdtype(jnp.result_type(operands[0]), jnp.floating):
            return SHIELDED[primitive.name].bind(*operands)
        return primitive.bind(*operands, **params)

    def _for_all_lanes(self, x) -> Any:
        key = (lax.broadcast.__name__, identity(x))
        if key not in self.known:
            self.known[key] = (lax.broadcast(x, (self.lanes,)), (x,))
        return self.known[key][0]


def _used(program) -> list:
    """The steps whose results are used in the end, in their order; differentiation leaves many that are not."""
    needed = {v for v in program.outvars if not isinstance(v, core.Literal)}
    steps = []
    for step in reversed(program.eqns):
        if step.effects or not needed.isdisjoint(step.outvars):
            needed.update(v for v in step.invars if not isinstance(v, core.Literal))
            steps.append(step)
    return steps[::-1]


def _lines(x: Entries, kept, over) -> np.ndarray:
    """The places of the entries, one line of those that are summed for each that stays."""
    count = int(np.prod([x.shape[axis] for axis in kept], dtype=int))
    along = int(np.prod([x.shape[axis] for axis in over], dtype=int))
    return places(x).transpose(*kept, *over).reshape(count, along)


def _as_it_stands(program, step, inputs: list) -> list:
    """The results of a step that is not taken apart: its own little program, run on whole arrays."""
    operands = {v: whole(x) for v, x in zip(step.invars, inputs, strict=True) if not isinstance(v, core.Literal)}
    kept = [v for v in step.outvars if str(v) != "_"]
    alone = program.replace(constvars=[], invars=list(operands), outvars=kept, eqns=[step])
    results = dict(zip(kept, core.jaxpr_as_fun(core.ClosedJaxpr(alone, []))(*operands.values()), strict=True))
    return [results.get(v) for v in step.outvars]
