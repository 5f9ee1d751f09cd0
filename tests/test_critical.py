"""The exact threshold against closed forms, 40-digit references, and the count of solutions on both sides of it."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import critical_systems, table, tables
from systems import (
    binding_vertex,
    contacts_of,
    operators_of,
    random_factors,
)

import jaxcontact as jc
from jaxcontact.bounds import critical, critical_for_signs
from jaxcontact.mechanisms import (
    ArticulatedPainleveKlein,
    FlexiblePainleveKlein,
    GuidedRod,
    GuidedRodUnderCeiling,
    LinearBearing,
    PainleveKlein,
    PainleveRod,
    RodBetweenFloorAndCeiling,
)

# The bar of the project for the exact threshold (numerics.md 14), relative.
BAR = {"float64": 1e-12, "float32": 1e-5}
KINDS = ("b", "u", "bb", "uu", "bu", "bbb", "uuu", "buU")
LARGE = ("bbuB", "bbu", "buu", "bBuU", "bbuu", "bbbb", "uuuu", "bbbbb", "bbbuu", "uuuuu")
LARGE += ("bbbbbb", "bbbuuu", "bbBuuU", "uuuuuu")
ALL_KINDS = [*KINDS, "bbbbbb", *(pytest.param(kinds, marks=pytest.mark.slow) for kinds in LARGE if kinds != "bbbbbb")]
"""The shapes of critical.json. Each is a program to compile: of the large ones the gate takes one."""


def along(mechanism, bound, *names):
    return lambda *at: bound(jc.delassus(mechanism, mechanism.state(**dict(zip(names, at)))))


@functools.cache
def batched(kinds):
    """The threshold of a batch of factors, compiled once for each kind and size."""
    return jax.jit(jax.vmap(lambda N, T: critical(operators_of(N, T, kinds))))


def on_grid(mechanism, bound, **columns):
    return jax.jit(jax.vmap(along(mechanism, bound, *columns)))(*map(jnp.asarray, columns.values()))


@pytest.mark.parametrize("dtype", BAR)
@pytest.mark.parametrize(
    ("key", "column", "mechanism"),
    [
        ("rod_single_contact", "mu_crit", GuidedRod()),
        ("rod_single_contact", "mu_crit", PainleveRod()),
        ("painleve_klein_two_guides", "exact_equal_mu", PainleveKlein()),
        ("painleve_klein_two_guides", "prop12_mixed", PainleveKlein(upper_frictional=False)),
        ("rod_bilateral_unilateral_friction", "exact_box", GuidedRodUnderCeiling()),
        ("painleve_klein_two_guides", "exact_equal_mu", RodBetweenFloorAndCeiling()),
    ],
)
def test_the_rods_have_the_tabled_thresholds(key, column, mechanism, dtype):
    expected = table(key)
    mechanism = jax.tree.map(lambda x: jnp.asarray(x, dtype), mechanism)
    found = on_grid(mechanism, critical, theta=expected["theta"].astype(dtype))
    # In float32 the angle is rounded: cot theta at 1.5 carries 14 times its relative error, which the bar allows.
    np.testing.assert_allclose(np.asarray(found, float), expected[column], rtol=BAR[dtype])


def test_the_flexible_and_the_articulated_systems_have_the_tabled_thresholds():
    for key in ("flexible_painleve_klein_theta", "flexible_painleve_klein_d"):
        rows = table(key)
        theta = rows.get("theta", np.full(len(rows["d"]), np.pi / 3))
        finite = np.isfinite(rows["exact_equal_mu"])
        found = on_grid(FlexiblePainleveKlein(), critical, theta=theta[finite], d=rows["d"][finite])
        np.testing.assert_allclose(found, rows["exact_equal_mu"][finite], rtol=1e-11)
    rows = table("articulated_bent_D0.5")
    found = on_grid(ArticulatedPainleveKlein(), critical, theta1=rows["theta1"], theta2=rows["theta2"])
    np.testing.assert_allclose(found, rows["exact_equal_mu"], rtol=BAR["float64"])


def test_the_linear_bearing_jams_at_half_length_over_offset_whatever_the_scaling_of_its_rows():
    """Igus' 2:1 rule: mu = X / (2 Y); unlike the norm ratio, also for a light or small carriage."""
    for inertia in (1e-3, 0.1, 10.0):
        bearing = LinearBearing(length=1.0, offset=2.0, inertia=inertia)
        np.testing.assert_allclose(critical(jc.delassus(bearing, bearing.state())), 0.25, rtol=BAR["float64"])


@pytest.mark.parametrize("kinds", ALL_KINDS)
@pytest.mark.parametrize("dtype", BAR)
def test_random_systems_agree_with_forty_digits(kinds, dtype):
    N, T, expected = critical_systems(kinds)
    # The data are multiples of 1/8: exact in float32.
    np.testing.assert_allclose(
        np.asarray(batched(kinds)(N.astype(dtype), T.astype(dtype)), float), expected, rtol=BAR[dtype]
    )


@pytest.mark.parametrize("kinds", ["bbb", "uuu", "buU"])
def test_one_solution_below_the_threshold_and_none_or_several_for_every_load_of_the_binding_mode_above(kinds):
    """Enumeration on both sides. Above, the determinant of the binding mode is negative while the signed count of
    solutions of any load is still one or, at a loss of existence, none: a load with a solution there has others."""
    N, T, values = critical_systems(kinds)
    rng = np.random.default_rng(3)
    shape = (len(N), 60, len(kinds))

    @jax.jit
    @functools.partial(jax.vmap, in_axes=(0, 0, 0, 0, 0))
    @functools.partial(jax.vmap, in_axes=(None, None, 0, None, 0))
    def count(N, T, w, r, xi):
        return jc.solutions(operators_of(N, T, kinds, w), jnp.full(len(kinds), r), xi).multiplicity

    below = count(N, T, rng.normal(size=shape), 0.999 * values, rng.choice([-1.0, 1.0], size=shape))
    assert np.all(below == int(jc.Multiplicity.ONE))
    loads, signs = zip(*(_loads_of_the_binding_mode(n, t, 1.02 * r, kinds, rng) for n, t, r in zip(N, T, values)))
    above = count(N, T, np.array(loads), 1.02 * values, np.array(signs))
    assert not np.any(above == int(jc.Multiplicity.ONE))
    assert np.mean(above == int(jc.Multiplicity.MANY)) > 0.9


def _loads_of_the_binding_mode(N, T, r, kinds, rng, count=60):
    """(loads, signs of sliding) solved by forces, and gaps at open contacts, whose sizes are drawn."""
    members, S = binding_vertex(N, T, kinds)
    m = len(kinds)
    closed, sign = np.zeros((2, m))
    closed[members], sign[members] = 1, S
    xi = np.where(sign == 0, 1, sign)
    sizes = rng.uniform(0.1, 1, size=(count, m))
    w = sizes * (1 - closed) - (sizes * closed) @ (N.T @ (N - r * T * xi)).T
    return w, np.broadcast_to(xi, w.shape)


def test_the_fixture_of_two_contacts_has_its_exact_values():
    fixture = tables()["fixture_2_contacts"]
    W, Wt = jnp.array(fixture["A"]), jnp.array(fixture["At"])
    for kinds, key in (("bb", "exact_bilateral"), ("uu", "exact_unilateral_box"), ("bu", "mixed_box_mb1")):
        here = jc.delassus_from_matrices(W, Wt, contacts=contacts_of(kinds))
        np.testing.assert_allclose(critical(here), fixture[key], rtol=BAR["float64"])


def test_a_unilateral_pair_is_lost_at_a_ninth_where_the_bilateral_pair_never_is():
    """The counterexample of mathematics 3(c): A = [[1, 9], [9, 100]], At = A [[0, 0], [1, 0]]."""
    W = jnp.array([[1.0, 9.0], [9.0, 100.0]])
    Wt = W @ jnp.array([[0.0, 0.0], [1.0, 0.0]])
    bilateral, unilateral = (jc.delassus_from_matrices(W, Wt, contacts=contacts_of(kinds)) for kinds in ("bb", "uu"))
    assert critical(bilateral) == jnp.inf
    np.testing.assert_allclose(critical(unilateral), 1 / 9, rtol=BAR["float64"])


def test_a_three_cycle_of_coupling_has_the_cube_root_as_threshold():
    """X = r0 (permutation of three): det(I - r X S) = 1 - (r r0)^3 s1 s2 s3, so r = 1 / r0; smaller sets are safe."""
    X = 0.5 * jnp.roll(jnp.eye(3), 1, axis=1)
    for kinds in ("bbb", "uuu"):
        np.testing.assert_allclose(critical(operators_of(jnp.eye(3), X, kinds)), 2.0, rtol=BAR["float64"])
    assert critical(operators_of(jnp.eye(3), jnp.triu(jnp.ones((3, 3)), 1), "bbb")) == jnp.inf


def test_dependent_gaps_have_threshold_zero_and_smooth_contacts_none():
    N = jnp.array([[1.0, 2.0, 0.3], [0.5, 1.0, 1.0], [0.1, 0.2, 0.0]])
    for kinds in ("bbb", "uuB", "BUb"):
        assert critical(operators_of(N, jnp.ones((3, 3)), kinds)) == 0.0
    assert critical(operators_of(jnp.ones((2, 3)), jnp.ones((2, 3)), "bbb")) == 0.0
    assert critical(operators_of(jnp.eye(3), jnp.zeros((3, 3)), "BUU")) == jnp.inf
    assert critical(operators_of(jnp.eye(3), jnp.zeros((3, 3)), "bbb")) == jnp.inf
    slope = jax.grad(lambda N: critical(operators_of(N, jnp.ones((3, 3)), "bbb")))(N)
    assert jnp.all(jnp.isfinite(slope))


def test_nan_operators_give_nan_and_leave_other_lanes_alone():
    N, T = random_factors("bbb", 12, seed=4)
    poisoned = np.array(N)
    poisoned[1, 0, 0] = np.nan
    clean, dirty = (np.asarray(batched("bbb")(x, T)) for x in (N, poisoned))
    assert np.isnan(dirty[1])
    others = np.arange(12) != 1
    assert not np.isnan(clean).any()
    np.testing.assert_array_equal(dirty[others], clean[others])


def test_ratio_of_frictionless_contacts_is_ignored_and_the_threshold_scales_with_the_rest():
    N, T = random_factors("bBu", 1, seed=5)
    here = operators_of(N[0], T[0], "bBu")
    plain = critical(here, jnp.array([1.0, jnp.nan, 1.0]))
    np.testing.assert_allclose(plain, critical(here), rtol=1e-15)
    np.testing.assert_allclose(critical(here, jnp.array([2.0, -3.0, 2.0])), plain / 2, rtol=BAR["float64"])


def test_rows_in_other_units_leave_the_threshold_alone():
    """Gap i in other units: column i of N and, the friction law being homogeneous, of T scale together."""
    N, T = random_factors("bbb", 1, seed=6)
    units = jnp.array([[1e-6, 1.0, 1e5]])
    plain, scaled = (critical(operators_of(N[0] * s, T[0] * s, "bbb")) for s in (jnp.ones((1, 3)), units))
    np.testing.assert_allclose(scaled, plain, rtol=BAR["float64"])


@pytest.mark.parametrize("kinds", ["bb", *(pytest.param(kinds, marks=pytest.mark.slow) for kinds in ("bbb", "uuu"))])
def test_gradients_agree_with_central_differences_and_reverse_with_forward_mode(kinds):
    N, T = random_factors(kinds, 70, seed=7)
    D, E = random_factors(kinds, 70, seed=8)

    def value(N, T):
        return critical(operators_of(N, T, kinds))

    h = 1e-6
    compiled = batched(kinds)
    slope = jax.jit(jax.vmap(lambda *x: jax.jvp(value, x[:2], x[2:])[1]))(N, T, D, E)
    grads = jax.jit(jax.vmap(jax.grad(value, (0, 1))))(N, T)
    reverse = np.sum(grads[0] * D, (1, 2)) + np.sum(grads[1] * E, (1, 2))
    np.testing.assert_allclose(reverse, slope, rtol=1e-9)
    difference = (compiled(N + h * D, T + h * E) - compiled(N - h * D, T - h * E)) / (2 * h)
    far = (compiled(N + 1e-3 * D, T + 1e-3 * E) - compiled(N - 1e-3 * D, T - 1e-3 * E)) / 2e-3
    # Near a kink the two differences disagree: those points are left out, and most remain.
    smooth = np.abs(difference / far - 1) < 0.05
    assert smooth.mean() > 0.8
    np.testing.assert_allclose(slope[smooth], difference[smooth], rtol=1e-5)


@pytest.mark.slow
def test_second_derivatives_follow_the_closed_form_and_the_difference_of_gradients():
    guides = PainleveKlein()
    theta = jnp.linspace(0.2, 1.4, 5)
    second = jax.vmap(jax.grad(jax.grad(along(guides, critical, "theta"))))(theta)
    np.testing.assert_allclose(second, 2 * jnp.cos(theta) / jnp.sin(theta) ** 3, rtol=1e-10)
    N, T = random_factors("bbb", 1, seed=9)

    def slope(s):
        return jax.jvp(lambda s: critical(operators_of(N[0] + s * T[0], T[0] + s * N[0], "bbb")), (s,), (1.0,))[1]

    np.testing.assert_allclose(jax.grad(slope)(0.0), (slope(1e-5) - slope(-1e-5)) / 2e-5, rtol=1e-6)


def test_gradients_are_finite_where_contacts_are_alike_and_decoupled():
    """Two or three equal contacts that do not feel each other: every vertex binds at once."""
    for m, kinds in ((2, "bb"), (2, "uu"), (3, "bbb"), (3, "uuu")):
        slope = jax.grad(lambda T, m=m, k=kinds: critical(operators_of(jnp.eye(m), T, k)))(0.5 * jnp.eye(m))
        assert jnp.all(jnp.isfinite(slope)), kinds
        # One contact alone has 1 / t with slope -4 at t = 1/2; every element of Clarke's set shares that among them.
        np.testing.assert_allclose(jnp.sum(slope), -4.0, rtol=1e-9)


def test_a_given_sign_matters_at_unilateral_contacts_only():
    """Mathematics 1.10: mu_b < (1 + 3 c^2) / (3 s c) and mu_b + xi_u mu_u < 2 cot theta, each from zero."""
    theta = 0.9
    rod = GuidedRodUnderCeiling()
    here = jc.delassus(rod, rod.state(theta=theta))
    s, c = np.sin(theta), np.cos(theta)
    alone = (1 + 3 * c * c) / (3 * s * c)
    for xi_u, expected in ((1.0, min(alone, c / s)), (-1.0, min(alone, 2 * c / s))):
        found = [critical_for_signs(here, jnp.array([xi_b, xi_u])) for xi_b in (1.0, -1.0)]
        np.testing.assert_allclose(found, expected, rtol=BAR["float64"])
    N, T = random_factors("bbb", 1, seed=10)
    free = operators_of(N[0], T[0], "bbb")
    np.testing.assert_allclose(critical_for_signs(free, jnp.array([1.0, -1.0, 1.0])), critical(free), rtol=1e-12)


def test_too_many_contacts_are_refused_with_the_name_of_the_bracket():
    with pytest.raises(ValueError, match="critical_bracket"):
        critical(operators_of(jnp.eye(16), jnp.eye(16), "b" * 16))
