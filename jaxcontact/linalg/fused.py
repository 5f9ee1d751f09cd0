"""A function rewritten as a program on scalars: small arrays resolved, zeros and ones folded, nothing computed twice.

What is written with vectors and matrices and derived by autodiff is full of structure that XLA does not see: stacking
and indexing, products with entries that are zero whatever the numbers are, the same sine in five places. Here the
program of a function is read once, while it is traced, with every small array kept as its separate entries. The
structure falls away, and what is left fuses into one loop over a batch and compiles in a fraction of the time.

A product with a structural zero is zero. Not so where the other factor comes from a division, a root or a logarithm
that was not shielded by `shield`: there 0 * inf must stay NaN, and such factors are kept track of as wild.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact.linalg.batches import walled
from jaxcontact.linalg.reader import Reader
from jaxcontact.linalg.scalar_rules import Entries, entries_of, whole
from jaxcontact.linalg.survey import is_cut, pays

PAIRED_LIMIT = 4
"""Up to this many numbers are returned two by two; more would repeat too much of what they have in common."""


def fused(function: Callable, *, final: bool = False) -> Callable:
    """`function` as a program on scalars: the same values, to rounding, and the same derivatives.

    A program with loops, branches or library routines in it, or one that is too long, is left as it is. In a batch sine
    and cosine are those of `circular`. With `final` up to PAIRED_LIMIT numbers are computed two by two, in one loop
    over a batch for each pair: a value with a derivative costs one loop, not the ten that XLA makes of two results.

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
        if not pays(program.jaxpr, final):
            return function(*arguments)
        known = _milestones(program, leaves) if final and is_cut(program.jaxpr, final) else ()
        if final and _are_few_numbers(program.out_avals):
            results = _in_pairs(program, leaves, known)
        else:
            results = Reader(final, known).run(program.jaxpr, program.consts, leaves)
        return jax.tree.unflatten(returned[-1], [whole(x) for x in results])

    return rewritten


def _are_few_numbers(results) -> bool:
    """Whether the results are several real numbers of one precision, not more than are worth a program for each two."""
    real = {x.dtype for x in results if jnp.issubdtype(x.dtype, jnp.floating)}
    return len(real) == 1 == len({x.dtype for x in results}) and 1 < sum(x.size for x in results) <= PAIRED_LIMIT


def _in_pairs(program, leaves, known: Sequence = ()) -> list[Entries]:
    """The results of a program, two entries at a time, each pair by a program of its own; `known` its milestones."""

    def pair(first):
        def computed(leaves, constants, known):
            results = Reader(True, known).run(program.jaxpr, constants, leaves)
            flat = [(entry, x.dtype) for x in map(entries_of, results) for entry in x.flat]
            return as_one([jnp.asarray(*entry) for entry in flat[first : first + 2]])

        return list(from_one(walled(jax.jit(computed))(list(leaves), list(program.consts), list(known))))

    flat = [entry for first in range(0, sum(x.size for x in program.out_avals), 2) for entry in pair(first)]
    ends = np.cumsum([x.size for x in program.out_avals])
    return [Entries(x.shape, x.dtype, flat[end - x.size : end]) for x, end in zip(program.out_avals, ends)]


def _milestones(program, leaves, known: Sequence = ()) -> list:
    """The milestones of a program in their order, two at a time, each pair from those `known` before."""
    met = []

    def computed(leaves, constants, known):
        reader = Reader(True, known)
        reader.run(program.jaxpr, constants, leaves)
        met.append(len(reader.milestones))
        return as_one(reader.milestones[len(known) : len(known) + 2])

    pair = from_one(walled(jax.jit(computed))(list(leaves), list(program.consts), list(known)))
    known = [*known, *pair]
    return known if len(known) == met[-1] else _milestones(program, leaves, known)


def as_one(entries: list) -> Any:
    """One or two real scalars as one number, so that a program has one result and stays one loop over a batch.

    >>> from_one(as_one([jnp.ones(()), jnp.zeros(())]))     # (1, 0)
    """
    return entries[0] if len(entries) == 1 else lax.complex(*entries)


def from_one(number: jax.Array) -> jax.Array:
    """(…, 1) or (…, 2) what `as_one` packed."""
    if not jnp.issubdtype(number.dtype, jnp.complexfloating):
        return number[..., None]
    return jnp.stack([jnp.real(number), jnp.imag(number)], axis=-1)
