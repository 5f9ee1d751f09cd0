"""Derivatives of contact forces: against closed forms, central differences and one-sided derivatives at a kink."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_contact_examples import Bead

from jaxcontact.complementarity import Status
from jaxcontact.contact import contact_forces
from jaxcontact.mechanisms import FlexiblePainleveKlein, PainleveRod

THETA = 0.8
S, C = np.sin(THETA), np.cos(THETA)


def rod_force(length, mu, gravity=9.81, thetadot=1.5):
    """The force on the tip of a rod that slides to the left."""
    rod = PainleveRod(length=length, gravity=gravity)
    speed = -2.0 - 0.5 * length * S * thetadot  # the tip itself at 2 m/s
    return contact_forces(rod, rod.state(theta=THETA, speed=speed, thetadot=thetadot), mu[None]).normal[0]


def rod_closed_form(length, mu, gravity=9.81, thetadot=1.5):
    """(59): lambda = (g - l/2 theta'^2 s) / (1 + 3 c^2 - 3 mu s c)."""
    return (gravity - 0.5 * length * thetadot**2 * S) / (1 + 3 * C**2 - 3 * mu * S * C)


def test_first_and_second_derivatives_of_a_force():
    """Geometry, friction, load and velocity; forward, reverse, forward over reverse; mapped over friction."""
    arguments = (jnp.asarray(1.2), jnp.asarray(0.4), jnp.asarray(9.81), jnp.asarray(1.5))
    every = (0, 1, 2, 3)
    expected = jax.grad(rod_closed_form, every)(*arguments)
    np.testing.assert_allclose(jax.jit(jax.jacfwd(rod_force, every))(*arguments), expected, rtol=1e-12)
    frictions = jnp.linspace(0.0, 1.2, 7)
    mapped = jax.jit(jax.vmap(jax.grad(rod_force, (0, 1)), (None, 0)))(1.2, frictions)
    np.testing.assert_allclose(
        mapped, jax.vmap(jax.grad(rod_closed_form, (0, 1)), (None, 0))(1.2, frictions), rtol=1e-12
    )
    second = jax.jit(jax.hessian(rod_force, (0, 1)))(*arguments)
    np.testing.assert_allclose(
        np.array(second), np.array(jax.hessian(rod_closed_form, (0, 1))(*arguments)), rtol=1e-11, atol=1e-12
    )


def test_two_rough_guides_against_central_differences():
    """All forces and accelerations of the telescoping rod by length, stiffness, friction, gravity and angular rate."""

    def answer(x):
        guides = FlexiblePainleveKlein(length=x[0], stiffness=x[1], free_gap=0.3, gravity=x[4])
        state = guides.state(theta=THETA, d=0.5, speed=2.0, thetadot=x[5])
        forces = contact_forces(guides, state, x[2:4])
        return jnp.concatenate([forces.normal, forces.tangential, forces.acceleration])

    at, step = jnp.array([1.0, 20.0, 0.2, 0.3, 9.81, 0.4]), 1e-5
    rows = at[None] + step * jnp.concatenate([jnp.eye(6), -jnp.eye(6)])
    values = jax.jit(jax.vmap(answer))(rows)
    differences = (values[:6] - values[6:]).T / (2 * step)
    slopes = jax.jit(jax.jacfwd(answer))(at)  # reverse mode: the tests above
    # Truncation step^2 and cancellation eps / step, times derivatives of size 50.
    np.testing.assert_allclose(slopes, differences, rtol=1e-7, atol=1e-8)


def test_at_a_kink_the_derivative_lies_between_the_one_sided_ones():
    """A frictionless tip about to lift off: lambda = max(0, g - l/2 theta'^2 s) / (1 + 3 c^2) at zero, by length."""
    rate = float(np.sqrt(2 * 9.81 / S))

    def force(length):
        rod = PainleveRod(length=length, frictional=False)
        forces = contact_forces(rod, rod.state(theta=THETA, thetadot=rate))
        return forces.normal[0], forces

    (forward, forces), (reverse, _) = jax.jacfwd(force, has_aux=True)(1.0), jax.grad(force, has_aux=True)(1.0)
    pressed, lifted = -0.5 * rate**2 * S / (1 + 3 * C**2), 0.0
    assert forces.degenerate == 1
    assert forces.normal[0] == 0
    assert pressed < forward < lifted
    assert forward == reverse
    sides = [float(jax.grad(lambda length: force(length)[0])(1.0 + step)) for step in (-1e-6, 1e-6)]
    np.testing.assert_allclose(sides, [pressed, lifted], rtol=1e-12)


def test_no_lane_spoils_the_gradient_of_another():
    """Lanes without solution, without slip, with impossible friction, off the floor; one shared length."""
    lanes = {  # speed of the centre, mu, height above the floor, expected status
        "good": (-2.0, 0.4, 0.0, Status.SOLVED),
        "stuck": (0.0, 0.4, 0.0, Status.STICKING),
        "painlevé": (-2.0, 3.0, 0.0, Status.INFEASIBLE),
        "negative": (-2.0, -0.4, 0.0, Status.BAD_INPUT),
        "nan": (-2.0, np.nan, 0.0, Status.BAD_INPUT),
        "above": (-2.0, 0.4, 0.1, Status.BAD_INPUT),
        "no velocity": (np.nan, 0.4, 0.0, Status.BAD_INPUT),
    }
    speed, mu, height, expected = map(np.array, zip(*lanes.values(), strict=True))

    def total(length, speed, mu, height):
        rod = PainleveRod(length=length)

        def one(speed, mu, height):
            state = rod.state(theta=THETA, speed=speed)
            lifted = type(state)(state.q + height * jnp.array([0.0, 1.0, 0.0]), state.v)
            return contact_forces(rod, lifted, mu[None])

        forces = jax.vmap(one)(speed, mu, height)
        return jnp.sum(jnp.where(forces.answered[:, None], forces.acceleration, 0.0)), forces

    gradient, forces = jax.jit(jax.grad(total, has_aux=True))(1.2, *map(jnp.asarray, (speed, mu, height)))
    assert forces.status.tolist() == expected.tolist()
    assert (np.isnan(forces.normal[:, 0]) == (expected != Status.SOLVED)).all()
    assert (np.isnan(forces.residual) == (expected != Status.SOLVED)).all()
    # theta'' = -6 (c - mu s) lambda / l and y'' = lambda - g with lambda = g / (1 + 3 c^2 - 3 mu s c), m = 1
    push = 9.81 / (1 + 3 * C**2 - 3 * 0.4 * S * C)
    np.testing.assert_allclose(gradient, 6 * (C - 0.4 * S) * push / 1.2**2, rtol=1e-12)


@pytest.mark.parametrize("light", [0.0, 1.0])
def test_of_redundant_contacts_what_is_determined_has_its_derivative(light):
    """a_x = 3 / m and G lambda = 4 whatever the masses."""

    def determined(bead):
        forces = contact_forces(bead, bead.state())
        return jnp.stack([*forces.acceleration, forces.normal[0] + 2 * forces.normal[1]]), forces.status

    (slopes, status) = jax.jit(jax.jacrev(determined, has_aux=True))(Bead(light=light))
    assert status == Status.REDUNDANT
    np.testing.assert_allclose(slopes.mass, [-0.75, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(slopes.light, [0.0, 0.0, 0.0], atol=1e-12)
