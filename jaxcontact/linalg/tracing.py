"""What keeps tracing short."""

import functools
from collections.abc import Callable

import jax
from jax.interpreters.partial_eval import DynamicJaxprTracer


def traced_once(function: Callable) -> Callable:
    """`function` of scalars, whose steps are kept: to trace them again would take far longer.

    Only while a program is traced. Elsewhere the operations are run one by one: compiled together they may be
    contracted for one result and not for another, and an error that is carried along would not be that of the sum
    beside it.
    """
    kept = jax.jit(function, inline=True)

    @functools.wraps(function)
    def call(*scalars):
        traced = all(isinstance(x, DynamicJaxprTracer) for x in scalars)
        return (kept if traced else function)(*scalars)

    return call
