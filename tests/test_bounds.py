"""The bounds against the closed forms and 50-digit tables of the tutorial's examples, in both precisions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp
from reference import table, tables

import jaxcontact as jc
from jaxcontact.bounds import by_name, norm_ratio, slopes
from jaxcontact.bounds.proposition14 import _Blocks
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

# The bars of the project: 1e-12 relative in float64; 2e-6 in float32, which is 17 roundings.
BAR = {"float64": 1e-12, "float32": 2e-6}
DTYPES = ("float64", "float32")


def along(mechanism, bound, *names):
    """The bound as a function of named chart coordinates."""

    def at(*values):
        return bound(jc.delassus(mechanism, mechanism.state(**dict(zip(names, values)))))

    return at


def on_grid(mechanism, bound, **columns):
    return jax.jit(jax.vmap(along(mechanism, bound, *columns)))(*map(jnp.asarray, columns.values()))


SINGLE = {
    ("rod_single_contact", "mu_crit", GuidedRod, norm_ratio),
    ("rod_single_contact", "mu_crit", GuidedRod, jc.bounds.prop10),
    ("rod_single_contact", "mu_crit", PainleveRod, jc.bounds.prop13),
    ("rod_single_contact", "mu_crit", PainleveRod, jc.bounds.direct),
    ("rod_single_contact", "prop11", GuidedRod, jc.bounds.prop11),
    ("rod_single_contact", "prop9b_root_l1", GuidedRod, jc.bounds.prop9b),
    ("painleve_klein_two_guides", "prop10", PainleveKlein, jc.bounds.prop9a),
    ("painleve_klein_two_guides", "prop10", PainleveKlein, norm_ratio),
    ("painleve_klein_two_guides", "prop11", PainleveKlein, jc.bounds.prop11),
    ("painleve_klein_two_guides", "prop9b_root_l1", PainleveKlein, jc.bounds.prop9b),
    ("rod_bilateral_unilateral_friction", "direct_mixed", GuidedRodUnderCeiling, jc.bounds.direct),
    ("rod_bilateral_unilateral_friction", "direct_mixed", GuidedRodUnderCeiling, norm_ratio),
    ("rod_bilateral_unilateral_friction", "prop14_min_over_xi", GuidedRodUnderCeiling, jc.bounds.prop14),
}


@pytest.mark.parametrize(("key", "column", "mechanism", "bound"), sorted(SINGLE, key=str))
def test_bounds_along_theta_are_the_tabled_ones(key, column, mechanism, bound):
    expected = table(key)
    np.testing.assert_allclose(
        on_grid(mechanism(), bound, theta=expected["theta"]), expected[column], rtol=BAR["float64"]
    )


def test_one_smooth_guide_gives_proposition_12():
    expected = table("painleve_klein_two_guides")
    for smooth in ("lower_frictional", "upper_frictional"):
        found = on_grid(PainleveKlein(**{smooth: False}), norm_ratio, theta=expected["theta"])
        np.testing.assert_allclose(found, expected["prop12_mixed"], rtol=BAR["float64"])


def test_a_smooth_guide_under_a_rough_ceiling_gives_proposition_15():
    expected = table("rod_bilateral_unilateral_friction")
    for bound in (norm_ratio, jc.bounds.prop15):
        found = on_grid(GuidedRodUnderCeiling(guide_frictional=False), bound, theta=expected["theta"])
        np.testing.assert_allclose(found, expected["prop15"], rtol=BAR["float64"])


@pytest.mark.parametrize(("column", "signs"), [("pp", (1, 1)), ("pm", (1, -1)), ("mp", (-1, 1)), ("mm", (-1, -1))])
def test_proposition_14_for_given_signs_is_the_tabled_first_crossing(column, signs):
    expected = table("rod_bilateral_unilateral_friction")

    def bound(operators):
        return jc.bounds.prop14(operators, xi=jnp.array(signs, operators.N.dtype))

    found = on_grid(GuidedRodUnderCeiling(), bound, theta=expected["theta"])
    np.testing.assert_allclose(found, expected[f"prop14_{column}"], rtol=BAR["float64"])


def test_proposition_14_depends_on_the_unit_of_mass_and_the_direct_bound_does_not():
    """Mathematics, section 2: at theta = 0.9, 0.243 for m = 1 and 0.0014 (two digits) for m = 1000."""
    light, heavy = (GuidedRodUnderCeiling(mass=m) for m in (1.0, 1000.0))
    at = [jc.delassus(rod, rod.state(theta=0.9)) for rod in (light, heavy)]
    assert [f"{float(jc.bounds.prop14(here)):.3g}" for here in at] == ["0.243", "0.00139"]
    np.testing.assert_allclose(jc.bounds.direct(at[0]), jc.bounds.direct(at[1]), rtol=BAR["float64"])


@pytest.mark.parametrize("key", ["flexible_painleve_klein_theta", "flexible_painleve_klein_d"])
def test_the_flexible_system_has_the_tabled_bound(key):
    expected = table(key)
    theta = expected.get("theta", np.full_like(expected["d"], np.pi / 3))
    found = on_grid(FlexiblePainleveKlein(), norm_ratio, theta=theta, d=expected["d"])
    np.testing.assert_allclose(found, expected["prop10"], rtol=BAR["float64"])
    one_rough = on_grid(FlexiblePainleveKlein(upper_frictional=False), norm_ratio, theta=theta, d=expected["d"])
    np.testing.assert_allclose(one_rough, expected["exact_single_frictional"], rtol=BAR["float64"])


def test_the_flexible_bound_has_its_pole_where_the_tangential_coupling_vanishes():
    """A_tb = 0 at d = -2l/3; in floating point the coupling is a rounding there, and the bound is beyond 1 / eps."""
    rods = FlexiblePainleveKlein()
    pole = along(rods, norm_ratio, "theta", "d")(jnp.asarray(1.0), jnp.asarray(-2 / 3))
    assert pole > 0.01 / np.finfo(float).eps


def test_the_straight_articulated_system_has_bound_cot_theta():
    expected = table("articulated_straight")
    found = on_grid(ArticulatedPainleveKlein(), norm_ratio, theta1=expected["theta"])
    np.testing.assert_allclose(found, expected["prop10"], rtol=BAR["float64"])


def test_the_bent_articulated_system_has_the_tabled_bounds():
    expected = table("articulated_bent_D0.5")
    links = ArticulatedPainleveKlein(spacing=0.5)
    np.testing.assert_allclose(
        jax.vmap(lambda t: links.state(theta1=t).q[3])(jnp.asarray(expected["theta1"])), expected["theta2"], rtol=1e-14
    )
    for bound, column in ((norm_ratio, "prop10"), (jc.bounds.prop11, "prop11"), (jc.bounds.prop9b, "prop9b_root_l1")):
        found = on_grid(links, bound, theta1=expected["theta1"])
        np.testing.assert_allclose(found, expected[column], rtol=BAR["float64"])
    for smooth, column in (("upper_frictional", "prop12_lower_only"), ("lower_frictional", "prop12_upper_only")):
        links = ArticulatedPainleveKlein(spacing=0.5, **{smooth: False})
        np.testing.assert_allclose(
            on_grid(links, norm_ratio, theta1=expected["theta1"]), expected[column], rtol=BAR["float64"]
        )


def test_floor_and_ceiling_together_bear_the_painleve_klein_bound():
    """Mathematics, section 4, row Prop 13: min(1/(3sc), cot)."""
    theta = np.linspace(0.1, 1.5, 15)
    expected = np.minimum(1 / (3 * np.sin(theta) * np.cos(theta)), 1 / np.tan(theta))
    found = on_grid(RodBetweenFloorAndCeiling(), jc.bounds.prop13, theta=theta)
    np.testing.assert_allclose(found, expected, rtol=BAR["float64"])


# --- both precisions, both ends of the angle, value and derivative: closed forms in mpmath at the rounded angle


def _rod(t):
    return (1 + 3 * mp.cos(t) ** 2) / (3 * mp.sin(t) * mp.cos(t))


def _klein(t):
    return min(1 / (3 * mp.sin(t) * mp.cos(t)), mp.cot(t))


def _flexible(d):
    return lambda t: (3 * d * d + 3 * d + 1) / ((3 * d + 2) * mp.sin(t) * mp.cos(t))


def _articulated(t):
    """Mathematics 1.7 with theta_2 = 1/4."""
    t2 = mp.mpf(0.25)
    C1, C2, S1, S2 = mp.cos(2 * t), mp.cos(2 * t2), mp.sin(2 * t), mp.sin(2 * t2)
    g, s = mp.cos(2 * (t - t2)), mp.sin(2 * (t - t2))
    top = 164 + 48 * (C1 + C2) - 36 * g - mp.sqrt(3600 * (C1 - C2) ** 2 + (36 * g - 4) ** 2)
    return top / (mp.sqrt(2304 * (S1 + S2) ** 2 + 1296 * s * s) + 60 * abs(S1 - S2))


CLOSED = {
    "guided rod": (GuidedRod(), "theta", {}, _rod),
    "floor": (PainleveRod(), "theta", {}, _rod),
    "painleve-klein": (PainleveKlein(), "theta", {}, _klein),
    "one smooth guide": (PainleveKlein(upper_frictional=False), "theta", {}, lambda t: 2 * mp.cot(t)),
    "guide and ceiling": (GuidedRodUnderCeiling(), "theta", {}, _klein),
    "smooth guide, ceiling": (GuidedRodUnderCeiling(guide_frictional=False), "theta", {}, lambda t: 2 * mp.cot(t)),
    "flexible, d = 1": (FlexiblePainleveKlein(), "theta", {"d": 1.0}, _flexible(1)),
    "bent links": (ArticulatedPainleveKlein(), "theta1", {"theta2": 0.25}, _articulated),
    "straight links": (ArticulatedPainleveKlein(), "theta1", {}, mp.cot),
}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("scene", CLOSED)
def test_value_and_slope_hold_to_the_ends_of_the_angle(scene, dtype):
    """At theta = 1e-5, pi/2 - 1e-5 and between: relative to the bound, and the slope relative to itself plus the
    bound."""
    mechanism, name, fixed, closed = CLOSED[scene]
    theta = np.array([1e-5, 1e-3, 0.1, 0.5, 0.9, 1.2, 1.5, np.pi / 2 - 1e-3, np.pi / 2 - 1e-5]).astype(dtype)

    def bound(t):
        return norm_ratio(jc.delassus(mechanism, mechanism.state(**{name: t}, **fixed)))

    def both(t):
        return jax.jvp(bound, (t,), (jnp.ones_like(t),))

    value, slope = jax.jit(jax.vmap(both))(jnp.asarray(theta))
    assert value.dtype == slope.dtype == dtype
    with mp.workdps(50):
        expected = np.array([float(closed(mp.mpf(float(t)))) for t in theta])
        expected_slope = np.array([float(mp.diff(closed, mp.mpf(float(t)))) for t in theta])
    np.testing.assert_allclose(np.asarray(value, float), expected, rtol=BAR[dtype])
    error = np.abs(np.asarray(slope, float) - expected_slope) / (np.abs(expected_slope) + expected)
    assert error.max() < BAR[dtype]


@pytest.mark.parametrize("scene", CLOSED)
def test_reverse_mode_agrees_with_forward_mode_in_every_parameter_and_coordinate(scene):
    mechanism, name, fixed, _ = CLOSED[scene]

    def bound(mechanism, t):
        return norm_ratio(jc.delassus(mechanism, mechanism.state(**{name: t}, **fixed)))

    at = (mechanism, jnp.asarray(0.8))
    reverse, forward = jax.jit(jax.grad(bound, (0, 1)))(*at), jax.jit(jax.jacfwd(bound, (0, 1)))(*at)
    for left, right in zip(jax.tree.leaves(reverse), jax.tree.leaves(forward), strict=True):
        assert np.isfinite(left)
        np.testing.assert_allclose(left, right, rtol=BAR["float64"], atol=1e-14)


def test_the_linear_bearing_jams_at_a_quarter_by_the_two_to_one_rule():
    bearing = LinearBearing(length=0.1, offset=0.2, mass=3.0, inertia=0.02)
    np.testing.assert_allclose(norm_ratio(jc.delassus(bearing, bearing.state())), 0.25, rtol=BAR["float64"])


def test_the_linear_bearing_bound_is_length_over_twice_the_offset_with_its_derivatives():
    def bound(bearing):
        return norm_ratio(jc.delassus(bearing, bearing.state()))

    X, Y = 0.3, 0.5
    value, slope = jax.value_and_grad(bound)(LinearBearing(length=X, offset=Y))
    np.testing.assert_allclose(value, X / (2 * Y), rtol=BAR["float64"])
    np.testing.assert_allclose(slope.length, 1 / (2 * Y), rtol=BAR["float64"])
    np.testing.assert_allclose(slope.offset, -X / (2 * Y**2), rtol=BAR["float64"])
    np.testing.assert_allclose([slope.mass, slope.inertia], [0, 0], atol=1e-14)


def test_the_ratio_of_coefficients_scales_the_bound_and_ignores_smooth_contacts():
    guides = PainleveKlein(upper_frictional=False)
    here = jc.delassus(guides, guides.state(theta=0.9))
    np.testing.assert_allclose(norm_ratio(here, jnp.array([2.0, jnp.nan])), 0.5 * norm_ratio(here), rtol=BAR["float64"])


# --- kinks


def _family(case):
    if case.startswith("painleve_klein"):
        guides = PainleveKlein()
        return lambda t: jc.delassus(guides, guides.state(theta=t))
    links = ArticulatedPainleveKlein(spacing=0.5 if "2D/l=1 " in case else 0.6)
    return lambda t: jc.delassus(links, links.state(theta1=t))


@pytest.mark.parametrize("case", [row[0] for row in tables()["kinks"]["rows"]])
def test_kinks_are_seen_with_their_tabled_one_sided_slopes(case):
    """The tabled points are rounded to float64: singular values coincide there to a few roundings times the slopes."""
    _, at, value, left, right = next(row for row in tables()["kinks"]["rows"] if row[0] == case)
    family = _family(case)
    found = slopes(family, at, 1.0)
    assert found.kink
    np.testing.assert_allclose([found.value, found.left, found.right], [value, left, right], rtol=BAR["float64"])
    gradient = jax.grad(lambda t: norm_ratio(family(t)))(at)
    assert min(left, right) * (1 + 1e-12) - 1e-12 <= gradient <= max(left, right) + 1e-12
    assert not slopes(family, at + 0.01, 1.0).kink


def test_along_the_straight_links_there_is_a_kink_across_and_none_along():
    """Mathematics 3(f): at theta_1 = theta_2 = 0.7 one-sided slopes -+0.36199 along (1, -1)/sqrt 2, smooth along (1,
    1)."""
    links = ArticulatedPainleveKlein()

    def family(angles):
        return jc.delassus(links, links.state(theta1=angles[0], theta2=angles[1]))

    at = jnp.array([0.7, 0.7])
    across = slopes(family, at, jnp.array([1.0, -1.0]) / np.sqrt(2))
    assert across.kink
    np.testing.assert_allclose(sorted([across.left, across.right]), [-0.36199, 0.36199], atol=5e-6)
    straight = slopes(family, at, jnp.array([1.0, 1.0]))
    assert not straight.kink
    np.testing.assert_allclose(straight.left, -1 / np.sin(0.7) ** 2, rtol=BAR["float64"])
    assert np.isfinite(jax.grad(lambda a: norm_ratio(family(a)))(at)).all()


def test_one_sided_slopes_are_the_derivative_where_there_is_no_kink():
    guides = PainleveKlein()

    def family(t):
        return jc.delassus(guides, guides.state(theta=t))

    smooth = slopes(family, 0.6, 1.0)
    derivative = jax.grad(lambda t: norm_ratio(family(t)))(0.6)
    np.testing.assert_allclose([smooth.left, smooth.right], [derivative] * 2, rtol=BAR["float64"])


# --- values where a hypothesis fails


def test_without_friction_every_bound_that_applies_is_infinite():
    for mechanism in (PainleveKlein(lower_frictional=False, upper_frictional=False), PainleveRod(frictional=False)):
        here = jc.delassus(mechanism, mechanism.state(theta=0.9))
        assert norm_ratio(here) == jnp.inf
        assert jc.bounds.direct(here) == jnp.inf


def test_without_contacts_the_bound_is_infinite():
    @jc.mechanism
    class Free:
        contacts = ()

        def kinetic_energy(self, q, v):
            return 0.5 * jnp.sum(v**2)

        def gaps(self, q):
            return q[:0]

    here = jc.delassus(Free(), jc.State(jnp.zeros(2)))
    assert here.W.shape == (0, 0)
    assert norm_ratio(here) == jnp.inf


def test_dependent_gaps_have_bound_zero():
    """The same guide twice: W is singular, the hypothesis of every proposition fails."""

    @jc.mechanism
    class Doubled:
        contacts = (jc.Contact("one", "bilateral", True), jc.Contact("same", "bilateral", True))

        def kinetic_energy(self, q, v):
            return 0.5 * jnp.sum(v**2) + 0.2 * v[0] * v[1]

        def gaps(self, q):
            return jnp.stack([q[1], q[1]])

        def slips(self, q, v):
            return jnp.stack([v[0], v[0]])

    assert norm_ratio(jc.delassus(Doubled(), jc.State(jnp.zeros(2)))) == 0.0


@pytest.mark.parametrize("name", sorted(by_name()))
def test_a_proposition_that_does_not_fit_the_contacts_is_nan_and_says_why(name):
    bound = by_name()[name]
    rods = (PainleveKlein(), PainleveKlein(upper_frictional=False), PainleveRod(), GuidedRodUnderCeiling())
    for rod in rods:
        here = jc.delassus(rod, rod.state(theta=0.9))
        reason = bound.reason(here) if hasattr(bound, "reason") else ""
        assert bool(reason) == bool(jnp.isnan(bound(here))), (name, type(rod).__name__, reason)


def test_nan_operators_give_nan_bounds_and_leave_other_lanes_alone():
    guides = PainleveKlein()
    theta = jnp.array([0.5, jnp.nan, 0.9])
    batch = jax.vmap(along(guides, norm_ratio, "theta"))(theta)
    alone = [along(guides, norm_ratio, "theta")(theta[i]) for i in (0, 2)]
    assert jnp.isnan(batch[1])
    np.testing.assert_allclose([batch[0], batch[2]], alone, rtol=4e-16)


def test_batches_of_none_and_nested_batches_work():
    guides = PainleveKlein()
    bound = along(guides, norm_ratio, "theta")
    assert jax.vmap(bound)(jnp.zeros((0,))).shape == (0,)
    grid = jnp.linspace(0.2, 1.2, 6).reshape(2, 3)
    nested = jax.vmap(jax.vmap(bound))(grid)
    np.testing.assert_allclose(nested.ravel(), jax.vmap(bound)(grid.ravel()), rtol=4e-16)


def test_operators_from_matrices_give_the_bound_of_the_fixture():
    fixture = tables()["fixture_2_contacts"]
    rough = (jc.Contact("a", "bilateral", True), jc.Contact("b", "bilateral", True))
    here = jc.delassus_from_matrices(np.array(fixture["A"]), np.array(fixture["At"]), contacts=rough)
    np.testing.assert_allclose(here.W, fixture["A"], rtol=1e-14)
    np.testing.assert_allclose(here.Wt, fixture["At"], rtol=1e-14)
    np.testing.assert_allclose(norm_ratio(here), fixture["prop10"], rtol=BAR["float64"])
    with pytest.raises(ValueError, match="needs G and H"):
        jc.bounds.prop9b(here)


def test_the_perturbation_of_proposition_14_is_the_difference_it_stands_for():
    """M_ub^mu - M_ub^0 with both matrices formed from (62) and (63) as defined, on a random mixed problem."""
    rng = np.random.default_rng(0)
    kinds = [jc.Contact(name, kind, True) for name, kind in zip("abcd", ["bilateral", "unilateral"] * 2)]
    N, T = rng.normal(size=(6, 4)), rng.normal(size=(6, 4))
    here = jc.delassus_from_matrices(N.T @ N, N.T @ T, contacts=tuple(kinds))
    d = 0.1 * np.array([1.0, -1.0, -1.0, 1.0])
    b, u = [0, 2], [1, 3]

    def block(rows, columns, sign=1.0):
        return N[:, rows].T @ (N[:, columns] - sign * T[:, columns] * d[columns])

    def M_ub(friction):
        A, A_bar = block(b, b, friction), block(b, b, -friction)
        B, C, C_bar, D = block(b, u, friction), block(u, b, friction), block(u, b, -friction), block(u, u, friction)
        inverse = np.linalg.inv(A)
        return np.block([[inverse @ A_bar, -inverse @ B], [C @ inverse @ A_bar - C_bar, D - C @ inverse @ B]])

    found = _Blocks.of(here).perturbation(jnp.asarray(d))
    np.testing.assert_allclose(found, M_ub(1.0) - M_ub(0.0), rtol=1e-11, atol=1e-12)  # W has condition of about 1e2


@pytest.mark.parametrize("bound", [jc.bounds.prop9b, jc.bounds.prop14, jc.bounds.direct], ids=lambda b: b.__name__)
@pytest.mark.parametrize("mechanism", [PainleveKlein(), GuidedRodUnderCeiling(), RodBetweenFloorAndCeiling()])
def test_single_precision_keeps_its_digits_to_the_ends_of_the_angle(mechanism, bound):
    """Against float64 at the same rounded angle, which the tables vouch for."""
    theta = np.array([1e-5, 0.1, 0.5, 0.9, 1.2, 1.5, np.pi / 2 - 1e-5]).astype("float32")
    low = np.asarray(on_grid(mechanism, bound, theta=theta), float)
    high = np.asarray(on_grid(mechanism, bound, theta=theta.astype(float)))
    np.testing.assert_allclose(low, high, rtol=BAR["float32"])
