"""Is this state one the theory speaks of? Looked at once, on plain values, at the door of `delassus`."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from .records import State

OFF_CONSTRAINT = 0.5
"""A gap counts as open beyond eps**OFF_CONSTRAINT times what its terms may add up to: half the digits."""


class Energy(NamedTuple):
    """In what the kinetic energy is no quadratic form of the velocities; zeros if it is one."""

    at_rest: Array
    """J"""
    uneven: Array
    """J, T(v) - T(-v) at v = (1, 2, ...), zero up to half the digits"""


def energy_of(mechanism: Any, q: Array) -> Energy:
    """`Energy` of a mechanism at a place; zeros where the mass matrix is given instead.

    `energy_of(guides, guides.state(theta=0.9).q).at_rest`
    """
    if hasattr(mechanism, "mass_matrix"):
        return Energy(jnp.zeros((), q.dtype), jnp.zeros((), q.dtype))
    v = jnp.arange(1, len(q) + 1, dtype=q.dtype)
    energy = jax.jit(lambda v: mechanism.kinetic_energy(q, v))  # traced once
    at_rest, there, back = map(energy, (jnp.zeros_like(q), v, -v))
    beyond = lax.abs(there - back) > float(jnp.finfo(q.dtype).eps) ** 0.5 * (lax.abs(there) + lax.abs(back))
    return Energy(at_rest, linalg.where(beyond, there - back, 0))


def refuse_unsound(mechanism: Any, state: State, operators: Any, energy: Energy) -> None:
    """Raise ValueError for a state or a mechanism outside the theory: what came, what was expected, what to write."""
    owner = type(mechanism).__name__
    parts = jax.tree.map(np.asarray, operators.terms)
    _refuse_nan(owner, mechanism, state)
    if abs(float(energy.at_rest)) > 0:
        raise ValueError(
            f"{owner}: kinetic_energy must vanish at v = 0, got {float(energy.at_rest)}; "
            "put terms without velocity into potential_energy or applied_force"
        )
    if abs(float(energy.uneven)) > 0:
        raise ValueError(
            f"{owner}: kinetic_energy must be quadratic in v, got T(v) - T(-v) = {float(energy.uneven)} at "
            "v = (1, 2, ...); write forces that are linear in v into applied_force"
        )
    if not np.isfinite(parts.M).all() or not np.isfinite(np.asarray(operators.L)).all():
        raise ValueError(
            f"{owner}: the mass matrix at q = {np.asarray(state.q)} is not positive definite:\n{parts.M}\n"
            "check the signs of masses and inertias, and that every coordinate carries mass"
        )
    _refuse_undefined(owner, mechanism, parts)
    _refuse_open(owner, mechanism, parts, state)


def _refuse_nan(owner: str, mechanism: Any, state: State) -> None:
    for path, leaf in jax.tree_util.tree_leaves_with_path((mechanism, state)):
        if not np.isfinite(np.asarray(leaf)).all():
            name = jax.tree_util.keystr(path[1:]).lstrip(".")
            whose = owner if path[0].idx == 0 else "state"
            raise ValueError(f"{whose}.{name} is {np.asarray(leaf)}: expected finite numbers")


def _refuse_undefined(owner: str, mechanism: Any, parts: Any) -> None:
    for k, contact in enumerate(mechanism.contacts):
        if not np.isfinite(parts.G[:, k]).all():
            raise ValueError(f"{owner}: the gradient of the gap of contact {contact.name!r} is {parts.G[:, k]}")
        if not np.isfinite(parts.H[:, k]).all():
            raise ValueError(
                f"{owner}: the sliding direction of contact {contact.name!r} is undefined at this velocity "
                f"({parts.H[:, k]}); give the state a velocity with a slip"
            )


@jax.jit  # at the door it is called with plain arrays
def closed_and_kept(parts: Any, state: State) -> tuple[Array, Array]:
    """(m,), (m,) bool: the gap is closed; it stays so. Both within half the digits of what its terms may add up to."""
    share = float(jnp.finfo(parts.gap.dtype).eps) ** OFF_CONSTRAINT
    steep = jnp.sum(lax.abs(parts.G), axis=0)
    closed = lax.abs(parts.gap) <= share * steep * linalg.greatest(lax.abs(state.q), initial=0)
    return closed, lax.abs(parts.gap_rate) <= share * steep * linalg.greatest(lax.abs(state.v), initial=0)


def _refuse_open(owner: str, mechanism: Any, parts: Any, state: State) -> None:
    closed, kept = closed_and_kept(parts, state)
    for k, contact in enumerate(mechanism.contacts):
        if not closed[k]:
            raise ValueError(
                f"{owner}: contact {contact.name!r} is not closed at this state, its gap is {parts.gap[k]:.3g} m; "
                f"take the state from {owner}.state(...), or leave an open contact out"
            )
        if not kept[k]:
            raise ValueError(
                f"{owner}: contact {contact.name!r} opens or closes at {parts.gap_rate[k]:.3g} m/s; a persistent "
                "contact needs velocities along the constraints"
            )
