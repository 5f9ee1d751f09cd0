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

from jaxcontact.linalg.batches import walled
from jaxcontact.linalg.fused import as_one, from_one, fused

BITS = 31
"""Truth values that one whole number holds."""


def packed(function: Callable) -> Callable:
    """`function`, of small arrays, whose few results are truth values and real numbers of one dtype, as a program on
    scalars for each two numbers and each BITS truth values. Behind a wall; not to be differentiated.

    >>> largest, whole = packed(lambda x: (jnp.abs(x).max(), jnp.isfinite(x)))(jnp.ones(3))
    """
    function = jax.jit(function)  # traced once for all programs

    def apart(*arguments):
        shapes, structure = jax.tree.flatten(jax.eval_shape(function, *arguments))
        truths = [x.dtype == bool for x in shapes]
        rows = {kind: _row(function, truths, kind, shapes, arguments) for kind in set(truths)}
        results, used = [], dict.fromkeys(rows, 0)
        for x, truth in zip(shapes, truths, strict=True):
            size = math.prod(x.shape)
            results.append(rows[truth][used[truth] : used[truth] + size].reshape(x.shape))
            used[truth] += size
        return jax.tree.unflatten(structure, results)

    return apart


def _row(function: Callable, truths: list[bool], truth: bool, shapes: list, arguments: tuple) -> jax.Array:
    """All entries of the results that are truth values, or of those that are not, one after the other."""

    def numbered(first: int, count: int) -> Callable:
        """So many entries as one number."""

        def program(*arguments):
            results = zip(jax.tree.leaves(function(*arguments)), truths, strict=True)
            entries = [x[i] for x, kind in results if kind == truth for i in np.ndindex(x.shape)]
            entries = entries[first : first + count]
            if not truth:
                return as_one(entries)
            return sum((jnp.where(x, 1 << k, 0) for k, x in enumerate(entries)), jnp.int32(0))

        return walled(fused(program))

    def taken_apart(number: jax.Array, count: int) -> jax.Array:
        return (number[None] >> jnp.arange(count, dtype=jnp.int32)) & 1 == 1 if truth else from_one(number)

    kept = [x for x, kind in zip(shapes, truths, strict=True) if kind == truth]
    total, each = sum(math.prod(x.shape) for x in kept), BITS if truth else 2
    counts = [(first, min(each, total - first)) for first in range(0, total, each)]
    parts = [taken_apart(numbered(first, count)(*arguments), count) for first, count in counts]
    return jnp.concatenate([jnp.zeros(0, kept[0].dtype), *parts])
