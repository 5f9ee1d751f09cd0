"""The terms of the contact dynamics, stated by the mechanism or derived from its energies, gaps and slips.

Equation (1a) of the tutorial with the sign of `F` used there:  M(q) a + F(q, v, t) = G lambda_n + H lambda_t.

Derivatives are taken coordinate by coordinate, on separate scalars: a `jvp` in one scalar with the others closed over
leaves only scalars behind, which XLA fuses over a batch; a one-hot basis pushed through `vmap` (`jacfwd`, `hessian`)
would stay in the program as a small batch axis and cost ten times more.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

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
    gaps = _gaps(mechanism)
    _, gap_rate = jax.jvp(gaps, (q, t), (v, jnp.ones_like(t)))
    return Terms(
        M=_mass_matrix(mechanism, q, v),
        F=_bias(mechanism, q, v, t, state.at_rest),
        G=_gap_gradients(mechanism, q, t),
        H=_slip_directions(mechanism, q, v),
        c=_gap_curvature(mechanism, q, v, t, state.at_rest),
        slip=_slip(mechanism, q, v),
        gap=gaps(q, t),
        gap_rate=gap_rate,
    )


def _mass_matrix(mechanism, q: Array, v: Array) -> Array:
    """M = d^2 T / dv dv, one nested jvp per pair of coordinates; the lower triangle is the upper one mirrored."""
    if hasattr(mechanism, "mass_matrix"):
        n = q.shape[0]
        return _shaped(mechanism, "mass_matrix", mechanism.mass_matrix(q), (n, n))
    n = q.shape[0]
    energy = _of_scalars(lambda u: _shaped(mechanism, "kinetic_energy", mechanism.kinetic_energy(q, u), ()))
    velocities = [v[i] for i in range(n)]
    entry = {(i, j): _partial(_partial(energy, i), j)(*velocities) for i in range(n) for j in range(i, n)}
    return jnp.stack([jnp.stack([entry[min(i, j), max(i, j)] for j in range(n)]) for i in range(n)])


def _bias(mechanism, q: Array, v: Array, t: Array, at_rest: bool) -> Array:
    """F = d/dt(dT/dv) - dT/dq + dV/dq - Q at zero acceleration; at rest only dV/dq - Q is left, T being quadratic in
    v."""
    n = q.shape[0]
    if hasattr(mechanism, "bias"):
        return _shaped(mechanism, "bias", mechanism.bias(q, v, t), (n,))
    bias = jnp.zeros_like(q)
    if not at_rest:
        bias = bias + _inertial_bias(mechanism, q, v)
    if hasattr(mechanism, "potential_energy"):
        energy = _of_scalars(lambda p: _shaped(mechanism, "potential_energy", mechanism.potential_energy(p), ()))
        bias = bias + _gradient(energy, q)
    if hasattr(mechanism, "applied_force"):
        bias = bias - _shaped(mechanism, "applied_force", mechanism.applied_force(q, v, t), (n,))
    return bias


def _inertial_bias(mechanism, q: Array, v: Array) -> Array:
    """d/dt (dT/dv_i) along q' = v, minus dT/dq_i: Coriolis and centrifugal terms."""
    energy = _kinetic_energy(mechanism)
    momentum = [_partial_of_second(energy, i) for i in range(q.shape[0])]
    rate = jnp.stack([jax.jvp(lambda p, i=i: momentum[i](p, v), (q,), (v,))[1] for i in range(q.shape[0])])
    return rate - _gradient(_of_scalars(lambda p: energy(p, v)), q)


def _gap_gradients(mechanism, q: Array, t: Array) -> Array:
    if hasattr(mechanism, "gap_gradients"):
        return _shaped(mechanism, "gap_gradients", mechanism.gap_gradients(q), (q.shape[0], len(mechanism.contacts)))
    gaps = _gaps(mechanism)
    return _gradient(_of_scalars(lambda p: gaps(p, t)), q)


def _gap_curvature(mechanism, q: Array, v: Array, t: Array, at_rest: bool) -> Array:
    """c = d^2/ds^2 h(q + s v, t + s) at s = 0: zero at rest unless the constraint is driven."""
    contacts = len(mechanism.contacts)
    if hasattr(mechanism, "gap_curvature"):
        return _shaped(mechanism, "gap_curvature", mechanism.gap_curvature(q, v), (contacts,))
    if at_rest and not _driven(mechanism):
        return jnp.zeros((contacts,), q.dtype)
    gaps, direction = _gaps(mechanism), (v, jnp.ones_like(t))
    return jax.jvp(lambda p, s: jax.jvp(gaps, (p, s), direction)[1], (q, t), direction)[1]


def _slip_directions(mechanism, q: Array, v: Array) -> Array:
    """H = (d slips / d v)^T with the columns of frictionless contacts zero, whatever `slips` says there."""
    n, contacts = q.shape[0], mechanism.contacts
    if not any(contact.frictional for contact in contacts):
        return jnp.zeros((n, len(contacts)), q.dtype)
    if hasattr(mechanism, "slip_directions"):
        H = _shaped(mechanism, "slip_directions", mechanism.slip_directions(q), (n, len(contacts)))
    else:
        H = _gradient(_of_scalars(lambda u: _slips(mechanism, q, u)), v)
    return jnp.stack([_where_frictional(contacts, H[i]) for i in range(n)])


def _slip(mechanism, q: Array, v: Array) -> Array:
    if not any(contact.frictional for contact in mechanism.contacts):
        return jnp.zeros((len(mechanism.contacts),), q.dtype)
    return _where_frictional(mechanism.contacts, _slips(mechanism, q, v))


def _where_frictional(contacts, row: Array) -> Array:
    zero = jnp.zeros((), row.dtype)
    return jnp.stack([row[k] if contact.frictional else zero for k, contact in enumerate(contacts)])


def _kinetic_energy(mechanism) -> Callable:
    if hasattr(mechanism, "mass_matrix"):
        return lambda q, v: 0.5 * jnp.sum(v * jnp.sum(mechanism.mass_matrix(q) * v[None, :], axis=1))
    return mechanism.kinetic_energy


def _gaps(mechanism) -> Callable[[Array, Array], Array]:
    """The gaps as a function of (q, t), whether they are driven or not."""
    shape = (len(mechanism.contacts),)
    if _driven(mechanism):
        return lambda q, t: _shaped(mechanism, "gaps", mechanism.gaps(q, t), shape)
    return lambda q, t: _shaped(mechanism, "gaps", mechanism.gaps(q), shape)


def _slips(mechanism, q: Array, v: Array) -> Array:
    return _shaped(mechanism, "slips", mechanism.slips(q, v), (len(mechanism.contacts),))


def _driven(mechanism) -> bool:
    return len(inspect.signature(mechanism.gaps).parameters) > 1


def _of_scalars(function: Callable[[Array], Array]) -> Callable[..., Array]:
    """A function of a vector as a function of its components."""
    return lambda *components: function(jnp.stack(components))


def _partial(function: Callable[..., Array], i: int) -> Callable[..., Array]:
    """Derivative of a function of scalars in its i-th argument, the others closed over."""

    def derivative(*components):
        def along(x):
            return function(*components[:i], x, *components[i + 1 :])

        return jax.jvp(along, (components[i],), (jnp.ones_like(components[i]),))[1]

    return derivative


def _partial_of_second(function: Callable, i: int) -> Callable:
    """Derivative of a function (q, v) in the i-th component of v."""

    def derivative(q, v):
        components = [v[k] for k in range(v.shape[0])]
        return _partial(_of_scalars(lambda u: function(q, u)), i)(*components)

    return derivative


def _gradient(function: Callable[..., Array], x: Array) -> Array:
    """Rows of partial derivatives: (n,) of a scalar function, (n, m) of a vector function."""
    components = [x[i] for i in range(x.shape[0])]
    return jnp.stack([_partial(function, i)(*components) for i in range(x.shape[0])])


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
