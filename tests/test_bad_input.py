"""Bad input at the door of mechanisms, states and bounds: what came, what was expected, what to write."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.mechanisms import ArticulatedPainleveKlein, GuidedRod, PainleveKlein, PainleveRod


@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["mass", "length"])
def test_masses_and_lengths_must_be_positive_and_finite(name, value):
    with pytest.raises(ValueError, match=rf"PainleveKlein\.{name}"):
        PainleveKlein(**{name: value})


def test_a_parameter_must_be_a_number():
    with pytest.raises(TypeError, match=r"PainleveKlein\.mass must be a number, got '1 kg'"):
        PainleveKlein(mass="1 kg")


def test_an_integer_parameter_is_a_float():
    assert isinstance(PainleveKlein(length=2).length, float)


def test_an_unknown_coordinate_is_answered_with_the_known_ones():
    with pytest.raises(TypeError, match=r"no coordinate 'thta'.*theta, x, speed, thetadot; did you mean 'theta'"):
        PainleveKlein().state(thta=0.9)


@jc.mechanism
class Block:
    """A block on a floor; its mass is a bare float, so only the mass matrix can tell."""

    mass: float = 1.0
    contacts = (jc.Contact("floor", "bilateral", True),)

    def kinetic_energy(self, q, v):
        return 0.5 * self.mass * (v[0] ** 2 + v[1] ** 2)

    def gaps(self, q):
        return q[1][None]

    def slips(self, q, v):
        return v[0][None]


@pytest.mark.parametrize("mass", [-1.0, 0.0])
def test_a_mass_matrix_that_is_not_positive_definite_is_refused_or_nan_in_a_batch(mass):
    with pytest.raises(ValueError, match="mass matrix .* is not positive definite"):
        jc.delassus(Block(mass=mass), jc.State(jnp.zeros(2)))
    bound = jax.jit(lambda m: jc.bounds.norm_ratio(jc.delassus(Block(mass=m), jc.State(jnp.zeros(2)))))
    assert jnp.isnan(bound(mass))


def test_nan_in_a_state_is_named():
    with pytest.raises(ValueError, match=r"state\.q is .*nan.*: expected finite numbers"):
        jc.delassus(Block(), jc.State(jnp.array([0.0, jnp.nan])))


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "complex64"])
def test_half_precision_and_complex_states_are_refused(dtype):
    with pytest.raises(TypeError, match=f"q has dtype {dtype}; jaxcontact works in float32 and float64"):
        jc.State(jnp.zeros(2, dtype))


def test_integer_coordinates_become_floats():
    assert jc.State(np.array([0, 1])).q.dtype == jnp.float64


def test_double_precision_data_are_not_rounded_in_silence():
    with jax.enable_x64(False), pytest.raises(ValueError, match="q is float64 but JAX runs without 64-bit floats"):
        jc.State(np.zeros(2))


@pytest.mark.parametrize(("q", "v"), [(np.zeros((2, 2)), None), (np.zeros(2), np.zeros(3))])
def test_states_of_wrong_shape_are_refused(q, v):
    with pytest.raises(ValueError, match="State: [qv] must"):
        jc.State(q, v)


def test_a_state_off_its_constraint_is_refused_with_the_gap():
    guides = PainleveKlein()
    with pytest.raises(ValueError, match=r"contact 'lower guide' is not closed at this state, its gap is 4\.61 m"):
        jc.delassus(guides, jc.State(jnp.array([0.0, 5.0, 0.9])))
    fixed = PainleveKlein(spacing=0.5)
    assert jnp.isfinite(jc.bounds.norm_ratio(jc.delassus(fixed, fixed.state(theta=jnp.arcsin(0.5)))))
    with pytest.raises(ValueError, match="contact 'upper guide' is not closed"):
        jc.delassus(fixed, fixed.state(theta=0.9))


def test_a_state_leaving_its_constraint_is_refused_with_the_speed():
    guides = PainleveKlein()
    with pytest.raises(ValueError, match="contact 'upper guide' opens or closes at 1.24 m/s"):
        jc.delassus(guides, guides.state(theta=0.9, thetadot=2.0))


def test_guides_too_far_apart_for_the_links_are_refused():
    links = ArticulatedPainleveKlein(spacing=0.95)
    with pytest.raises(ValueError, match="nan"):
        jc.delassus(links, links.state(theta1=0.1))


def test_kinetic_energy_must_vanish_at_rest():
    @jc.mechanism
    class OnABelt:
        contacts = (jc.Contact("floor", "bilateral", False),)

        def kinetic_energy(self, q, v):
            return 0.5 * ((v[0] - 1.0) ** 2 + v[1] ** 2)

        def gaps(self, q):
            return q[1][None]

    with pytest.raises(ValueError, match="kinetic_energy must vanish at v = 0, got 0.5"):
        jc.delassus(OnABelt(), jc.State(jnp.zeros(2)))


def test_kinetic_energy_must_be_quadratic():
    """A magnetic term b v of the Lagrangian is no kinetic energy: M is read off T at unit velocities."""

    @jc.mechanism
    class InAField:
        contacts = (jc.Contact("floor", "bilateral", False),)

        def kinetic_energy(self, q, v):
            return 0.5 * (v[0] ** 2 + v[1] ** 2) + 0.25 * q[0] * v[1] + 0.25 * v[1]

        def gaps(self, q):
            return q[1][None]

    for ask in (jc.delassus, lambda m, s: jc.contact_forces(m, s, None)):
        with pytest.raises(ValueError, match=r"must be quadratic in v, got T\(v\) - T\(-v\) = 1.0"):
            ask(InAField(), jc.State(jnp.zeros(2)))


class Incomplete:
    contacts = (jc.Contact("floor", "bilateral", True),)


class Weightless(Incomplete):
    pass


class Gapless(Incomplete):
    def kinetic_energy(self, q, v):
        return jnp.sum(v**2)


class Slipless(Gapless):
    def gaps(self, q):
        return q[1][None]


class WrongShape(Slipless):
    slips = lambda self, q, v: v  # noqa: E731


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (Weightless, r"neither kinetic_energy\(q, v\) nor mass_matrix\(q\)"),
        (Gapless, r"has no gaps\(q\)"),
        (Slipless, r"frictional contacts \('floor'\) and needs slips"),
        (WrongShape, r"slips must return shape \(1,\), got \(2,\)"),
    ],
)
def test_an_incomplete_mechanism_is_told_what_it_lacks(cls, message):
    with pytest.raises(TypeError, match=message):
        jc.delassus(jc.mechanism(type(cls.__name__, (cls,), {}))(), jc.State(jnp.zeros(2)))


def test_a_contact_is_bilateral_or_unilateral():
    with pytest.raises(ValueError, match='"bilateral" or "unilateral", got \'both\''):
        jc.Contact("floor", "both")


def test_a_ratio_must_fit_the_contacts_and_not_be_negative():
    rod = GuidedRod()
    here = jc.delassus(rod, rod.state(theta=0.9))
    with pytest.raises(ValueError, match=r"one entry per contact, shape \(1,\), got shape \(2,\)"):
        jc.bounds.norm_ratio(here, jnp.ones(2))
    for bad in (-1.0, jnp.nan, jnp.inf):
        with pytest.raises(ValueError, match="ratio must be finite and not negative"):
            jc.bounds.norm_ratio(here, jnp.array([bad]))
        assert jnp.isnan(jax.jit(lambda r: jc.bounds.norm_ratio(here, r))(jnp.array([bad])))


def test_matrices_must_fit_the_contacts():
    with pytest.raises(ValueError, match=r"Wt must have shape \(1, 1\) for 1 contacts, got \(1, 2\)"):
        jc.delassus_from_matrices(np.eye(1), np.ones((1, 2)), contacts=(jc.Contact("a", "bilateral", True),))


def test_right_angles_have_their_documented_values():
    """theta = 0: Wt = 0, the bound is infinite; at theta = pi/2, rounded, W is nearly singular, the bound nearly 0."""
    rod, guides = PainleveRod(), PainleveKlein()
    assert jc.bounds.norm_ratio(jc.delassus(rod, rod.state(theta=0.0))) == jnp.inf
    upright = jc.bounds.norm_ratio(jc.delassus(guides, guides.state(theta=np.pi / 2)))
    np.testing.assert_allclose(upright, 1 / np.tan(np.pi / 2), rtol=1e-12)
