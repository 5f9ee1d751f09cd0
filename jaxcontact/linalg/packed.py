"""A few numbers and truth values of a batch in as few loops as can be.

XLA:CPU makes a loop of every array that a program returns, and computes in each what they have in common; a vector put
together at the end of a loop stops it from being vectorised. So truth values are returned as the bits of one whole
number, and real numbers two by two as a complex one.
"""

import math
from collections.abc import Callable
from typing import Any

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

        def some(kind: bool, first: int, count: int) -> Callable:
            """Entries of all results of a kind, in their order, as one number."""

            def program(*arguments):
                results = jax.tree.leaves(function(*arguments))
                entries = [
                    x[i] for x, truth in zip(results, truths, strict=True) if truth == kind for i in np.ndindex(x.shape)
                ][first : first + count]
                if not kind:
                    return as_one(entries)
                return sum((jnp.where(x, 1 << k, 0) for k, x in enumerate(entries)), jnp.int32(0))

            return walled(fused(program))

        def all_of(kind: bool, each: int) -> list:
            total = sum(math.prod(x.shape) for x, truth in zip(shapes, truths, strict=True) if truth == kind)
            found: list[Any] = []
            for first in range(0, total, each):
                count = min(each, total - first)
                number = some(kind, first, count)(*arguments)
                found += [(number >> k) & 1 == 1 for k in range(count)] if kind else list(from_one(number))
            return found

        numbers, flags = iter(all_of(False, 2)), iter(all_of(True, BITS))
        results = [_gathered(flags if truth else numbers, x) for x, truth in zip(shapes, truths, strict=True)]
        return jax.tree.unflatten(structure, results)

    return apart


def _gathered(entries, like):
    """The next entries as an array of that shape."""
    taken = [next(entries) for _ in range(math.prod(like.shape))]
    return jnp.stack(taken).reshape(like.shape) if taken else jnp.zeros(like.shape, like.dtype)
