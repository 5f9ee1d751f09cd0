"""The terms of the contact dynamics, stated by the mechanism or derived from its energies, gaps and slips.

Equation (1a) of the tutorial with the sign of `F` used there:  M(q) a + F(q, v, t) = G lambda_n + H lambda_t.

What the mechanism states is traced once, as a program on scalars, which is then evaluated and differentiated as often
as needed. Derivatives are taken coordinate by coordinate: a `jvp` in one scalar with the others closed over leaves only
scalars behind, which XLA fuses over a batch; a one-hot basis pushed through `vmap` (`jacfwd`, `hessian`) would stay in
the program as a small batch axis and cost ten times more.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..linalg import fused
from ..linalg.program import Program, units
from ..linalg.rows import row_of
from ..linalg.unrolled import entries, in_a_row
from .records import State


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Terms:
    """The terms of (1a) and of the constraints on acceleration level, G^T a + c."""

    M: Array
    """(n, n) mass matrix, kg in translational coordinates."""
    F: Array
    """(n,) bias: inertial, potential and applied forces on the left-hand side, N or N m."""
    G: Array
    """(n, m) gradients of the gaps in columns."""
    H: Array
    """(n, m) tangential directions in columns; the columns of frictionless contacts are zero."""
    c: Array
    """(m,) second derivative of the gaps along the velocity, m/s^2."""
    slip: Array
    """(m,) tangential velocity, m/s; zero at frictionless contacts."""
    gap: Array
    """(m,) signed distances, m."""
    gap_rate: Array
    """(m,) time derivatives of the gaps, m/s."""


def terms(mechanism: Any, state: State) -> Terms:
    """The terms of (1a) at a state; whatever the mechanism states by hand replaces the derived term.

    Stated by hand they are `mass_matrix(q)`, `bias(q, v, t)` = F, `gap_gradients(q)` = G, `slip_directions(q)` = H and
    `gap_curvature(q, v)` = c. Derived: M from `kinetic_energy` (a quadratic form in v), F from the Euler-Lagrange
    equations with `potential_energy` and `applied_force`, G and c from `gaps`, H from `slips`.

    Example: `terms(guides, guides.state(theta=0.9)).M`.

    Raises:
        TypeError: if the mechanism states neither `kinetic_energy` nor `mass_matrix`, has no `gaps`, or is frictional
            without `slips`; if a function returns another shape than (m,) or (n,).
    """
    _check_methods(mechanism)
    q, v, t = state.q, state.v, jnp.asarray(state.t, dtype=state.q.dtype)
    at, moving = in_a_row(q), in_a_row(v)
    gaps = Program.of(_gaps(mechanism), q, t)
    place, motion = [*at, t], [*moving, jnp.ones_like(t)]
    energy = None if hasattr(mechanism, "mass_matrix") and state.at_rest else Program.of(_energy(mechanism), q, v)
    momentum = None if energy is None else energy.gradient(len(at))
    slip, H = _slip(mechanism, q, v)
    return Terms(
        M=_mass_matrix(mechanism, q, momentum),
        F=_bias(mechanism, q, v, t, None if state.at_rest else energy, momentum),
        G=_gap_gradients(mechanism, q, gaps, place),
        H=H,
        c=_gap_curvature(mechanism, q, v, state.at_rest, gaps, place, motion),
        slip=slip,
        gap=_row(gaps(place), q),
        gap_rate=_row(gaps.derivative(place + motion), q),
    )


def _mass_matrix(mechanism, q: Array, momentum: Program | None) -> Array:
    """M, whose i-th row is dT/dv at the i-th unit velocity, T being quadratic in v; the lower triangle is the upper one
    mirrored."""
    n = q.shape[0]
    if hasattr(mechanism, "mass_matrix"):
        return _stated(mechanism, "mass_matrix", (n, n), q)
    momenta = momentum.given(in_a_row(q)).at(units(in_a_row(q)))
    return _rows([[momenta[min(i, j)][max(i, j)] for j in range(n)] for i in range(n)], q)


def _bias(mechanism, q: Array, v: Array, t: Array, energy: Program | None, momentum: Program | None) -> Array:
    """F = d/dt(dT/dv) - dT/dq + dV/dq - Q at zero acceleration; at rest, where no T is given, only dV/dq - Q is left,
    T being quadratic in v."""
    n = q.shape[0]
    if hasattr(mechanism, "bias"):
        return _stated(mechanism, "bias", (n,), q, v, t)
    bias = jnp.zeros_like(q)
    if energy is not None:
        bias = bias + _inertial_bias(q, v, energy, momentum)
    if hasattr(mechanism, "potential_energy"):
        potential = Program.of(lambda p: _shaped(mechanism, "potential_energy", mechanism.potential_energy(p), ()), q)
        bias = bias + _row([slope for (slope,) in potential.partials(in_a_row(q), n)], q)
    if hasattr(mechanism, "applied_force"):
        bias = bias - _stated(mechanism, "applied_force", (n,), q, v, t)
    return bias


def _inertial_bias(q: Array, v: Array, energy: Program, momentum: Program) -> Array:
    """d/dt (dT/dv_i) along q' = v, minus dT/dq_i: Coriolis and centrifugal terms."""
    n, here, moving = q.shape[0], in_a_row(q) + in_a_row(v), in_a_row(v)
    rates = momentum.derivative(here + moving + [np.zeros((), q.dtype)[()]] * n)
    return _row([rate - slope for rate, (slope,) in zip(rates, energy.partials(here, n))], q)


def _gap_gradients(mechanism, q: Array, gaps: Program, place: list[Array]) -> Array:
    n = q.shape[0]
    if hasattr(mechanism, "gap_gradients"):
        return _stated(mechanism, "gap_gradients", (n, len(mechanism.contacts)), q)
    return _rows(gaps.partials(place, n), q)


def _gap_curvature(
    mechanism, q: Array, v: Array, at_rest: bool, gaps: Program, place: list[Array], motion: list[Array]
) -> Array:
    """c = d^2/ds^2 h(q + s v, t + s) at s = 0: zero at rest unless the constraint is driven."""
    contacts = len(mechanism.contacts)
    if hasattr(mechanism, "gap_curvature"):
        return _stated(mechanism, "gap_curvature", (contacts,), q, v)
    if at_rest and not _driven(mechanism):
        return jnp.zeros((contacts,), q.dtype)
    steady = [jnp.zeros_like(x) for x in motion]
    return _row(gaps.derivative.derivative(place + 2 * motion + steady), q)


def _slip(mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """(slip, H), H = (d slips / d v)^T; zero at frictionless contacts, whatever `slips` says there."""
    n, contacts = q.shape[0], mechanism.contacts
    if not any(contact.frictional for contact in contacts):
        return jnp.zeros((len(contacts),), q.dtype), jnp.zeros((n, len(contacts)), q.dtype)
    slips = Program.of(lambda q, v: _shaped(mechanism, "slips", mechanism.slips(q, v), (len(contacts),)), q, v)
    slips, moving = slips.given(in_a_row(q)), in_a_row(v)
    if hasattr(mechanism, "slip_directions"):
        H = entries(_stated(mechanism, "slip_directions", (n, len(contacts)), q))
    else:
        H = slips.partials(moving, n)
    return _row(_frictional(contacts, slips(moving)), q), _rows([_frictional(contacts, row) for row in H], q)


def _frictional(contacts, row: list[Array]) -> list[Array]:
    return [x if contact.frictional else jnp.zeros_like(x) for x, contact in zip(row, contacts)]


def _energy(mechanism) -> Callable[[Array, Array], Array]:
    """The kinetic energy as a function of (q, v)."""
    if hasattr(mechanism, "mass_matrix"):
        return lambda q, v: 0.5 * jnp.sum(v * jnp.sum(mechanism.mass_matrix(q) * v[None, :], axis=1))
    return lambda q, v: _shaped(mechanism, "kinetic_energy", mechanism.kinetic_energy(q, v), ())


def _gaps(mechanism) -> Callable[[Array, Array], Array]:
    """The gaps as a function of (q, t), whether they are driven or not."""
    shape = (len(mechanism.contacts),)
    if _driven(mechanism):
        return lambda q, t: _shaped(mechanism, "gaps", mechanism.gaps(q, t), shape)
    return lambda q, t: _shaped(mechanism, "gaps", mechanism.gaps(q), shape)


def _driven(mechanism) -> bool:
    return len(inspect.signature(mechanism.gaps).parameters) > 1


def _row(scalars: list[Array], like: Array) -> Array:
    return row_of(scalars) if scalars else jnp.zeros((0,), like.dtype)


def _rows(rows: list[list[Array]], like: Array) -> Array:
    return _row([x for row in rows for x in row], like).reshape(len(rows), -1 if rows and rows[0] else 0)


def _stated(mechanism, name: str, shape: tuple[int, ...], *arguments: Array) -> Array:
    """What the mechanism states by hand, as a program on scalars."""
    return _shaped(mechanism, name, fused(getattr(mechanism, name))(*arguments), shape)


def _shaped(mechanism, name: str, value: Any, shape: tuple[int, ...]) -> Array:
    value = jnp.asarray(value)
    if value.shape != shape:
        raise TypeError(f"{type(mechanism).__name__}.{name} must return shape {shape}, got {value.shape}")
    return value


def _check_methods(mechanism) -> None:
    owner = type(mechanism).__name__
    if not isinstance(getattr(mechanism, "contacts", None), tuple):
        raise TypeError(f"{owner} needs `contacts`, a tuple of jc.Contact (an empty one is allowed)")
    if not (hasattr(mechanism, "kinetic_energy") or hasattr(mechanism, "mass_matrix")):
        raise TypeError(f"{owner} states neither kinetic_energy(q, v) nor mass_matrix(q): one of them is needed")
    if not hasattr(mechanism, "gaps"):
        raise TypeError(f"{owner} has no gaps(q): return one signed distance per contact, in the order of `contacts`")
    if any(contact.frictional for contact in mechanism.contacts) and not hasattr(mechanism, "slips"):
        rough = ", ".join(repr(contact.name) for contact in mechanism.contacts if contact.frictional)
        raise TypeError(
            f"{owner} has frictional contacts ({rough}) and needs slips(q, v), one tangential velocity each"
        )
