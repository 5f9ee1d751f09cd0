"""Contact forces of the tutorial's examples, and of scenes with a closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import table, tables

import jaxcontact as jc
from jaxcontact.complementarity import Lemke, Status
from jaxcontact.contact import Multiplicity, classify, contact_forces, solutions
from jaxcontact.mechanisms import (
    FlexiblePainleveKlein,
    GuidedRod,
    GuidedRodUnderCeiling,
    PainleveKlein,
    PainleveRod,
    RodBetweenFloorAndCeiling,
)

EXACT = 1e-12  # the bar for closed forms; conditions here are below 1e2


@jc.mechanism
class Puck:
    """A puck in space on a table, its slip the speed along the sliding direction."""

    mass: float = 2.0  # kg
    gravity: float = 9.81  # m/s^2

    contacts = (jc.Contact("table", "unilateral", frictional=True),)

    def kinetic_energy(self, q, v):
        return 0.5 * self.mass * jnp.sum(v * v)

    def potential_energy(self, q):
        return self.mass * self.gravity * q[2]

    def gaps(self, q):
        return q[2:3]

    def slips(self, q, v):
        return jnp.sqrt(v[0] ** 2 + v[1] ** 2)[None]

    def state(self, vx, vy):
        return jc.State(jnp.zeros(3), jnp.array([vx, vy, 0.0]))


@jc.mechanism
class Bead:
    """A bead in the plane, held at y = 0 by `a` and at slope y = 0 by `b` as well: one constraint too many."""

    mass: float = 2.0  # kg
    light: float = 0.0  # kg, moves along y too, without mass of its own unless given
    tilt: float = 0.0  # acceleration by which the second constraint contradicts the first, m/s^2

    contacts = (jc.Contact("a", "bilateral"), jc.Contact("b", "bilateral"))

    def mass_matrix(self, q):
        zero = jnp.zeros_like(q[0])
        return jnp.diag(jnp.stack([zero + self.mass, zero + self.light]))

    def applied_force(self, q, v, t):
        return jnp.array([3.0, -4.0], q.dtype)

    def gaps(self, q):
        return jnp.stack([q[1], 2.0 * q[1]])

    def gap_curvature(self, q, v):
        return jnp.stack([jnp.zeros_like(q[0]), jnp.zeros_like(q[0]) + self.tilt])

    def state(self):
        return jc.State(jnp.zeros(2))


@jc.mechanism
class Free:
    """A point mass that nothing touches."""

    mass: float = 2.0

    contacts = ()

    def kinetic_energy(self, q, v):
        return 0.5 * self.mass * jnp.sum(v * v)

    def potential_energy(self, q):
        return 9.81 * self.mass * q[1]

    def gaps(self, q):
        return q[:0]

    def state(self):
        return jc.State(jnp.zeros(2))


def test_flexible_painleve_klein_with_coriolis_gravity_and_spring():
    guides, known = FlexiblePainleveKlein(stiffness=20.0, free_gap=0.3), tables()["state_flexible"]
    forces = contact_forces(guides, guides.state(theta=0.8, d=0.5, speed=2.0, thetadot=0.4), (0.2, 0.3))
    np.testing.assert_allclose(forces.normal, known["lambda_nb"], rtol=EXACT)
    np.testing.assert_allclose(forces.acceleration, known["qddot"], rtol=EXACT, atol=EXACT)
    np.testing.assert_allclose(forces.tangential, -np.array([0.2, 0.3]) * known["lambda_nb"], rtol=EXACT)
    assert forces.status == Status.SOLVED
    assert forces.unique
    assert forces.residual < 1e-15


def test_the_guided_rod():
    """Equation (8) with erratum A1."""
    rod, known = GuidedRod(frictional=False), table("rod_bilateral_frictionless_state")
    forces = jax.vmap(lambda theta, rate: contact_forces(rod, rod.state(theta=theta, thetadot=rate)))(
        jnp.asarray(known["theta"]), jnp.asarray(known["thetadot"])
    )
    expected = np.stack([known["xdd"], known["ydd"], known["thetadd"]], axis=1)
    np.testing.assert_allclose(forces.normal[:, 0], known["lambda_nb"], rtol=EXACT)
    np.testing.assert_allclose(forces.acceleration, expected, rtol=EXACT, atol=EXACT)


def test_the_rod_under_a_ceiling():
    """Section 2.3 with errata A5 and A6. At a right angle and at rest any lambda_u = lambda_b does: redundant."""
    for theta, rate, f_b, f_u, *_, push, hold in tables()["rod_one_bilateral_one_unilateral_frictionless"]["rows"]:
        rod = GuidedRodUnderCeiling(guide_frictional=False, ceiling_frictional=False, guide_pull=f_b, ceiling_pull=f_u)
        state = rod.state(theta=theta, thetadot=rate)
        if rate and theta < 1.5:  # the tip would go through the ceiling: no persistent contact
            with pytest.raises(ValueError, match="opens or closes"):
                contact_forces(rod, state)
            assert jax.jit(contact_forces)(rod, state).status == Status.BAD_INPUT
            continue
        forces = contact_forces(rod, state)
        if hold == "lambda_u":
            assert forces.status == Status.REDUNDANT
            assert not forces.unique
            np.testing.assert_allclose(forces.normal[0], forces.normal[1], atol=EXACT)
            np.testing.assert_allclose(forces.acceleration, [f_b + f_u, 0.0, 6.0 * (f_b - f_u)], rtol=EXACT, atol=EXACT)
        else:
            assert forces.status == Status.SOLVED
            np.testing.assert_allclose(forces.normal, [hold, push], rtol=EXACT, atol=EXACT)
            assert forces.open[1] == (push == 0)


def test_the_sliding_rod_below_and_beyond_its_critical_friction():
    """(59) with erratum B10: one number A = 1 + 3 c^2 - 3 mu s c decides for xi = -1; w is minus gravity."""
    theta, weight = 0.8, 9.81
    s, c = np.sin(theta), np.cos(theta)
    critical = (1 + 3 * c * c) / (3 * s * c)

    @jax.jit
    def at(mu, gravity):
        rod = PainleveRod(gravity=gravity)
        return contact_forces(rod, rod.state(theta=theta, speed=-1.0), mu[None])

    below = at(0.5 * critical, weight)
    np.testing.assert_allclose(below.normal, [weight / (1 + 3 * c * c - 1.5 * critical * s * c)], rtol=EXACT)
    assert at(1.5 * critical, weight).status == Status.INFEASIBLE  # the one row proves it
    beyond = at(1.5 * critical, -weight)
    assert beyond.status == Status.SOLVED  # detached, or pressed: one of the two
    assert not beyond.unique
    assert min(abs(float(beyond.normal[0])), abs(float(beyond.normal[0]) + weight / (-0.5 * (1 + 3 * c * c)))) < 1e-11


def test_a_puck_slows_down_along_its_path():
    """In space the slip is the speed: -mu g along the direction of sliding."""
    puck = Puck()
    forces = contact_forces(puck, puck.state(3.0, -4.0), jnp.array([0.5]))
    np.testing.assert_allclose(forces.acceleration, [-0.5 * 9.81 * 0.6, 0.5 * 9.81 * 0.8, 0.0], rtol=EXACT, atol=EXACT)
    np.testing.assert_allclose(forces.tangential, [-0.5 * 2.0 * 9.81], rtol=EXACT)
    assert contact_forces(puck, puck.state(0.0, 0.0), jnp.array([0.5])).status == Status.STICKING
    np.testing.assert_allclose(contact_forces(puck, puck.state(0.0, 0.0), jnp.array([0.0])).normal, [19.62], rtol=EXACT)


@pytest.mark.parametrize("light", [0.0, 1.0])
def test_redundant_constraints_and_massless_directions(light):
    """G lambda = 4 N is determined, lambda has least norm: 4 (1, 2) / 5. Prop. 1(ii): M may be singular."""
    forces = contact_forces(Bead(light=light), Bead().state())
    assert forces.status == Status.REDUNDANT
    np.testing.assert_allclose(forces.normal, [0.8, 1.6], rtol=EXACT)
    np.testing.assert_allclose(forces.acceleration, [1.5, 0.0], atol=EXACT)
    assert not forces.unique


def test_contradicting_constraints_are_infeasible():
    forces = contact_forces(Bead(light=1.0, tilt=1e-6), Bead().state())
    assert forces.status == Status.INFEASIBLE
    assert np.isnan(forces.acceleration).all()


def test_nothing_touches():
    forces = contact_forces(Free(), Free().state())
    assert forces.status == Status.SOLVED
    assert forces.normal.shape == forces.open.shape == (0,)
    np.testing.assert_allclose(forces.acceleration, [0.0, -9.81], rtol=EXACT)
    of_mass = jax.grad(lambda body: contact_forces(body, body.state()).acceleration[1])(Free()).mass
    np.testing.assert_allclose(of_mass, 0.0, atol=EXACT)
    assert solutions(jc.delassus(Free(), Free().state())).count == 1


def test_painleve_klein_has_three_solutions():
    guides = PainleveKlein(gravity=9.81)
    here = jc.delassus(guides, guides.state(theta=np.pi / 4))
    every = solutions(here, jnp.array([1.5, 1.5]), jnp.array([-1.0, -1.0]))
    rows = np.array(sorted(every.normal[every.valid].tolist()))
    np.testing.assert_allclose(rows, tables()["pk_three_solutions"]["lambdas"], rtol=EXACT)
    np.testing.assert_allclose(every.tangential[every.valid], 1.5 * np.abs(every.normal[every.valid]), rtol=EXACT)
    assert every.multiplicity == Multiplicity.MANY
    assert not every.infinite


def test_painleve_klein_counts_for_any_load():
    """mathematics of the two guides: {1} if mu_1 + mu_2 < 2 cot, else {1, 3} while |xi_1 mu_1 - xi_2 mu_2| < 2 cot,
    else {0, 2}."""
    rng = np.random.default_rng(7)
    cells, guides = 3000, PainleveKlein()
    theta = rng.uniform(0.3, 1.4, cells)
    mu = rng.uniform(0.0, 2.5, (cells, 2)) / np.tan(theta)[:, None]
    xi, w = rng.choice([-1.0, 1.0], (cells, 2)), rng.normal(size=(cells, 2))

    @jax.jit
    @jax.vmap
    def count(theta, mu, xi, w):
        here = jc.delassus(guides, guides.state(theta=theta))
        return solutions(jax.tree.map(lambda x: x, here).__class__(**{**vars(here), "w": w}), mu, xi).count

    counts = np.asarray(count(*map(jnp.asarray, (theta, mu, xi, w))))
    limit = 2 / np.tan(theta)
    unique = mu.sum(axis=1) < limit
    exists = np.abs((xi * mu) @ [1.0, -1.0]) < limit
    assert set(counts[unique]) == {1}
    assert set(counts[~unique & exists]) == {1, 3}
    assert set(counts[~exists]) == {0, 2}


def test_the_map_of_the_sliding_rod_is_that_of_theory():
    """Painlevé's rod over (theta, mu), xi = -1: unique where 1 + 3 c^2 > 3 mu s c, else none (w < 0) or two (w > 0)."""
    theta, mu = np.linspace(0.05, 1.5, 60), np.linspace(0.05, 4.0, 50)

    @jax.jit
    def maps(gravity):
        rod = PainleveRod(gravity=gravity)

        def cell(theta, mu):
            here = jc.delassus(rod, rod.state(theta=theta))
            forces = contact_forces(rod, rod.state(theta=theta, speed=-1.0), mu[None])
            return classify(here, mu[None], -jnp.ones(1)), forces.status

        return jax.vmap(lambda theta: jax.vmap(lambda mu: cell(theta, mu))(jnp.asarray(mu)))(jnp.asarray(theta))

    s, c = np.sin(theta)[:, None], np.cos(theta)[:, None]
    unique = 1 + 3 * c**2 > 3 * mu[None, :] * s * c
    for gravity, beyond in ((9.81, Multiplicity.NONE), (-9.81, Multiplicity.MANY)):
        number, status = map(np.asarray, maps(gravity))
        assert (number == np.where(unique, Multiplicity.ONE, beyond)).all()
        assert ((status == Status.SOLVED) == (number != Multiplicity.NONE)).all()


def test_the_map_of_painleve_klein_is_that_of_theory():
    """Over (theta, mu): equal friction under gravity is unique below cot theta; without vertical load, xi_1 = xi_2 and
    mu_2 = mu_1 / 4, the classical criterion |mu_1 - mu_2| < 2 cot theta holds (erratum B1)."""
    theta, mu = np.linspace(0.1, 1.45, 40), np.linspace(0.03, 5.0, 40)

    @jax.jit
    def maps(gravity, pull, ratio):
        guides = PainleveKlein(gravity=gravity, lower_pull=pull)

        def cell(theta, mu):
            forces = contact_forces(guides, guides.state(theta=theta, speed=-1.0), mu * ratio)
            here = jc.delassus(guides, guides.state(theta=theta))
            return classify(here, mu * ratio, -jnp.ones(2)), forces.status

        return jax.vmap(lambda theta: jax.vmap(lambda mu: cell(theta, mu))(jnp.asarray(mu)))(jnp.asarray(theta))

    cot = 1 / np.tan(theta)[:, None]
    number, status = map(np.asarray, maps(9.81, 0.0, jnp.ones(2)))
    assert (number == np.where(mu[None, :] < cot, Multiplicity.ONE, Multiplicity.MANY)).all()
    assert (status == Status.SOLVED).all()
    exists = 0.75 * mu[None, :] < 2 * cot
    seen = set()
    for pull in (5.0, -5.0):
        number, status = map(np.asarray, maps(0.0, pull, jnp.array([1.0, 0.25])))
        assert (number[exists] == Multiplicity.ONE).all()
        assert ((status == Status.SOLVED) == (number != Multiplicity.NONE)).all()
        seen |= set(number[~exists].tolist())
    assert seen == {Multiplicity.NONE, Multiplicity.MANY}


def test_two_rough_tips_one_held_one_pushing():
    """Section 2.3 with friction at both tips: unique for every load iff mu_b < (1 + 3 c^2) / (3 s c) and
    mu_b + xi_u mu_u < 2 cot theta."""
    rng = np.random.default_rng(11)
    cells, rod = 2000, GuidedRodUnderCeiling()
    theta = rng.uniform(0.2, 1.4, cells)
    mu, xi = rng.uniform(0.0, 2.0, (cells, 2)), rng.choice([-1.0, 1.0], (cells, 2))
    w = rng.normal(size=(cells, 2))

    @jax.jit
    @jax.vmap
    def number(theta, mu, xi, w):
        here = jc.delassus(rod, rod.state(theta=theta))
        return classify(type(here)(**{**vars(here), "w": w}), mu, xi)

    found = np.asarray(number(*map(jnp.asarray, (theta, mu, xi, w))))
    s, c = np.sin(theta), np.cos(theta)
    unique = (mu[:, 0] < (1 + 3 * c * c) / (3 * s * c)) & (mu[:, 0] + xi[:, 1] * mu[:, 1] < 2 * c / s)
    assert (found[unique] == Multiplicity.ONE).all()
    assert {Multiplicity.NONE, Multiplicity.MANY} <= set(found[~unique].tolist())


def test_a_rigid_ceiling_may_be_pressed_without_limit():
    """Upright between floor and ceiling without weight, any equal pair of forces does: infinitely many."""
    rod = RodBetweenFloorAndCeiling(gravity=0.0, floor_frictional=False, ceiling_frictional=False)
    here = jc.delassus(rod, rod.state(theta=np.pi / 2))
    assert classify(here) == Multiplicity.INFINITE


def test_a_method_of_choice_agrees():
    guides = FlexiblePainleveKlein(stiffness=20.0, free_gap=0.3)
    state = guides.state(theta=0.8, d=0.5, speed=2.0, thetadot=0.4)
    np.testing.assert_allclose(
        contact_forces(guides, state, (0.2, 0.3), Lemke()).normal,
        tables()["state_flexible"]["lambda_nb"],
        rtol=EXACT,
    )
