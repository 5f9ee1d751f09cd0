"""The door for numbers: which arrays come in, which are turned away, and whether a value can be looked at."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

WORKING_DTYPES = ("float32", "float64")


def as_float_array(name: str, x: Any) -> Array:
    """`x` as a float32 or float64 array; integers become the default float.

    Raises:
        TypeError: for half precision and complex numbers.
        ValueError: for float64 data while JAX runs without 64-bit floats: they would be rounded in silence.
    """
    if isinstance(x, np.ndarray | np.generic) and x.dtype == np.float64 and not jax.config.jax_enable_x64:
        raise ValueError(
            f"{name} is float64 but JAX runs without 64-bit floats and would round it: "
            f'write jax.config.update("jax_enable_x64", True) first, or pass {name}.astype("float32")'
        )
    x = jnp.asarray(x)
    if jnp.issubdtype(x.dtype, jnp.integer) or x.dtype == jnp.bool_:
        return x.astype(float)
    if x.dtype.name not in WORKING_DTYPES:
        raise TypeError(f"{name} has dtype {x.dtype}; jaxcontact works in {' and '.join(WORKING_DTYPES)}")
    return x


def is_concrete(tree: Any) -> bool:
    """True if every leaf of `tree` has a value that Python may look at (no leaf is being traced)."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))
