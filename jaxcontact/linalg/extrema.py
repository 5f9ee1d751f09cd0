"""Largest and smallest entries, NaN if one entry is; and whether all are finite.

On a CPU XLA's own reductions drop NaN once they are vectorised (openxla/xla issue 21461), so that what is to fail on
NaN would pass in a large batch. Whether an entry is NaN is therefore asked apart.
"""

import functools

import jax
import jax.numpy as jnp
from jax import lax


def greatest(x: jax.Array, axis: int | None = None, *, initial: float | None = None) -> jax.Array:
    """The largest entry along `axis` (all entries by default); `initial` counts as one more entry.

    Raises ValueError for no entries and no `initial`.

    >>> greatest(jnp.array([1.0, jnp.nan]))     # nan
    """
    return _with_nan(x, axis, _extreme(x, axis, initial, lax.reduce_max, lax.max))


def least(x: jax.Array, axis: int | None = None, *, initial: float | None = None) -> jax.Array:
    """The smallest entry, as `greatest`."""
    return _with_nan(x, axis, _extreme(x, axis, initial, lax.reduce_min, lax.min))


def all_finite(*arrays: jax.Array) -> jax.Array:
    """bool: no entry of the arrays is infinite or NaN.

    >>> all_finite(jnp.ones(2), jnp.array(jnp.inf))     # False
    """
    return functools.reduce(lax.bitwise_and, [lax.reduce_and(lax.is_finite(x), _axes(x, None)) for x in arrays])


def _extreme(x, axis, initial, reduce, better):
    if not x.size and initial is None:
        raise ValueError(f"no entry of an array of shape {x.shape} is the largest or smallest one: give `initial`")
    found = reduce(x, _axes(x, axis))
    return found if initial is None else better(found, lax.full_like(found, initial))


def _with_nan(x, axis, found):
    if not jnp.issubdtype(x.dtype, jnp.floating):
        return found
    return lax.select(lax.reduce_or(lax.ne(x, x), _axes(x, axis)), lax.full_like(found, jnp.nan), found)


def _axes(x, axis) -> tuple[int, ...]:
    return tuple(range(x.ndim)) if axis is None else (axis % x.ndim,)
