"""Largest and smallest entries, NaN if one entry is.

On a CPU XLA's own reductions drop NaN once they are vectorised (openxla/xla issue 21461), so that what is to fail on
NaN would pass in a large batch. Whether an entry is NaN is therefore asked apart.
"""

import jax
import jax.numpy as jnp


def greatest(x: jax.Array, axis: int | None = None, *, initial: float | None = None) -> jax.Array:
    """The largest entry along `axis` (all entries by default); `initial` counts as one more entry.

    Raises ValueError for no entries and no `initial`.

    >>> greatest(jnp.array([1.0, jnp.nan]))     # nan
    """
    return _with_nan(x, axis, jnp.max(x, axis=axis, initial=initial))


def least(x: jax.Array, axis: int | None = None, *, initial: float | None = None) -> jax.Array:
    """The smallest entry, as `greatest`."""
    return _with_nan(x, axis, jnp.min(x, axis=axis, initial=initial))


def _with_nan(x, axis, found):
    if not jnp.issubdtype(x.dtype, jnp.floating):
        return found
    return jnp.where(jnp.any(jnp.isnan(x), axis=axis), jnp.nan, found)
