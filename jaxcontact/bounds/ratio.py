"""The ratio of friction coefficients, mu = r * ratio, as every bound takes it."""

import jax.numpy as jnp
import numpy as np
from jax import Array

from ..dynamics import Contact
from ..dynamics.numbers import as_float_array, is_concrete


def ratio_of(contacts: tuple[Contact, ...], ratio: Array | None, dtype) -> Array:
    """(m,) ratio with ones where none is given and zeros at frictionless contacts, whatever was written there.

    Raises:
        ValueError: if it has another length than `contacts`, or, seen eagerly, a negative or non-finite entry at a
            frictional contact. Inside a trace such an entry becomes NaN.
    """
    m = len(contacts)
    rough = np.array([contact.frictional for contact in contacts], bool)
    if ratio is None:
        return jnp.asarray(rough, dtype)
    ratio = as_float_array("ratio", ratio)
    if ratio.shape != (m,):
        raise ValueError(f"ratio must have one entry per contact, shape ({m},), got shape {ratio.shape}")
    if is_concrete(ratio):
        _refuse(contacts, np.asarray(ratio), rough)
    sound = (ratio >= 0) & (ratio < jnp.inf)
    return jnp.where(rough, jnp.where(sound, ratio, jnp.nan), 0.0).astype(dtype)


def _refuse(contacts: tuple[Contact, ...], ratio: np.ndarray, rough: np.ndarray) -> None:
    wrong = rough & ~((ratio >= 0) & np.isfinite(ratio))
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(f"ratio must be finite and not negative, got {ratio[k]} at contact {contacts[k].name!r}")
