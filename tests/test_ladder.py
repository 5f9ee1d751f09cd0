"""Every rung below the next, each at its closed forms, none offered where it is false."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import table, tables
from scipy.optimize import minimize
from systems import contacts_of, operators_of, random_factors

import jaxcontact as jc
from jaxcontact import bounds
from jaxcontact.mechanisms import GuidedRodUnderCeiling, PainleveKlein

BILATERAL = ("norm_ratio", "operator_norm", "best_scaling", "critical")
ANY = ("direct", "sharper_direct", "positive_definite_radius", "critical")

# The ladder's bar (numerics.md 14): the order is never violated beyond 8 roundings.
ORDER = {"float64": 8 * 2.2e-16, "float32": 8 * 1.2e-7}


@functools.cache
def batched(name, kinds):
    bound = bounds.by_name()[name]
    return jax.jit(jax.vmap(lambda N, T: bound(operators_of(N, T, kinds))))


@pytest.mark.parametrize("dtype", ORDER)
@pytest.mark.parametrize(("kinds", "names"), [("bbb", BILATERAL), ("uuu", ANY), ("bu", ANY)])
def test_every_rung_is_below_the_next_on_thousands_of_random_systems(kinds, names, dtype):
    N, T = (x.astype(dtype) for x in random_factors(kinds, 1000 if kinds == "bbb" else 4000, seed=11))
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


def test_the_best_scaling_is_the_minimum_that_a_simplex_search_finds():
    """Nelder-Mead on log D from several starts, an independent minimiser of the norm itself."""
    N, T = random_factors("bbb", 1000, seed=11)
    found = np.asarray(batched("best_scaling", "bbb")(N, T))
    gap = np.asarray(batched("critical", "bbb")(N, T)) / found
    # The largest gaps to the exact value are where the largest singular value is repeated at the minimum.
    for i in np.argsort(-gap)[:4]:
        X = np.linalg.lstsq(N[i], T[i], rcond=None)[0]

        def norm(t, X=X):
            t = np.append(t, 0.0)
            return np.linalg.norm(X * np.exp(t[None, :] - t[:, None]), 2)

        starts = np.random.default_rng(0).normal(size=(3, 2))
        best = min(minimize(norm, s, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).fun for s in starts)
        # The smoothed norm of order 2^15 is within log(3) / 2^15 = 3.4e-5.
        assert 1 - 4e-5 < found[i] * best < 1 + 1e-9
    assert gap.max() > 1.0005


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


@pytest.mark.parametrize(
    "name", ["operator_norm", "perron", "best_scaling", "sharper_direct", "positive_definite_radius"]
)
def test_rungs_keep_their_ends_and_their_derivatives(name):
    bound = bounds.by_name()[name]
    assert bound(operators_of(jnp.eye(2), jnp.zeros((2, 2)), "BB")) == jnp.inf
    assert bound(operators_of(jnp.ones((2, 2)), jnp.eye(2), "bb")) == 0.0
    N, T = random_factors("bbb", 25, seed=13)
    D, E = random_factors("bbb", 25, seed=14)

    def value(N, T):
        return bound(operators_of(N, T, "bbb"))

    slope = jax.jit(jax.vmap(lambda *x: jax.jvp(value, x[:2], x[2:])[1]))(N, T, D, E)
    compiled = jax.jit(jax.vmap(value))
    difference, far = (
        np.asarray(compiled(N + h * D, T + h * E) - compiled(N - h * D, T - h * E)) / (2 * h) for h in (1e-5, 1e-3)
    )
    smooth = np.abs(difference / far - 1) < 0.05
    assert smooth.mean() > 0.7
    # Central differences at 1e-5: 1e-6 relative. At repeated singular values the derivative of the best scaling weighs
    # them as the smoothed minimum does, which the minimiser finds to a percent there.
    tolerance = 2e-2 if name == "best_scaling" else 1e-5
    np.testing.assert_allclose(slope[smooth], difference[smooth], rtol=tolerance)


def test_a_smooth_guide_is_eliminated_before_the_rungs_are_taken():
    """Mathematics 1.10: with a smooth guide Proposition 15 is 2 cot theta, and so are the exact value and the rungs."""
    rod = GuidedRodUnderCeiling(guide_frictional=False)
    here = jc.delassus(rod, rod.state(theta=0.9))
    found = [bounds.by_name()[name](here) for name in ("sharper_direct", "positive_definite_radius", "critical")]
    np.testing.assert_allclose(found, 2 / np.tan(0.9), rtol=1e-12)
