"""What may not matter to contact forces, and what must not pass in silence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import tables
from scenes import Stated, random_scenes
from test_contact_examples import Bead

import jaxcontact as jc
from jaxcontact import native
from jaxcontact.complementarity import Status
from jaxcontact.contact import contact_forces, solutions
from jaxcontact.mechanisms import FlexiblePainleveKlein, GuidedRod, GuidedRodUnderCeiling, PainleveRod

ROD = PainleveRod()
SLIDING = ROD.state(theta=0.8, speed=-1.0)
U, B = jc.Contact("u", "unilateral"), jc.Contact("b", "bilateral")


@pytest.mark.parametrize(
    ("mu", "message"),
    [
        ([np.nan], r"mu\[0\] = nan at contact 'floor'"),
        ([-0.1], r"mu\[0\] = -0.1"),
        ([np.inf], "finite"),
        ([0.1, 0.2], r"shape \(1,\), got shape \(2,\)"),
        (0.1, "one entry per contact"),
        (None, "'floor' is frictional"),
    ],
)
def test_impossible_friction_is_refused(mu, message):
    with pytest.raises(ValueError, match=message):
        contact_forces(ROD, SLIDING, mu)


def test_impossible_states_and_masses_are_refused():
    off = jc.State(SLIDING.q + 0.1, SLIDING.v)
    with pytest.raises(ValueError, match="not closed"):
        contact_forces(ROD, off, [0.1])
    with pytest.raises(ValueError, match="finite"):
        contact_forces(ROD, jc.State(SLIDING.q * jnp.nan, SLIDING.v), [0.1])
    with pytest.raises(ValueError, match="not positive definite"):
        contact_forces(Bead(mass=-1.0), Bead().state())
    with pytest.raises(TypeError, match="method"):
        contact_forces(ROD, SLIDING, [0.1], "Lemke")
    with pytest.raises(TypeError, match="State"):
        contact_forces(ROD, (SLIDING.q, SLIDING.v), [0.1])


def test_a_negative_mass_along_a_constraint_is_no_mass():
    """Held in y, the bead would move well with any mass in y; a negative one is refused all the same."""
    status = jax.jit(lambda light: contact_forces(Bead(light=light), Bead().state()).status)
    assert [int(status(light)) for light in (-1.0, 0.0, 1.0)] == [Status.BAD_INPUT, Status.REDUNDANT, Status.REDUNDANT]


def test_slips_and_signs_that_say_nothing():
    at_rest = contact_forces(ROD, ROD.state(theta=0.8), [0.1])
    assert at_rest.status == Status.STICKING
    assert np.isnan(at_rest.normal).all()
    assert contact_forces(ROD, ROD.state(theta=0.8), [0.0]).status == Status.SOLVED
    # The tip at rest while the centre moves: the slip is the rounding of 0.36 - 0.36.
    turning = ROD.state(theta=0.8, speed=-0.5 * np.sin(0.8), thetadot=1.0)
    assert contact_forces(ROD, turning, [0.1]).status == Status.STICKING
    here = jc.delassus(ROD, SLIDING)
    for xi in ([0.0], [np.nan], [0.5]):
        with pytest.raises(ValueError, match="-1 or 1"):
            solutions(here, [0.1], xi)
    with pytest.raises(ValueError, match="xi is None"):
        solutions(here, [0.1])


def test_friction_where_there_is_none_is_ignored():
    rod = GuidedRodUnderCeiling(guide_pull=2.0, ceiling_pull=1.0, guide_frictional=False)
    state = rod.state(theta=0.7, speed=1.0)
    plain, poisoned = (contact_forces(rod, state, [other, 0.2]) for other in (0.0, np.nan))
    np.testing.assert_array_equal(plain.normal, poisoned.normal)
    here = jc.delassus(rod, state)
    xi = jnp.array([np.nan, 1.0])
    np.testing.assert_array_equal(
        solutions(here, [np.nan, 0.2], xi).normal[-1], solutions(here, [0.0, 0.2], xi).normal[-1]
    )


def test_batch_loop_and_jit_agree():
    """Bit by bit is not promised: programs are fused differently. 16 eps of forces of size ten."""
    rod = PainleveRod()
    theta, mu = jnp.linspace(0.2, 1.4, 5), jnp.linspace(0.1, 2.5, 5)

    def one(theta, mu):
        return contact_forces(rod, rod.state(theta=theta, speed=-1.0), mu[None])

    batch = jax.jit(jax.vmap(one))(theta, mu)
    loop = [one(t, k) for t, k in zip(theta, mu, strict=True)]
    for field in ("normal", "acceleration", "status"):
        rows = np.stack([getattr(answer, field) for answer in loop])
        np.testing.assert_allclose(getattr(batch, field), rows, rtol=1e-14, atol=4e-14)
    assert Status.SOLVED in batch.status
    assert Status.INFEASIBLE in batch.status
    nothing = jax.vmap(one)(theta[:0], mu[:0])
    assert nothing.normal.shape == (0, 1)


def immovable(contact, c):
    """A free mass and a contact that no motion affects, a zero row of the Jacobian."""
    scene = Stated(
        jnp.eye(2), -jnp.ones(2), jnp.zeros((2, 1)), jnp.zeros((2, 1)), jnp.array([c]), jnp.ones(1), (contact,)
    )
    return contact_forces(scene, scene.state())


@pytest.mark.parametrize(
    ("contact", "c", "status"),
    [
        (U, 1.0, Status.SOLVED),
        (U, -1.0, Status.INFEASIBLE),
        (B, 0.0, Status.REDUNDANT),
        (B, 1.0, Status.INFEASIBLE),
    ],
)
def test_a_contact_that_moves_nothing(contact, c, status):
    forces = immovable(contact, c)
    assert forces.status == status
    np.testing.assert_array_equal(forces.acceleration, np.full(2, 1.0 if forces.answered else np.nan))


def test_float32_all_the_way():
    guides = FlexiblePainleveKlein(stiffness=20.0, free_gap=0.3)
    state = guides.state(theta=0.8, d=0.5, speed=2.0, thetadot=0.4)
    known = tables()["state_flexible"]
    single = jc.State(state.q.astype(jnp.float32), state.v.astype(jnp.float32))
    forces = contact_forces(guides, single, jnp.array([0.2, 0.3], jnp.float32))
    assert forces.normal.dtype == forces.acceleration.dtype == jnp.float32
    assert forces.status == Status.SOLVED
    np.testing.assert_allclose(forces.normal, known["lambda_nb"], rtol=2e-6)  # 16 eps
    np.testing.assert_allclose(forces.acceleration, known["qddot"], rtol=2e-6, atol=2e-6)


def test_masses_and_units_of_any_size():
    """Forces scale with mass, accelerations do not; a coordinate in other units, or a mass ratio of 1e8, changes
    nothing but rounding."""
    contacts = (jc.Contact("u0", "unilateral", True), jc.Contact("u1", "unilateral"))
    scenes, mu = random_scenes(contacts, 40, n=3, seed=5)
    mu = 0.2 * mu

    @jax.jit
    @jax.vmap
    def answer(scene, mu):
        return contact_forces(scene, scene.state(), mu)

    def rescaled(unit, mass):
        rows, square = jnp.asarray(unit)[None, :, None], jnp.outer(jnp.asarray(unit), jnp.asarray(unit))[None]
        return Stated(
            M=mass * scenes.M * square,
            F=mass * scenes.F * rows[..., 0],
            G=scenes.G * rows,
            H=scenes.H * rows,
            c=scenes.c,
            slip=scenes.slip,
            contacts=contacts,
        )

    plain = answer(scenes, mu)
    solved = np.asarray(plain.status) == Status.SOLVED
    assert solved.mean() > 0.8
    for unit, mass in (([1.0, 1.0, 1.0], 1e30), ([1.0, 1.0, 1.0], 1e-30), ([1e-4, 1.0, 1e4], 1.0)):
        other = answer(rescaled(unit, mass), mu)
        assert (other.status == plain.status).all()
        np.testing.assert_allclose(other.normal[solved] / mass, plain.normal[solved], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(
            (other.acceleration * jnp.asarray(unit)[None])[solved], plain.acceleration[solved], rtol=1e-9, atol=1e-9
        )  # conditions to 1e4


def compiled(mechanism, state, mu):
    return jax.jit(lambda m, s, k: contact_forces(m, s, k)).lower(mechanism, state, mu).compile().as_text()


def test_a_scene_pays_for_what_it_holds_only():
    """No loop where a linear solve is enough, and more operations the more a scene holds, all of them in JAX."""
    plain, rough = GuidedRod(frictional=False), GuidedRod()
    state, mu = rough.state(theta=0.8, speed=1.0), jnp.array([0.1])
    with native.unused():
        linear, absolute = compiled(plain, state, mu), compiled(rough, state, mu)
    assert " while(" not in linear
    assert linear.count(" = ") < absolute.count(" = ")
