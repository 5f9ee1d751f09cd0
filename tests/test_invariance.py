"""What must not matter: units, the order of contacts, the point of reference, jit or not."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.bounds import by_name, norm_ratio
from jaxcontact.mechanisms import (
    ArticulatedPainleveKlein,
    FlexiblePainleveKlein,
    GuidedRod,
    GuidedRodUnderCeiling,
    LinearBearing,
    PainleveKlein,
    PainleveRod,
)

# A change of units multiplies the data by powers of ten, a rounding each; the bounds amplify it a little.
ROUNDINGS = 1e-12

SCENES = (
    (GuidedRod(), {"theta": 0.8}),
    (PainleveRod(), {"theta": 0.8}),
    (GuidedRodUnderCeiling(), {"theta": 0.8}),
    (PainleveKlein(), {"theta": 0.8}),
    (FlexiblePainleveKlein(), {"theta": 0.8, "d": 0.5}),
    (ArticulatedPainleveKlein(), {"theta1": 0.8, "theta2": 0.5}),
    (LinearBearing(), {}),
)

DEPENDS_ON_MASS_UNIT = {"prop14"}
"""M_ub^0 of (63) mixes 1 with 1/mass."""
DEPENDS_ON_LENGTH_UNIT = {"prop9b"}
"""(39) adds lengths and angles."""


def in_units(mechanism, kilogram: float, metre: float):
    """The same mechanism with its parameters in other units: how many new units a kilogram and a metre make."""
    factor = {"kg": kilogram, "m": metre, "kg m^2": kilogram * metre**2, "m/s": metre, "m/s^2": metre, "": 1.0}
    factor |= {"N": kilogram * metre, "N/m": kilogram}
    return dataclasses.replace(
        mechanism,
        **{
            field.name: getattr(mechanism, field.name) * factor[field.metadata["unit"]]
            for field in dataclasses.fields(mechanism)
            if not field.metadata.get("static") and getattr(mechanism, field.name) is not None
        },
    )


def changed_by(kilogram, metre):
    """Names of the bounds that another choice of units changes, over all scenes."""
    changed = set()
    for mechanism, chart in SCENES:
        other = in_units(mechanism, kilogram, metre)
        there = {name: value * metre if name == "d" else value for name, value in chart.items()}
        before = jc.delassus(mechanism, mechanism.state(**chart))
        after = jc.delassus(other, other.state(**there))
        for name, bound in by_name().items():
            if not np.allclose(bound(before), bound(after), rtol=ROUNDINGS, equal_nan=True):
                changed.add(name)
    return changed


@pytest.mark.slow
def test_grams_for_kilograms_change_proposition_14_alone():
    assert changed_by(kilogram=1e3, metre=1.0) == DEPENDS_ON_MASS_UNIT


def test_millimetres_for_metres_change_proposition_9b_alone():
    assert changed_by(kilogram=1.0, metre=1e3) == DEPENDS_ON_LENGTH_UNIT


def rescaled(row_scale):
    @jc.mechanism
    class Rescaled:
        """The linear bearing with one gap measured in another unit than the others."""

        contacts = LinearBearing().contacts
        gaps = lambda self, q: jnp.array([row_scale, 1.0, 1.0]) * LinearBearing().gaps(q, 0.0)  # noqa: E731
        kinetic_energy = lambda self, q, v: LinearBearing().kinetic_energy(q, v)  # noqa: E731
        slips = lambda self, q, v: LinearBearing().slips(q, v)  # noqa: E731

    return jc.delassus(Rescaled(), jc.State(jnp.zeros(3)))


def test_a_rescaled_row_changes_the_norm_ratio_though_not_the_contact_problem():
    """W becomes D W D and Wt becomes D Wt: lambda is measured in other units, the mechanism is the same."""
    plain, tenfold = rescaled(1.0), rescaled(10.0)
    np.testing.assert_allclose(norm_ratio(plain), 0.25, rtol=ROUNDINGS)
    assert norm_ratio(tenfold) < 0.25 / 3


@pytest.mark.parametrize("unit", [1e-4, 1e4])
def test_the_unit_of_a_gap_changes_neither_motion_nor_the_certificate_of_uniqueness(unit):
    """G_k becomes unit G_k, so lambda_k becomes lambda_k / unit, and the coefficient that belongs to it mu_k unit."""

    @jc.mechanism
    class Rescaled(PainleveKlein):
        gaps = lambda self, q: jnp.array([1.0, unit]) * PainleveKlein().gaps(q)  # noqa: E731

    guides, other = PainleveKlein(gravity=9.81), Rescaled(gravity=9.81)
    mu, units = np.array([0.2, 0.2]), np.array([1.0, unit])
    state = guides.state(theta=0.8, speed=1.0)
    here = jc.contact_forces(guides, state, mu)
    there = jc.contact_forces(other, state, mu * units)
    assert here.unique
    assert there.unique
    assert (np.abs(here.normal) > 0.1).all()
    np.testing.assert_allclose(there.normal * units, here.normal, rtol=ROUNDINGS)
    np.testing.assert_allclose(there.acceleration, here.acceleration, rtol=ROUNDINGS, atol=ROUNDINGS * 9.81)


@pytest.mark.parametrize(("mechanism", "chart"), SCENES, ids=lambda x: type(x).__name__)
def test_compiled_eager_and_batched_values_agree(mechanism, chart):
    def bound(values):
        return norm_ratio(jc.delassus(mechanism, mechanism.state(**values)))

    values = {name: jnp.asarray(value) for name, value in chart.items()}
    eager, compiled = bound(values), jax.jit(bound)(values)
    np.testing.assert_allclose(compiled, eager, rtol=ROUNDINGS)
    if values:
        batch = jax.vmap(bound)(jax.tree.map(lambda x: jnp.stack([x, x + 0.1]), values))
        np.testing.assert_allclose(batch[0], eager, rtol=ROUNDINGS)


def test_the_order_of_contacts_does_not_matter():
    @jc.mechanism
    class Swapped(PainleveKlein):
        contacts = property(lambda self: PainleveKlein().contacts[::-1])
        gaps = lambda self, q: PainleveKlein().gaps(q)[::-1]  # noqa: E731
        slips = lambda self, q, v: PainleveKlein().slips(q, v)[::-1]  # noqa: E731

    ratio = jnp.array([1.0, 3.0])
    here, there = (jc.delassus(g, g.state(theta=0.8)) for g in (PainleveKlein(), Swapped()))
    np.testing.assert_allclose(norm_ratio(here, ratio), norm_ratio(there, ratio[::-1]), rtol=ROUNDINGS)


def test_other_coordinates_of_the_same_rod_give_the_same_operators():
    """The lower tip as reference point instead of the centre of mass."""

    @jc.mechanism
    class FromTheTip:
        contacts = PainleveKlein().contacts

        def kinetic_energy(self, q, v):
            x = v[0] - 0.5 * jnp.sin(q[2]) * v[2]
            y = v[1] + 0.5 * jnp.cos(q[2]) * v[2]
            return 0.5 * (x**2 + y**2) + v[2] ** 2 / 24

        def gaps(self, q):
            upper = q[1] + jnp.sin(q[2])
            return jnp.stack([q[1], upper - jax.lax.stop_gradient(upper)])

        def slips(self, q, v):
            return jnp.stack([v[0], v[0] - jnp.sin(q[2]) * v[2]])

    guides = PainleveKlein()
    here = jc.delassus(guides, guides.state(theta=0.8))
    there = jc.delassus(FromTheTip(), jc.State(jnp.array([0.0, 0.0, 0.8])))
    for name in ("W", "Wt"):
        np.testing.assert_allclose(getattr(here, name), getattr(there, name), rtol=ROUNDINGS, atol=1e-14)


def test_parameters_of_mechanisms_survive_a_round_trip_through_the_tree():
    guides = PainleveKlein(length=1.2, upper_frictional=False)
    leaves, structure = jax.tree.flatten(guides)
    assert jax.tree.unflatten(structure, leaves) == guides
    assert jax.tree.map(lambda x: -x, guides).mass == -1.0  # a tree of derivatives may hold what a mechanism may not
