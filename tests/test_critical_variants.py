"""The other thresholds: along a ray, for existence, for one load; what binds; brackets for many contacts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import table
from systems import critical_reference, dyadic_factors, operators_of, random_factors, solutions_of

import jaxcontact as jc
from jaxcontact.bounds import (
    binding_mode,
    critical,
    critical_along_ray,
    critical_bracket,
    critical_existence,
    critical_for_load,
    critical_for_signs,
)
from jaxcontact.mechanisms import GuidedRodUnderCeiling, PainleveKlein

BAR = 1e-12  # numerics.md 14, relative


def at(mechanism, **chart):
    return jc.delassus(mechanism, mechanism.state(**chart))


def test_the_ray_of_the_rod_under_the_ceiling_is_tabled():
    rows = table("rod_bilateral_unilateral_friction")
    rod = GuidedRodUnderCeiling()
    for column, xi_u in (("exact_ray_xiu_plus", 1.0), ("exact_ray_xiu_minus", -1.0)):
        found = jax.vmap(lambda t, x=xi_u: critical_along_ray(at(rod, theta=t), jnp.array([1.0, x])))(
            jnp.asarray(rows["theta"])
        )
        np.testing.assert_allclose(found, rows[column], rtol=BAR)


def test_on_a_ray_uniqueness_is_lost_first_at_the_value_of_the_mathematics_and_may_come_back():
    """Mathematics 3(d): A = [[1, .9], [.9, 1]], At = [[-1, -10], [0, -1]]: lost at 0.02725, back before 8."""
    W, Wt = jnp.array([[1.0, 0.9], [0.9, 1.0]]), jnp.array([[-1.0, -10.0], [0.0, -1.0]])
    here = jc.delassus_from_matrices(W, Wt, contacts=operators_of(W, Wt, "uu").contacts)
    found = critical_along_ray(here, jnp.ones(2))
    np.testing.assert_allclose(found, 0.02725, atol=5e-6)
    # det (W - r Wt) = (1 + r)^2 - .9 (.9 + 10 r): positive again at r = 8.
    assert np.linalg.det(W - 1.01 * found * Wt) < 0 < np.linalg.det(W - 8 * Wt)
    assert critical(here) <= critical_for_signs(here, jnp.ones(2)) <= found * (1 + BAR)


def test_existence_of_two_guides_is_the_difference_of_the_coefficients():
    """Mathematics 3(h): with equal signs of sliding and ratio (1, x) existence for every load up to 2 cot / |1 - x|."""
    here = at(PainleveKlein(), theta=0.9)
    cot = 1 / np.tan(0.9)
    for x in (0.0, 0.25, 2.0):
        found = critical_existence(here, jnp.ones(2), jnp.array([1.0, x]))
        np.testing.assert_allclose(found, 2 * cot / abs(1 - x), rtol=1e-10)
    np.testing.assert_allclose(critical_existence(here, jnp.array([1.0, -1.0])), cot, rtol=1e-10)
    assert critical_existence(here, jnp.ones(2)) > 1e6


def test_below_the_existence_threshold_every_sampled_load_has_a_solution():
    rng = np.random.default_rng(0)
    for kinds in ("bb", "bu", "uu"):
        N, T = random_factors(kinds, 6, seed=3)
        xi = np.array([1.0, -1.0])
        values = jax.jit(
            jax.vmap(lambda N, T, k=kinds, s=xi: critical_existence(operators_of(N, T, k), jnp.asarray(s)))
        )(N, T)
        for n, t, r in zip(N, T, np.minimum(np.asarray(values), 1e3)):
            for w in rng.normal(size=(60, 2)):
                assert solutions_of(n.T @ n, n.T @ t, w, 0.99 * r * xi, kinds)


@pytest.mark.parametrize("kinds", ["bb", "bu", "uu", pytest.param("bbu", marks=pytest.mark.slow)])
def test_the_number_of_solutions_of_one_load_changes_at_its_threshold(kinds):
    m = len(kinds)
    N, T = random_factors(kinds, 12, seed=4)
    rng = np.random.default_rng(5)
    w, xi = rng.normal(size=(12, m)), rng.choice([-1.0, 1.0], size=(12, m))
    found = np.asarray(
        jax.jit(jax.vmap(lambda N, T, w, xi: critical_for_load(operators_of(N, T, kinds, w), xi)))(N, T, w, xi)
    )
    changes = 0
    for n, t, w_i, xi_i, r in zip(N, T, w, xi, found):
        W, Wt = n.T @ n, n.T @ t
        below = np.linspace(0.01, 0.999, 25) * min(r, 50.0)
        assert all(len(solutions_of(W, Wt, w_i, s * xi_i, kinds)) == 1 for s in below)
        if np.isfinite(r):
            changes += 1
            assert len(solutions_of(W, Wt, w_i, 1.001 * r * xi_i, kinds)) != 1
    assert changes > 2


def test_a_loss_for_one_load_is_a_loss_for_every_load_along_the_ray():
    N, T = random_factors("bu", 12, seed=6)
    xi = jnp.array([1.0, -1.0])
    w = jnp.array([0.3, -0.8])
    one, ray = (
        jax.jit(jax.vmap(lambda N, T, f=f: f(operators_of(N, T, "bu", w), xi)))(N, T)
        for f in (critical_for_load, critical_along_ray)
    )
    assert np.all(one >= ray * (1 - 1e-9))


def test_the_binding_mode_of_the_guides_wedges_both_in_the_same_sense():
    """A - At [mu] S is singular first for S = (-1, -1): det is proportional to 2 c^2 + s c (d_1 + d_2)."""
    here = at(PainleveKlein(), theta=0.9)
    found = binding_mode(here)
    np.testing.assert_allclose(found.value, critical(here), rtol=BAR)
    np.testing.assert_array_equal(found.closed, [True, True])
    determinant = np.linalg.det(np.asarray(here.W) - float(found.value) * np.asarray(here.Wt) * np.asarray(found.signs))
    np.testing.assert_allclose(determinant / np.linalg.det(here.W), 0, atol=1e-12)
    assert not bool(found.kink)


def test_kinks_are_flagged_where_two_vertices_bind_together():
    """Two alike decoupled contacts bind together always; unlike ones do not."""
    assert bool(binding_mode(operators_of(jnp.eye(2), 0.5 * jnp.eye(2), "bb")).kink)
    apart = operators_of(jnp.eye(2), jnp.array([[0.5, 0.1], [0.2, 0.3]]), "uu")
    found = binding_mode(apart)
    assert not bool(found.kink)
    assert found.value < found.runner_up


@pytest.mark.parametrize(
    "kinds", [pytest.param("bbb", marks=pytest.mark.slow), pytest.param("uuu", marks=pytest.mark.slow), "bUu"]
)
def test_brackets_enclose_forty_digits_and_name_a_true_witness(kinds):
    N, T = dyadic_factors(kinds, 8, seed=7)
    found = jax.jit(jax.vmap(lambda N, T: critical_bracket(operators_of(N, T, kinds))))(N, T)
    expected = np.array([critical_reference(n, t, kinds) for n, t in zip(N, T)])
    assert np.all(found.lower <= expected * (1 + BAR))
    assert np.all(found.upper >= expected * (1 - BAR))
    for n, t, r, closed, signs in zip(N, T, *(np.asarray(x) for x in (found.upper, found.closed, found.signs))):
        chosen = np.flatnonzero(closed)
        A = (n.T @ (n - r * t * signs))[np.ix_(chosen, chosen)]
        least = np.linalg.svd(A, compute_uv=False)[-1]
        # The rounding of the two products that cancel.
        assert least < 1e-11 * np.linalg.norm(n.T @ n)
    # The search is local; on small systems it is expected to find the binding vertex nearly always.
    assert np.median(found.upper / expected) < 1 + 1e-9


@pytest.mark.slow
def test_a_bracket_of_twenty_contacts_has_a_witness_within_a_factor_of_the_lower_bound():
    N, T = random_factors("b" * 20, 1, seed=8)
    here = operators_of(jnp.asarray(N[0]), jnp.asarray(T[0]), "b" * 20)
    with pytest.raises(ValueError, match="critical_bracket"):
        critical(here)
    found = critical_bracket(here)
    assert 0 < found.lower <= found.upper < jnp.inf
    A = here.W - found.upper * here.Wt * found.signs[None, :]
    assert np.linalg.svd(A, compute_uv=False)[-1] < 1e-10 * np.linalg.norm(A, 2)


@pytest.mark.parametrize("pull", [0.0, 10.0])
def test_a_threshold_that_does_not_exist_is_not_made_of_rounding(pull):
    """Two guides that slide the same way: 2c^2 + sc(mu_1 + mu_2) > 0 at every friction (mathematics 1.5); existence
    holds for |mu_1 - mu_2| < 2 cot theta. Of nilpotent couplings the eigenvalues are zero to half the digits."""
    guides = PainleveKlein(gravity=9.81 if pull else 0.0, lower_pull=10.0)
    here = jc.delassus(guides, guides.state(theta=np.pi / 4))
    assert jc.bounds.critical_for_load(here, jnp.ones(2)) == jnp.inf
    assert jc.bounds.critical_existence(here, jnp.ones(2)) == jnp.inf
    np.testing.assert_allclose(jc.bounds.critical_existence(here, jnp.array([1.0, -1.0])), 1.0, rtol=1e-12)
