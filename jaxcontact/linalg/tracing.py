"""What keeps tracing short."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core
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


class Traced(NamedTuple):
    """A function as a program that is traced once, for arguments of the same shapes.

    Inside the rule of a batch JAX would trace a function again, even one under `jax.jit`.

    >>> Traced.of(lambda x: x + 1, jnp.zeros(3)).run(jnp.ones(3))     # twos
    """

    run: Callable
    """the function"""
    program: core.ClosedJaxpr
    shapes: Any
    """of the results"""

    @classmethod
    def of(cls, function: Callable, *arguments) -> "Traced":
        """The program of function(*arguments), in one step."""
        program, shapes = jax.make_jaxpr(jax.jit(function), return_shape=True)(*arguments)

        def run(*arguments):
            results = core.jaxpr_as_fun(program)(*jax.tree.leaves(arguments))
            return jax.tree.unflatten(jax.tree.structure(shapes), results)

        return cls(run, program, shapes)


def where(condition, x, y) -> jax.Array:
    """`jnp.where`, which would be a function of its own to trace for each new shape and dtype.

    >>> where(jnp.array([True, False]), jnp.ones(2), 0)     # [1, 0]
    """
    if not any(hasattr(a, "dtype") and not getattr(a, "weak_type", False) for a in (x, y)):
        return jnp.where(condition, x, y)  # of no dtype yet
    shape, dtype = np.broadcast_shapes(*map(np.shape, (condition, x, y))), jnp.result_type(x, y)

    def spread(a, dtype):
        a = lax.convert_element_type(a, dtype) if hasattr(a, "dtype") else np.asarray(a, dtype)
        return a if a.shape == shape else lax.broadcast_in_dim(a, shape, range(len(shape) - a.ndim, len(shape)))

    return lax.select(spread(condition, bool), spread(x, dtype), spread(y, dtype))
