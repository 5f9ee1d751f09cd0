"""What sliding friction needs to know: coefficients, the sign of each slip, and whether there is one."""

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Contact, State, Terms
from ..dynamics.numbers import as_float_array, is_concrete

NO_SLIP = 0.5
"""A slip below eps**NO_SLIP times the speeds that make it up, |H|^T |v|, counts as zero: half its digits are lost."""


def coefficients(contacts: tuple[Contact, ...], mu, dtype) -> Array:
    """(m,) coefficients of friction in the order of the contacts, zero at frictionless ones whatever is written there.

    A coefficient that is negative or not finite becomes NaN, which the status reports.

    Raises:
        ValueError: another shape than (m,); seen eagerly, a coefficient that is negative or not finite; None although
            something is frictional.

    >>> coefficients(guides.contacts, [0.2, 0.3], jnp.float64)
    """
    m = len(contacts)
    rough = np.array([contact.frictional for contact in contacts], bool)
    if mu is None and not rough.any():
        return jnp.zeros((m,), dtype)
    if mu is None:
        raise ValueError(f"mu is None but {_names(contacts, rough)} is frictional: give one coefficient per contact")
    mu = as_float_array("mu", mu)
    if mu.shape != (m,):
        raise ValueError(
            f"mu must have one entry per contact, shape ({m},), got shape {mu.shape}; "
            f"for equal coefficients write jnp.full({m}, mu), for batches jax.vmap"
        )
    if is_concrete(mu):
        _refuse(contacts, np.asarray(mu), rough)
        return jnp.asarray(np.where(rough, mu, 0), dtype)  # nothing to compile
    sound = (mu >= 0) & (mu < jnp.inf)
    return linalg.where(rough, linalg.where(sound, mu, jnp.nan), 0.0).astype(dtype)


def signs(contacts: tuple[Contact, ...], xi, dtype) -> Array:
    """(m,) signs of the slips, zero at frictionless contacts whatever is written there.

    Raises:
        ValueError: another shape than (m,); seen eagerly, something else than -1 or 1 at a frictional contact.
    """
    m = len(contacts)
    rough = np.array([contact.frictional for contact in contacts], bool)
    xi = as_float_array("xi", xi)
    if xi.shape != (m,):
        raise ValueError(f"xi must have one entry per contact, shape ({m},), got shape {xi.shape}")
    if is_concrete(xi):
        if (rough & ~(np.abs(np.asarray(xi)) == 1)).any():
            raise ValueError(f"xi holds the signs of the slips, -1 or 1 at frictional contacts; got {xi}")
        return jnp.asarray(np.where(rough, xi, 0), dtype)
    return linalg.where(rough, linalg.where(lax.abs(xi) == 1, xi, jnp.nan), 0.0).astype(dtype)


def stands_still(contacts: tuple[Contact, ...], parts: Terms, state: State) -> Array:
    """(m,) bool: a frictional contact has no slip; with friction it sticks, and the sliding law says nothing there."""
    share = float(jnp.finfo(parts.slip.dtype).eps) ** NO_SLIP
    speed = jnp.sum(lax.abs(parts.H * state.v[:, None]), axis=0)
    rough = jnp.array([contact.frictional for contact in contacts], bool)
    # A direction that is undefined at rest has speed NaN, so the comparison is written for NaN to stand still.
    return rough & ~(lax.abs(parts.slip) > share * speed) & lax.is_finite(parts.slip)


def _refuse(contacts: tuple[Contact, ...], mu: np.ndarray, rough: np.ndarray) -> None:
    wrong = rough & ~((mu >= 0) & np.isfinite(mu))
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(f"mu must be finite and not negative, got mu[{k}] = {mu[k]} at contact {contacts[k].name!r}")


def _names(contacts: tuple[Contact, ...], rough: np.ndarray) -> str:
    return ", ".join(repr(contact.name) for contact, is_rough in zip(contacts, rough, strict=True) if is_rough)
