"""A few numbers and truth values of a batch in as few loops as can be.

XLA:CPU makes a loop of every array that a program returns, and computes in each what they have in common; a vector put
together at the end of a loop stops it from being vectorised. So truth values are returned as the bits of one whole
number, and real numbers two by two as a complex one.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxcontact.linalg.batches import walled
from jaxcontact.linalg.fused import as_one, from_one, fused
from jaxcontact.linalg.unrolled import in_a_row, total

BITS = 31
"""Truth values that one whole number holds."""


def packed(function: Callable) -> Callable:
    """`function`, of small arrays, whose few results are truth values and real numbers of one dtype; under vmap as a
    program on scalars that returns a number for each two real ones and for each BITS truth values, behind a wall. One
    problem by itself, where there are no loops to save, takes the function as it is. Not to be differentiated.

    >>> largest, whole = packed(lambda x: (jnp.abs(x).max(), jnp.isfinite(x)))(jnp.ones(3))
    """
    function = jax.jit(function)  # traced once, for its shapes and for itself

    def apart(*arguments):
        shapes, structure = jax.tree.flatten(jax.eval_shape(function, *arguments))
        kinds = list(dict.fromkeys(x.dtype for x in shapes))

        def program(*arguments):
            results = jax.tree.leaves(function(*arguments))
            return [_numbers([x for x in results if x.dtype == kind]) for kind in kinds]

        numbers = walled(fused(program))(*arguments)
        rows, used = dict(zip(kinds, map(_row, numbers, kinds), strict=True)), dict.fromkeys(kinds, 0)
        results = []
        for x in shapes:
            first, used[x.dtype] = used[x.dtype], used[x.dtype] + math.prod(x.shape)
            results.append(rows[x.dtype][first : used[x.dtype]].reshape(x.shape))
        return jax.tree.unflatten(structure, results)

    @custom_vmap
    def one(*arguments):
        return function(*arguments)

    @one.def_vmap
    def _(size, batched, *arguments):
        axes = jax.tree.map(lambda b: 0 if b else None, tuple(batched))
        results = jax.vmap(apart, axes, axis_size=size)(*arguments)
        return results, jax.tree.map(lambda _: True, results)

    return one


def _numbers(results: list[jax.Array]) -> list[jax.Array]:
    """All entries of results of one dtype, one after the other, several as one number."""
    join, each = (_bits, BITS) if results[0].dtype == np.bool_ else (as_one, 2)
    entries = [entry for x in results for entry in in_a_row(x)]
    return [join(entries[first : first + each]) for first in range(0, len(entries), each)]


def _bits(truths: list[jax.Array]) -> jax.Array:
    """Truth values as the bits of an int32."""
    return total([lax.select(x, np.int32(1 << k), np.int32(0)) for k, x in enumerate(truths)])


def _row(numbers: list[jax.Array], kind: np.dtype) -> jax.Array:
    """The entries again; after the last truth value there may be some more."""

    def taken_apart(number):
        return (number[None] >> np.arange(BITS, dtype=np.int32)) & 1 == 1 if kind == np.bool_ else from_one(number)

    return jnp.concatenate([jnp.zeros(0, kind), *map(taken_apart, numbers)])
