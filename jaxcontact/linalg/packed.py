"""A few numbers and truth values of a batch in as few loops as can be.

XLA:CPU makes a loop of every array that a program returns, and computes in each what they have in common; a vector put
together at the end of a loop stops it from being vectorised. So truth values are returned as the bits of one whole
number, and real numbers two by two as a complex one.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxcontact.linalg.batches import walled
from jaxcontact.linalg.fused import as_one, from_one
from jaxcontact.linalg.lanes import columns_of, read_batch
from jaxcontact.linalg.scalar_rules import Entries
from jaxcontact.linalg.tracing import Traced
from jaxcontact.linalg.unrolled import total

BITS = 31
"""Truth values that one whole number holds."""


def packed(function: Callable) -> Callable:
    """`function`, of small arrays, whose few results are truth values and real numbers of one dtype; under vmap as a
    program on scalars that returns a number for each two real ones and for each BITS truth values, behind a wall. One
    problem by itself, where there are no loops to save, takes the function as it is. Not to be differentiated.

    >>> largest, whole = packed(lambda x: (jnp.abs(x).max(), jnp.isfinite(x)))(jnp.ones(3))
    """

    def apart(*arguments):
        traced = Traced.of(function, *arguments)

        @custom_vmap
        def one(*arguments):
            return traced.run(*arguments)

        @one.def_vmap
        def _(size, batched, *arguments):
            flags = jax.tree.leaves(batched)
            axes = jax.tree.map(lambda b: 0 if b else None, tuple(batched))

            def in_few_numbers(*arguments):
                results = read_batch(traced.program, size, jax.tree.leaves(arguments), flags, final=True)
                if results is None:
                    results = jax.tree.leaves(jax.vmap(traced.run, axes, axis_size=size)(*arguments))
                return _packed(results, size)

            results = _unpacked(walled(in_few_numbers)(*arguments), traced.shapes, size)
            return results, jax.tree.map(lambda _: True, traced.shapes)

        return one(*arguments)

    return apart


def _packed(results: Sequence[Entries | jax.Array], size: int) -> dict[str, list[jax.Array]]:
    """By dtype, all entries of the results of a batch, several as one number for each lane."""
    found: dict = {}
    for x in results:
        entries = x.flat if isinstance(x, Entries) else columns_of(x).flat
        found.setdefault(x.dtype.name, []).extend(e if np.ndim(e) else lax.broadcast(e, (size,)) for e in entries)
    return {kind: _numbers(entries) for kind, entries in found.items()}


def _unpacked(numbers: dict[str, list[jax.Array]], shapes: Any, size: int) -> Any:
    """The results again, of these shapes, with the lanes in front."""
    rows, used = {kind: _rows(x, kind, size) for kind, x in numbers.items()}, dict.fromkeys(numbers, 0)
    leaves, structure = jax.tree.flatten(shapes)
    results = []
    for x in leaves:
        kind = x.dtype.name
        first, used[kind] = used[kind], used[kind] + math.prod(x.shape)
        results.append(rows[kind][:, first : used[kind]].reshape(size, *x.shape))
    return jax.tree.unflatten(structure, results)


def _numbers(entries: list[jax.Array]) -> list[jax.Array]:
    """Entries of one dtype, several as one number."""
    join, each = (_bits, BITS) if entries and entries[0].dtype == np.bool_ else (as_one, 2)
    return [join(entries[first : first + each]) for first in range(0, len(entries), each)]


def _bits(truths: list[jax.Array]) -> jax.Array:
    """Truth values as the bits of an int32."""
    none = lax.full(truths[0].shape, np.int32(0))
    return total([lax.select(x, lax.full_like(none, 1 << k), none) for k, x in enumerate(truths)])


def _rows(numbers: list[jax.Array], kind: str, size: int) -> jax.Array:
    """(size, k) the entries again; after the last truth value there may be some more."""

    places = np.arange(BITS, dtype=np.int32)[None]
    of_bits = kind == np.dtype(bool).name
    parts = [(x[:, None] >> places) & 1 == 1 if of_bits else from_one(x) for x in numbers]
    return jnp.concatenate([jnp.zeros((size, 0), kind), *parts], axis=1)
