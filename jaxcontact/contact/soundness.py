"""Is this a state that contact problems are about? In a trace the answer is a status, eagerly an exception."""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..dynamics import Contact, State, Terms
from ..dynamics.sound import closed_and_kept


def is_sound(contacts: tuple[Contact, ...], parts: Terms, state: State, mu: Array) -> Array:
    """bool: all numbers are finite, the coefficients of friction are possible, and every gap is closed and stays so."""
    numbers = (parts.M, parts.F, parts.G, parts.H, parts.c, parts.slip, parts.gap, parts.gap_rate, state.q, state.v, mu)
    row = jnp.concatenate([lax.reshape(x, (x.size,)) for x in numbers])  # one question, not eleven
    closed, kept = closed_and_kept(parts, state)
    return linalg.all_finite(row) & jnp.all(closed & kept)


def without_idle_directions(parts: Terms, idle: Array) -> Terms:
    """The terms with zero sliding directions at `idle` (m,) contacts, where friction does not act: a direction may be
    undefined there."""
    return replace(parts, H=linalg.where(idle[None, :], 0, parts.H), slip=linalg.where(idle, 0, parts.slip))


def harmless(parts: Terms, sound: Array) -> Terms:
    """The terms where sound; elsewhere those of free unit masses, so that no NaN enters the arithmetic that follows."""
    zero = {name: linalg.where(sound, value, 0) for name, value in vars(parts).items()}
    return replace(parts, **zero | {"M": linalg.where(sound, parts.M, jnp.eye(*parts.M.shape, dtype=parts.M.dtype))})
