"""Derived terms against the tutorial's printed ones, and against terms stated by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import tables

import jaxcontact as jc
from jaxcontact.mechanisms import (
    ArticulatedPainleveKlein,
    FlexiblePainleveKlein,
    GuidedRod,
    GuidedRodUnderCeiling,
    LinearBearing,
    PainleveKlein,
    PainleveRod,
)

# Printed matrices have entries of order one and are evaluated with a handful of roundings.
ROUNDINGS = 1e-14


def derived(mechanism, state):
    return jc.delassus(mechanism, state).terms


@pytest.mark.parametrize("theta", [0.3, 1.2])
def test_the_guided_rod_has_the_printed_terms_of_equation_8(theta):
    length, mass, gravity, rate = 1.3, 0.7, 9.81, 2.0
    rod = GuidedRod(length=length, mass=mass, gravity=gravity)
    parts = derived(rod, rod.state(theta=theta, speed=1.0, thetadot=rate))
    s, c = np.sin(theta), np.cos(theta)
    np.testing.assert_allclose(parts.M, np.diag([mass, mass, mass * length**2 / 12]), atol=ROUNDINGS)
    np.testing.assert_allclose(parts.F, [0, mass * gravity, 0], atol=ROUNDINGS)
    np.testing.assert_allclose(parts.G[:, 0], [0, 1, -0.5 * length * c], atol=ROUNDINGS)
    np.testing.assert_allclose(parts.H[:, 0], [1, 0, 0.5 * length * s], atol=ROUNDINGS)
    np.testing.assert_allclose(parts.c, [0.5 * length * s * rate**2], rtol=ROUNDINGS)


def test_the_floor_feels_what_the_guide_feels():
    guide, floor = GuidedRod(), PainleveRod()
    for left, right in zip(
        jax.tree.leaves(derived(guide, guide.state(0.7, speed=-1.0, thetadot=2.0))),
        jax.tree.leaves(derived(floor, floor.state(0.7, speed=-1.0, thetadot=2.0))),
    ):
        np.testing.assert_array_equal(left, right)


def test_forces_pull_forward_under_the_ceiling_and_backward_in_painleve_klein():
    """f_b, f_u act in +x (section 2.3), F_1, F_2 in -x (section 3.2.2); F stands on the left-hand side."""
    theta, length, low, high = 0.7, 1.3, 2.0, 3.0
    lever = 0.5 * length * np.sin(theta)
    ceiling = GuidedRodUnderCeiling(length=length, guide_pull=low, ceiling_pull=high)
    klein = PainleveKlein(length=length, lower_pull=low, upper_pull=high)
    F_ceiling = derived(ceiling, ceiling.state(theta=theta)).F
    F_klein = derived(klein, klein.state(theta=theta)).F
    np.testing.assert_allclose(F_ceiling, [-(low + high), 0, -lever * (low - high)], rtol=ROUNDINGS, atol=ROUNDINGS)
    np.testing.assert_allclose(F_klein, [low + high, 0, lever * (low - high)], rtol=ROUNDINGS, atol=ROUNDINGS)


def test_a_ceiling_has_the_gradient_of_the_upper_tip_reversed_and_the_same_tangent():
    """Mathematics, section 4: nabla h_u = -(nabla h of the upper tip), same H; c_u = l/2 s theta'^2 at both tips."""
    theta, rate = 0.7, 2.0
    s, c = np.sin(theta), np.cos(theta)
    rod = GuidedRodUnderCeiling()
    q = rod.state(theta=theta).q
    parts = jc.terms(rod, jc.State(q, jnp.array([0.0, 0.5 * c * rate, rate])))
    np.testing.assert_allclose(parts.G[:, 1], [0, -1, -0.5 * c], atol=ROUNDINGS)
    np.testing.assert_allclose(parts.H[:, 1], [1, 0, -0.5 * s], atol=ROUNDINGS)
    np.testing.assert_allclose(parts.c, [0.5 * s * rate**2] * 2, rtol=ROUNDINGS)


def test_the_flexible_system_has_the_reference_terms_with_coriolis_gravity_and_spring():
    """`state_flexible`: 50-digit values of M, F, c_b and the velocities on both guides."""
    expected = tables()["state_flexible"]
    rods = FlexiblePainleveKlein(stiffness=20.0, free_gap=0.3)
    state = rods.state(theta=0.8, d=0.5, speed=2.0, thetadot=0.4)
    parts = derived(rods, state)
    np.testing.assert_allclose(state.v, expected["qdot"], rtol=ROUNDINGS, atol=ROUNDINGS)
    np.testing.assert_allclose(parts.M, expected["M"], rtol=ROUNDINGS, atol=ROUNDINGS)
    np.testing.assert_allclose(parts.F, expected["F"], rtol=ROUNDINGS, atol=ROUNDINGS)
    np.testing.assert_allclose(parts.c, expected["c_b"], rtol=ROUNDINGS, atol=ROUNDINGS)


def test_the_articulated_system_has_the_bias_of_mathematics_1_7():
    l, m, g, t1, t2, w1 = 1.2, 0.8, 9.81, 0.7, 1.1, 0.6
    links = ArticulatedPainleveKlein(length=l, mass=m, gravity=g)
    parts = derived(links, links.state(theta1=t1, theta2=t2, speed=1.0, theta1dot=w1))
    w2 = -np.cos(t1) / np.cos(t2) * w1
    s1, c1, s2, c2 = np.sin(t1), np.cos(t1), np.sin(t2), np.cos(t2)
    F = [
        -(m * l / 8) * (3 * w1**2 * c1 + w2**2 * c2),
        m * g - (m * l / 8) * (3 * w1**2 * s1 + w2**2 * s2),
        (m * l / 16) * (6 * g * c1 + l * w2**2 * np.sin(t1 - t2)),
        (m * l / 16) * (2 * g * c2 - l * w1**2 * np.sin(t1 - t2)),
    ]
    np.testing.assert_allclose(parts.F, F, rtol=ROUNDINGS, atol=ROUNDINGS)
    np.testing.assert_allclose(parts.c, [0, -0.5 * l * (w1**2 * s1 + w2**2 * s2)], rtol=ROUNDINGS, atol=ROUNDINGS)
    np.testing.assert_allclose(parts.G.T, [[0, 1, 0, 0], [0, 1, 0.5 * l * c1, 0.5 * l * c2]], atol=ROUNDINGS)
    np.testing.assert_allclose(parts.H.T, [[1, 0, 0, 0], [1, 0, -0.5 * l * s1, -0.5 * l * s2]], atol=ROUNDINGS)


def test_delassus_blocks_of_the_articulated_system_are_those_of_mathematics_1_7():
    m, t1, t2 = 0.8, 0.7, 1.1
    links = ArticulatedPainleveKlein(mass=m)
    here = jc.delassus(links, links.state(theta1=t1, theta2=t2))
    C1, C2, S1, S2 = np.cos(2 * t1), np.cos(2 * t2), np.sin(2 * t1), np.sin(2 * t2)
    gamma, sigma = np.cos(2 * (t1 - t2)), np.sin(2 * (t1 - t2))
    scale = 1 / (m * (41 - 9 * gamma))
    off = 36 * gamma - 4
    A_nb = [[164 + 108 * C1 - 12 * C2 - 36 * gamma, off], [off, 164 - 12 * C1 + 108 * C2 - 36 * gamma]]
    A_tb = [[-108 * S1 + 12 * S2, 36 * sigma], [-36 * sigma, 12 * S1 - 108 * S2]]
    np.testing.assert_allclose(here.A_nb, scale * np.array(A_nb), rtol=10 * ROUNDINGS)
    np.testing.assert_allclose(here.A_tb, scale * np.array(A_tb), rtol=10 * ROUNDINGS, atol=ROUNDINGS)


def test_w_of_painleve_klein_is_the_printed_one():
    theta, m, l, pull = 0.7, 0.8, 1.3, (2.0, 3.5)
    guides = PainleveKlein(length=l, mass=m, lower_pull=pull[0], upper_pull=pull[1])
    here = jc.delassus(guides, guides.state(theta=theta))
    s, c = np.sin(theta), np.cos(theta)
    expected = 3 * s * c * (pull[0] - pull[1]) / m * np.array([1.0, -1.0])
    np.testing.assert_allclose(here.w, expected, rtol=ROUNDINGS)


@jc.mechanism
class StatedPendulum:
    """A cart with a pendulum on a curved rail, every term stated by hand from the Lagrangian."""

    cart: float = 2.0
    bob: float = 0.5
    length: float = 0.7
    contacts = (jc.Contact("rail", "bilateral", frictional=True),)

    def mass_matrix(self, q):
        coupling = self.bob * self.length
        one, both = jnp.ones_like(q[2]), self.cart + self.bob
        c, s = coupling * jnp.cos(q[2]), coupling * jnp.sin(q[2])
        return jnp.array(
            [[both * one, 0 * one, c], [0 * one, both * one, s], [c, s, coupling * self.length * one]], q.dtype
        )

    def bias(self, q, v, t):
        pull = self.bob * self.length * v[2] ** 2
        return jnp.array([-pull * jnp.sin(q[2]), pull * jnp.cos(q[2]) + 9.81, 0.3 * q[2]], q.dtype)

    def gap_gradients(self, q):
        return jnp.array([[-2 * q[0]], [jnp.ones_like(q[0])], [jnp.zeros_like(q[0])]], q.dtype)

    def gap_curvature(self, q, v):
        return jnp.array([-2 * v[0] ** 2], q.dtype)

    def slip_directions(self, q):
        return jnp.array([[jnp.ones_like(q[0])], [2 * q[0]], [jnp.zeros_like(q[0])]], q.dtype)

    def gaps(self, q):
        return (q[1] - q[0] ** 2)[None]

    def slips(self, q, v):
        return (v[0] + 2 * q[0] * v[1])[None]


@jc.mechanism
class DerivedPendulum:
    """The same cart, stated by its energies."""

    cart: float = 2.0
    bob: float = 0.5
    length: float = 0.7
    contacts = StatedPendulum.contacts
    gaps = StatedPendulum.gaps
    slips = StatedPendulum.slips

    def kinetic_energy(self, q, v):
        swing = jnp.array([jnp.cos(q[2]), jnp.sin(q[2])]) * self.length * v[2]
        bob = (v[0] + swing[0]) ** 2 + (v[1] + swing[1]) ** 2
        return 0.5 * self.cart * (v[0] ** 2 + v[1] ** 2) + 0.5 * self.bob * bob

    def potential_energy(self, q):
        return 9.81 * q[1] + 0.15 * q[2] ** 2


def test_terms_stated_by_hand_and_derived_from_energies_agree():
    q, v = jnp.array([0.3, 0.09, 0.8]), jnp.array([1.0, 0.6, -2.0])
    stated, derived_ = (jc.terms(cls(), jc.State(q, v)) for cls in (StatedPendulum, DerivedPendulum))
    for name in ("M", "F", "G", "H", "c", "slip", "gap", "gap_rate"):
        np.testing.assert_allclose(getattr(stated, name), getattr(derived_, name), rtol=ROUNDINGS, atol=ROUNDINGS)


def test_a_stated_mass_matrix_alone_still_gives_the_inertial_bias():
    class Half(StatedPendulum):
        bias = property()  # not stated: `hasattr` is False for a property without a getter

    q, v = jnp.array([0.3, 0.09, 0.8]), jnp.array([1.0, 0.6, -2.0])
    bias = jc.terms(Half(), jc.State(q, v)).F
    pull = 0.5 * 0.7 * v[2] ** 2
    np.testing.assert_allclose(bias, [-pull * np.sin(0.8), pull * np.cos(0.8), 0.0], rtol=ROUNDINGS, atol=ROUNDINGS)


def test_a_driven_constraint_brings_its_own_acceleration():
    """h = x - a t^2 / 2 - l theta t: c = h_tt + 2 h_qt v = -a - 2 l theta'."""

    @jc.mechanism
    class Driven:
        contacts = (jc.Contact("drive", "bilateral"),)

        def kinetic_energy(self, q, v):
            return 0.5 * jnp.sum(v**2)

        def gaps(self, q, t):
            return (q[0] - 1.5 * t**2 - 0.2 * q[1] * t)[None]

    t = 0.4
    q = jnp.array([1.5 * t**2 + 0.2 * 0.7 * t, 0.7])
    v = jnp.array([3.0 * t + 0.2 * 0.7 + 0.2 * t * 2.0, 2.0])
    parts = derived(Driven(), jc.State(q, v, t))
    np.testing.assert_allclose(parts.c, [-3.0 - 2 * 0.2 * 2.0], rtol=ROUNDINGS)
    np.testing.assert_allclose(parts.gap_rate, [0.0], atol=ROUNDINGS)
    at_rest = jc.terms(Driven(), jc.State(q, t=t))
    np.testing.assert_allclose(at_rest.c, [-3.0], rtol=ROUNDINGS)


def test_in_three_dimensions_the_slip_direction_is_that_of_the_velocity():
    """A puck on a table: v_t = |(v_x, v_y)|, so H = (v_x, v_y, 0) / |.|."""
    parts = derived(Puck(), jc.State(jnp.array([0.0, 0.0, 0.0]), jnp.array([3.0, 4.0, 0.0])))
    np.testing.assert_allclose(parts.H[:, 0], [0.6, 0.8, 0.0], rtol=ROUNDINGS)
    np.testing.assert_allclose(parts.slip, [5.0], rtol=ROUNDINGS)


def test_in_three_dimensions_rest_leaves_the_slip_direction_undefined_and_says_so():
    with pytest.raises(ValueError, match="sliding direction of contact 'table' is undefined"):
        jc.delassus(Puck(), jc.State(jnp.zeros(3)))


@jc.mechanism
class Puck:
    contacts = (jc.Contact("table", "unilateral", frictional=True),)

    def kinetic_energy(self, q, v):
        return 0.5 * jnp.sum(v**2)

    def gaps(self, q):
        return q[2][None]

    def slips(self, q, v):
        return jnp.sqrt(v[0] ** 2 + v[1] ** 2)[None]


def test_slips_of_frictionless_contacts_are_never_read():
    @jc.mechanism
    class Poisoned:
        contacts = (jc.Contact("rough", "bilateral", True), jc.Contact("smooth", "bilateral", False))

        def kinetic_energy(self, q, v):
            return 0.5 * jnp.sum(v**2)

        def gaps(self, q):
            return q[:2]

        def slips(self, q, v):
            return jnp.stack([v[2], jnp.nan * v[1]])

    here = jc.delassus(Poisoned(), jc.State(jnp.zeros(3)))
    np.testing.assert_array_equal(here.T, [[0, 0], [0, 0], [1, 0]])
    assert jc.bounds.norm_ratio(here) == jnp.inf


def test_a_linear_bearing_state_lies_on_its_driven_constraint():
    bearing = LinearBearing(drive_speed=2.0)
    parts = derived(bearing, bearing.state(t=0.7))
    np.testing.assert_allclose(parts.gap, np.zeros(3), atol=ROUNDINGS)
    np.testing.assert_allclose(parts.gap_rate, np.zeros(3), atol=ROUNDINGS)
