"""A function rewritten as a program on scalars: small arrays resolved, zeros and ones folded, nothing computed twice.

What is written with vectors and matrices and derived by autodiff is full of structure that XLA does not see: stacking
and indexing, products with entries that are zero whatever the numbers are, the same sine in five places. Here the
program of a function is read once, while it is traced, with every small array kept as its separate entries. The
structure falls away, and what is left fuses into one loop over a batch and compiles in a fraction of the time.

A product with a structural zero is zero. Not so where the other factor comes from a division, a root or a logarithm
that was not shielded by `shield`: there 0 * inf must stay NaN, and such factors are kept track of as wild.
"""

import itertools
from collections.abc import Callable
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core

from jaxcontact.linalg.batches import walled
from jaxcontact.linalg.circular import has_polynomials
from jaxcontact.linalg.scalar_rules import (
    ELEMENTWISE,
    FOLD,
    KNOWN,
    PARTS,
    POLYNOMIALS,
    REDUCTIONS,
    SHIELDED,
    STRUCTURE,
    Entries,
    entries_of,
    identity,
    is_shield,
    is_shield_call,
    literal,
    may_be_infinite,
    places,
    screened,
    whole,
)

ENTRIES_LIMIT = 128
"""Arrays with more entries than this stay whole."""

PAIRED_LIMIT = 4
"""Up to this many numbers are returned two by two; more would repeat too much of what they have in common."""

LENGTH_LIMIT = 2**13
"""A longer program on scalars takes too long to compile."""


def fused(function: Callable, *, final: bool = False) -> Callable:
    """`function` as a program on scalars: the same values, to rounding, and the same derivatives.

    A program with loops, branches or library routines in it, or one that is too long, is left as it is. Sine and cosine
    are those of `circular`. With `final` up to PAIRED_LIMIT numbers are computed two by two, in one loop over a batch
    for each pair: a value with a derivative costs one loop, not the ten that XLA makes of two results.

    Args:
        final: nothing is differentiated any more, so custom rules are opened as well. For the outermost function under
            jit(vmap(...)); take derivatives inside.

    >>> jax.jit(jax.vmap(fused(lambda x: jnp.stack([x, 0 * x]) @ jnp.stack([x, x]))))
    """

    def rewritten(*arguments):
        leaves, structure = jax.tree.flatten(arguments)
        returned = []

        def flattened(*leaves):
            results, tree = jax.tree.flatten(function(*jax.tree.unflatten(structure, leaves)))
            returned.append(tree)
            return results

        program = jax.make_jaxpr(flattened)(*leaves)
        reader = _Reader(final)
        if not reader.pays(program.jaxpr):
            return function(*arguments)
        if final and _are_few_numbers(program.out_avals):
            results = _in_pairs(program, leaves)
        else:
            results = reader.run(program.jaxpr, program.consts, leaves)
        return jax.tree.unflatten(returned[-1], [whole(x) for x in results])

    return rewritten


def _are_few_numbers(results) -> bool:
    """Whether the results are several real numbers of one precision, not more than are worth a program for each two."""
    real = {x.dtype for x in results if jnp.issubdtype(x.dtype, jnp.floating)}
    return len(real) == 1 == len({x.dtype for x in results}) and 1 < sum(x.size for x in results) <= PAIRED_LIMIT


def _in_pairs(program, leaves) -> list[Entries]:
    """The results of a program, two entries at a time, each pair by a program of its own."""

    def pair(first):
        def computed(leaves, constants):
            results = _Reader(True).run(program.jaxpr, constants, leaves)
            flat = [(entry, x.dtype) for x in map(entries_of, results) for entry in x.flat]
            return as_one([jnp.asarray(*entry) for entry in flat[first : first + 2]])

        return list(from_one(walled(computed)(list(leaves), list(program.consts))))

    flat = [entry for first in range(0, sum(x.size for x in program.out_avals), 2) for entry in pair(first)]
    ends = np.cumsum([x.size for x in program.out_avals])
    return [Entries(x.shape, x.dtype, flat[end - x.size : end]) for x, end in zip(program.out_avals, ends)]


def as_one(entries: list) -> Any:
    """One or two real scalars as one number, so that a program has one result and stays one loop over a batch.

    >>> from_one(as_one([jnp.ones(()), jnp.zeros(())]))     # (1, 0)
    """
    return entries[0] if len(entries) == 1 else lax.complex(*entries)


def from_one(number: jax.Array) -> jax.Array:
    """(1,) or (2,) what `as_one` packed."""
    if not jnp.issubdtype(number.dtype, jnp.complexfloating):
        return number[None]
    return jnp.stack([jnp.real(number), jnp.imag(number)])


class _Reader:
    """Reads a program step by step; `known` remembers what has been computed, by operation and operands."""

    def __init__(self, final: bool):
        self.final = final
        self.known: dict = {}
        self.wild: set[int] = set()
        self.parts: dict = {}

    def pays(self, program) -> bool:
        """Whether the program is made of operations that are taken apart, and few enough of them."""
        return self._length(program) <= LENGTH_LIMIT

    def _length(self, program) -> float:
        return sum(self._length_of(step) for step in program.eqns)

    def _length_of(self, step) -> float:
        inner = self._opened(step)
        if inner is not None:
            return self._length(inner.jaxpr)
        size = sum(v.aval.size for v in step.outvars)
        scalar = max(v.aval.size for v in (*step.invars, *step.outvars)) <= 1
        plain = scalar and not list(core.jaxprs_in_params(step.params))
        return size if plain or step.primitive.name in KNOWN else np.inf

    def run(self, program, constants, arguments) -> list:
        values = dict(zip(program.constvars, constants, strict=True))
        values |= dict(zip(program.invars, arguments, strict=True))
        for step in program.eqns:
            inputs = [literal(v) if isinstance(v, core.Literal) else values[v] for v in step.invars]
            values |= dict(zip(step.outvars, self.apply(program, step, inputs), strict=True))
        return [literal(v) if isinstance(v, core.Literal) else values[v] for v in program.outvars]

    def apply(self, program, step, inputs: list) -> list:
        name, params = step.primitive.name, step.params
        inner = self._opened(step)
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
        results = _as_it_stands(program, step, inputs)
        if not is_shield_call(step):
            self.wild |= {id(x) for x in results}
        return results

    def _opened(self, step):
        """The program inside a call that may be read through, else None."""
        if step.primitive.name in ("jit", "pjit"):
            return step.params["jaxpr"]
        if self.final and step.primitive.name == "custom_jvp_call":
            return step.params["call_jaxpr"]
        return None

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
        wild = any(id(x) in self.wild for x in operands)
        folded = None if wild else FOLD.get(primitive.name, lambda *_: None)(*operands)
        if folded is not None:
            return folded
        key = (primitive.name, str(params or {}), *map(identity, operands))
        if key not in self.known:
            # The operands are kept with the result: as long as they live, their identities are theirs alone.
            result = self._bind(primitive, params, operands)
            self.known[key] = (result, operands)
            if (wild or may_be_infinite(primitive.name, params, operands)) and not is_shield(primitive.name, operands):
                self.wild.add(id(result))
        return self.known[key][0]

    def _bind(self, primitive, params: dict | None, operands) -> Any:
        if params is None:
            return {lax.mul_p: lax.mul, lax.add_p: lax.add}[primitive](*operands)
        if self.final and primitive.name in POLYNOMIALS and has_polynomials(operands[0].dtype):
            return POLYNOMIALS[primitive.name](jnp.asarray(operands[0]))
        if primitive.name in SHIELDED and jnp.issubdtype(jnp.result_type(operands[0]), jnp.floating):
            return screened(primitive.bind(*operands, **params)) if self.final else SHIELDED[primitive.name](*operands)
        return primitive.bind(*operands, **params)


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
