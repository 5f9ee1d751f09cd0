"""Every rung below the next, each at its closed forms, none offered where it is false."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import table, tables
from systems import contacts_of, operators_of, random_factors

import jaxcontact as jc
from jaxcontact import bounds
from jaxcontact.bounds.scaling import path_end, scaled_norm
from jaxcontact.mechanisms import (
    ArticulatedPainleveKlein,
    FlexiblePainleveKlein,
    GuidedRod,
    GuidedRodUnderCeiling,
    LinearBearing,
    PainleveKlein,
    PainleveRod,
    RodBetweenFloorAndCeiling,
    all_mechanisms,
)

BILATERAL = ("norm_ratio", "operator_norm", "best_scaling", "critical")
ANY = ("direct", "sharper_direct", "positive_definite_radius", "critical")

# The ladder's bar (numerics.md 14): the order is never violated beyond 8 roundings.
ORDER = {"float64": 8 * 2.2e-16, "float32": 8 * 1.2e-7}


@functools.cache
def batched(name, kinds):
    bound = bounds.by_name()[name]
    return jax.jit(jax.vmap(lambda N, T: bound(operators_of(N, T, kinds))))


@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("kinds", "names"), [("bbb", BILATERAL), ("uuu", ANY), ("bu", ANY)])
def test_every_rung_is_below_the_next_on_ten_thousand_random_systems(kinds, names, dtype):
    N, T = (x.astype(dtype) for x in random_factors(kinds, 4000 if kinds == "uuu" else 3000, seed=11))
    values = [np.asarray(batched(name, kinds)(N, T), float) for name in names]
    # In float32 a rung carries the condition of its factors on top of its rounding: systems below 100 are compared.
    fair = np.linalg.cond(N.astype(float)) < (np.inf if dtype == "float64" else 10)
    for lower, upper, a, b in zip(names, names[1:], values, values[1:]):
        assert np.all(a[fair] <= b[fair] * (1 + ORDER[dtype])), (lower, upper)
        assert np.median(a / b) < 1 - 1e-3 or (lower, upper) == ("best_scaling", "critical"), (lower, upper)
    if kinds == "bbb":
        root = np.asarray(batched("perron", kinds)(N, T), float)
        assert np.all(root[fair] <= values[2][fair] * (1 + ORDER[dtype]))


def test_perron_and_the_operator_norm_are_not_comparable():
    """The two examples of mathematics 3(c)."""
    for X, norm, root in (
        ([[0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]], 1.0, 2**-0.5),
        ([[0.0, 100.0], [0.01, 0.0]], 0.01, 1.0),
    ):
        here = operators_of(jnp.eye(2), jnp.array(X), "bb")
        np.testing.assert_allclose([bounds.operator_norm(here), bounds.perron(here)], [norm, root], rtol=1e-14)


def test_the_operator_norm_of_the_guides_and_of_the_fixture_is_tabled():
    rows = table("painleve_klein_two_guides")
    guides = PainleveKlein()
    found = jax.vmap(lambda t: bounds.operator_norm(jc.delassus(guides, guides.state(theta=t))))(
        jnp.asarray(rows["theta"])
    )
    np.testing.assert_allclose(found, rows["one_over_norm_AinvAt"], rtol=1e-12)
    fixture = tables()["fixture_2_contacts"]
    here = jc.delassus_from_matrices(jnp.array(fixture["A"]), jnp.array(fixture["At"]), contacts=contacts_of("bb"))
    np.testing.assert_allclose(bounds.operator_norm(here), fixture["one_over_norm"], rtol=1e-12)
    np.testing.assert_allclose(bounds.best_scaling(here), fixture["exact_bilateral"], rtol=1e-12)


def test_for_two_bilateral_contacts_the_best_scaling_is_exact():
    N, T = random_factors("bb", 500, seed=12)
    np.testing.assert_allclose(batched("best_scaling", "bb")(N, T), batched("critical", "bb")(N, T), rtol=1e-13)


@pytest.mark.parametrize("m", [3, 5])
def test_multipliers_prove_that_no_scaling_has_a_smaller_norm(m):
    """log lambda is convex in t; a Z >= 0 of trace one along which its slope is zero makes it least at <Z, G>."""
    N, T = random_factors("b" * m, 500, seed=11)
    X = np.stack([np.linalg.lstsq(n, t, rcond=None)[0] for n, t in zip(N, T)])
    X /= np.abs(X).max(axis=(1, 2), keepdims=True)
    end = jax.tree.map(np.asarray, jax.jit(jax.vmap(path_end))(X))
    Y = X * np.exp(end.t[:, None, :] - end.t[:, :, None])
    G = np.swapaxes(Y, 1, 2) @ Y
    top = np.linalg.eigvalsh(G)[:, -1]
    slope = np.einsum("kij,kij->ki", end.Z, G) - np.einsum("kij,kjl,kil->ki", Y, end.Z, Y)
    assert np.linalg.eigvalsh(end.Z).min() > -1e-12
    np.testing.assert_allclose(np.trace(end.Z, axis1=1, axis2=2), 1, rtol=1e-6)
    # The path stops at 8 roundings, or where rounding disturbs its equations by 1.5e-8, the root of one rounding.
    gap = 1 - np.sum(end.Z * G, axis=(1, 2)) / np.trace(end.Z, axis1=1, axis2=2) / top
    assert gap.max() < 1e-7
    assert np.quantile(gap, 0.9) < 1e-11
    assert (np.abs(slope).max(axis=1) / top).max() < 1e-6
    second = np.linalg.eigvalsh(G)[:, -2] / top
    assert np.mean(second > 1 - 1e-9) > 0.1  # repeated at the minimum


@pytest.mark.slow
def test_scaling_away_what_no_cycle_joins():
    """Entries of a triangle vanish for D growing along it: the largest diagonal entry is left, or nothing."""
    X = jnp.triu(jnp.ones((3, 3)), 1)
    np.testing.assert_allclose(scaled_norm(X + jnp.diag(jnp.array([0.1, 0.3, 0.2]))), 0.3, rtol=1e-14)
    assert scaled_norm(X) == 0
    assert jnp.all(jnp.isfinite(jax.grad(scaled_norm)(X)))
    assert jnp.isnan(scaled_norm(X.at[2, 0].set(jnp.nan)))
    np.testing.assert_allclose(jnp.sum(jax.grad(scaled_norm)(0.5 * jnp.eye(3))), 1.0, rtol=1e-14)


@pytest.mark.slow
def test_second_derivatives_of_the_scaled_norm_follow_differences_of_the_first():
    N, T = random_factors("bbb", 40, seed=15)
    X = jnp.stack([jnp.linalg.lstsq(n, t)[0] for n, t in zip(jnp.asarray(N), jnp.asarray(T))])
    D = jnp.asarray(random_factors("bbb", 40, seed=16)[0][:, :3])

    def slope(X, D):
        return jax.jvp(scaled_norm, (X,), (D,))[1]

    second = jax.jit(jax.vmap(lambda X, D: jax.jvp(lambda X: slope(X, D), (X,), (D,))[1]))(X, D)
    first = jax.jit(jax.vmap(slope))
    near, far = (np.asarray((first(X + h * D, D) - first(X - h * D, D)) / (2 * h)) for h in (1e-5, 2e-5))
    # Second derivatives jump where a singular value joins the largest; a point near such a place is left out.
    error = np.abs(second - near) / (np.abs(near) + np.median(np.abs(near)))
    smooth = np.abs(near - far) < 1e-4 * (np.abs(near) + np.median(np.abs(near)))
    assert smooth.mean() > 0.8
    assert np.quantile(error[smooth], 0.9) < 1e-4


@pytest.mark.parametrize("name", ["operator_norm", "perron", "best_scaling"])
def test_a_bilateral_rung_is_not_offered_for_unilateral_contacts_where_it_is_false(name):
    W = jnp.array([[1.0, 9.0], [9.0, 100.0]])
    Wt = W @ jnp.array([[0.0, 0.0], [1.0, 0.0]])
    bound = bounds.by_name()[name]
    bilateral, unilateral = (jc.delassus_from_matrices(W, Wt, contacts=contacts_of(kinds)) for kinds in ("bb", "uu"))
    assert bound(bilateral) > 9 * bounds.critical(unilateral) * (1 - 1e-12)
    assert jnp.isnan(bound(unilateral))
    assert "unilateral" in bound.reason(unilateral)
    assert bound.reason(bilateral) == ""


RUNGS = ("operator_norm", "perron", "best_scaling", "sharper_direct", "positive_definite_radius", "critical")


def derivatives_agree(values, at, along, tolerance):
    """Forward derivatives of values (p,) -> (k,) at a batch of points against central differences, where these agree
    with those of twice the step: kinks and steep bends are left out. Returns the share that was compared."""
    compiled = jax.jit(jax.vmap(values))
    slope = np.asarray(jax.jit(jax.vmap(lambda p, d: jax.jvp(values, (p,), (d,))[1]))(at, along))
    assert np.all(np.isfinite(slope))
    size = np.abs(np.asarray(compiled(at)))
    near, far = (np.asarray(compiled(at + h * along) - compiled(at - h * along)) / (2 * h) for h in (1e-5, 2e-5))
    smooth = np.abs(near - far) <= 0.3 * tolerance * (np.abs(near) + size)
    assert np.all(np.abs(slope - near)[smooth] <= tolerance * (np.abs(near) + size)[smooth])
    return smooth.mean(axis=0)


CHARTS = {
    "GuidedRod": (lambda p: (GuidedRod(length=p[1]), {"theta": p[0]}), (0.2, 0.6), (1.4, 1.5)),
    "PainleveRod": (lambda p: (PainleveRod(length=p[1]), {"theta": p[0]}), (0.2, 0.6), (1.4, 1.5)),
    "GuidedRodUnderCeiling": (lambda p: (GuidedRodUnderCeiling(length=p[1]), {"theta": p[0]}), (0.2, 0.6), (1.4, 1.5)),
    "PainleveKlein": (lambda p: (PainleveKlein(length=p[1]), {"theta": p[0]}), (0.2, 0.6), (1.4, 1.5)),
    "RodBetweenFloorAndCeiling": (
        lambda p: (RodBetweenFloorAndCeiling(length=p[1]), {"theta": p[0]}),
        (0.2, 0.6),
        (1.4, 1.5),
    ),
    "FlexiblePainleveKlein": (lambda p: (FlexiblePainleveKlein(), {"theta": p[0], "d": p[1]}), (0.2, 0.0), (1.4, 2.0)),
    "ArticulatedPainleveKlein": (
        lambda p: (ArticulatedPainleveKlein(), {"theta1": p[0], "theta2": p[1]}),
        (0.2, 0.3),
        (1.4, 1.3),
    ),
    "LinearBearing": (lambda p: (LinearBearing(length=p[0], offset=p[1]), {}), (0.5, 0.5), (2.0, 3.0)),
}
"""Mechanism -> (two numbers -> mechanism and chart, their lower ends, their upper ends)."""


LONG = {"ArticulatedPainleveKlein", "FlexiblePainleveKlein", "LinearBearing", "RodBetweenFloorAndCeiling"}
"""Half a minute or more to compile, and alike to the others."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in all_mechanisms()]
)
def test_derivatives_of_every_bound_at_two_hundred_points_of_every_mechanism(name):
    make, low, high = CHARTS[name]

    def operators(p):
        mechanism, chart = make(p)
        return jc.delassus(mechanism, mechanism.state(**chart))

    contacts = operators(jnp.array(low)).contacts
    meant = [b for b in bounds.by_name().values() if not getattr(b, "reason", lambda _: "")(Speaking(contacts))]

    def values(p):
        here = operators(p)
        return jnp.stack([bound(here) for bound in meant])

    rng = np.random.default_rng(17)
    at, along = rng.uniform(low, high, size=(200, 2)), rng.normal(size=(200, 2))
    # numerics.md 18: 1e-6 against central differences.
    assert np.all(derivatives_agree(values, at, along, 1e-6) > 0.9)


class Speaking(NamedTuple):
    """All that a bound's reason looks at."""

    contacts: tuple


@pytest.mark.slow
@pytest.mark.parametrize("kinds", ["bbb", "uuu"])
def test_derivatives_of_the_rungs_at_two_hundred_random_systems(kinds):
    names = [n for n in RUNGS if not (kinds == "uuu" and n in ("operator_norm", "perron", "best_scaling"))]
    at, along = (np.concatenate(random_factors(kinds, 200, seed=s), axis=1).reshape(200, -1) for s in (13, 14))

    def values(p):
        N, T = p.reshape(2, 4, 3)
        return jnp.stack([bounds.by_name()[name](operators_of(N, T, kinds)) for name in names])

    # Random systems bend more sharply than the mechanisms: the differences themselves are good to 1e-6 at fewer points.
    assert np.all(derivatives_agree(values, at, along, 1e-6) > 0.6)


@pytest.mark.parametrize(
    "name", ["operator_norm", "perron", "best_scaling", "sharper_direct", "positive_definite_radius"]
)
def test_rungs_keep_their_ends(name):
    bound = bounds.by_name()[name]
    assert bound(operators_of(jnp.eye(2), jnp.zeros((2, 2)), "BB")) == jnp.inf
    assert bound(operators_of(jnp.ones((2, 2)), jnp.eye(2), "bb")) == 0.0


def test_a_smooth_guide_is_eliminated_before_the_rungs_are_taken():
    """Mathematics 1.10: with a smooth guide Proposition 15 is 2 cot theta, and so are the exact value and the rungs."""
    rod = GuidedRodUnderCeiling(guide_frictional=False)
    here = jc.delassus(rod, rod.state(theta=0.9))
    found = [bounds.by_name()[name](here) for name in ("sharper_direct", "positive_definite_radius", "critical")]
    np.testing.assert_allclose(found, 2 / np.tan(0.9), rtol=1e-12)
