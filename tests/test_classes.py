"""Matrix classes: verdicts against exact rational arithmetic, margins attained, error bounds kept."""

import itertools
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import tables
from systems import exact, exact_det, operators_of, random_factors, solutions_of

from jaxcontact.bounds import critical
from jaxcontact.bounds.classes import Verdict, beta, column_w, copositive, error_constant, p_matrix, positive_definite
from jaxcontact.bounds.sliding_class import guaranteed_error, lipschitz, uniqueness

M = 4


def subsets(m):
    return [s for k in range(1, m + 1) for s in itertools.combinations(range(m), k)]


def exactly_p(matrix):
    A = exact(matrix)
    return all(exact_det([[A[i][j] for j in s] for i in s]) > 0 for s in subsets(len(A)))


def near_the_border(rng, relative, m=M):
    """A matrix at about `relative` times its norm from the border of P, on either side, along a worst triple."""
    A = rng.normal(size=(m, m)) + 1.5 * m**0.5 * np.eye(m)
    margin, worst = min((np.linalg.svd(A[np.ix_(s, s)], compute_uv=False)[-1], s) for s in subsets(m))
    U, _, Vt = np.linalg.svd(A[np.ix_(worst, worst)])
    A[np.ix_(worst, worst)] -= (margin - relative * np.linalg.norm(A)) * np.outer(U[:, -1], Vt[-1])
    return A


@pytest.mark.parametrize(("dtype", "bar", "depth"), [("float64", 1e-13, 17), ("float32", 1e-5, 9)])
def test_the_p_verdict_is_never_wrong_and_decided_above_the_bar(dtype, bar, depth):
    """Margins 10^-k on both sides; the matrix that is judged is the rounded one, and Fractions judge it too."""
    rng = np.random.default_rng(0)
    judge = jax.jit(p_matrix)
    for k, side, _ in itertools.product(range(1, depth), (1, -1), range(3)):
        A = near_the_border(rng, side * 10.0**-k).astype(dtype)
        found = judge(jnp.asarray(A))
        truth = Verdict.YES if exactly_p(A) else Verdict.NO
        assert int(found.verdict) in (truth, Verdict.UNDECIDED)
        if 10.0**-k >= 3 * bar:
            assert int(found.verdict) == truth, (k, side)
        if int(found.verdict) == Verdict.NO:
            chosen = np.flatnonzero(found.members)
            assert exact_det([[Fraction(float(A[i, j])) for j in chosen] for i in chosen]) < 0


def test_the_margin_of_p_is_the_distance_to_the_matrices_that_are_not():
    rng = np.random.default_rng(1)
    for _ in range(5):
        A = near_the_border(rng, 0.02)
        found = p_matrix(jnp.asarray(A))
        chosen = np.flatnonzero(found.members)
        U, _, Vt = np.linalg.svd(A[np.ix_(chosen, chosen)])
        for share, verdict in ((0.999, Verdict.YES), (1.001, Verdict.NO)):
            B = A.copy()
            B[np.ix_(chosen, chosen)] -= share * float(found.margin) * np.outer(U[:, -1], Vt[-1])
            assert int(p_matrix(jnp.asarray(B)).verdict) == verdict


def test_beta_2_has_the_tabled_values_and_is_the_inverse_of_the_margin():
    for entry in tables()["fixture_beta2"]:
        A = jnp.array(entry["M"])
        np.testing.assert_allclose(beta(A), entry["beta2"], rtol=1e-13)
        np.testing.assert_allclose(p_matrix(A).margin, 1 / entry["beta2"], rtol=1e-12)


def test_column_w_holds_below_the_critical_friction_and_not_above():
    N, T = random_factors("bbb", 5, seed=2)
    judge = jax.jit(column_w)
    for n, t in zip(N, T):
        r = float(critical(operators_of(jnp.asarray(n), jnp.asarray(t), "bbb")))
        for share, verdict in ((1 - 1e-9, Verdict.YES), (1 + 1e-9, Verdict.NO)):
            found = judge(jnp.asarray(n.T @ n), jnp.asarray(share * r * n.T @ t))
            assert int(found.verdict) == verdict
        assert np.linalg.det(n.T @ n - (1 + 1e-9) * r * n.T @ t * np.asarray(found.signs)) < 0


@pytest.mark.parametrize("kinds", [pytest.param("uuu", marks=pytest.mark.slow), "bu", "bUB"])
def test_uniqueness_of_a_sliding_problem_changes_at_the_critical_friction(kinds):
    N, T = random_factors(kinds, 4, seed=3)
    judge = jax.jit(lambda N, T, mu: uniqueness(operators_of(N, T, kinds), mu))
    for n, t in zip(N, T):
        r = float(critical(operators_of(jnp.asarray(n), jnp.asarray(t), kinds)))
        if np.isinf(r):
            continue
        for share, verdict in ((1 - 1e-8, Verdict.YES), (1 + 1e-8, Verdict.NO)):
            assert int(judge(n, t, jnp.full(len(kinds), share * r)).verdict) == verdict


def test_copositive_is_seen_where_definite_fails():
    """Nonnegative matrices are copositive; Horn's is on the border and indefinite; minus the identity is neither."""
    horn = np.array([[1, -1, 1, 1, -1], [-1, 1, -1, 1, 1], [1, -1, 1, -1, 1], [1, 1, -1, 1, -1], [-1, 1, 1, -1, 1.0]])
    assert int(copositive(jnp.asarray(horn + 1e-6 * np.eye(5))).verdict) == Verdict.YES
    assert int(copositive(jnp.asarray(horn - 1e-6 * np.eye(5))).verdict) == Verdict.NO
    assert int(copositive(jnp.asarray(horn)).verdict) == Verdict.UNDECIDED
    assert int(positive_definite(jnp.asarray(horn)).verdict) == Verdict.NO
    exchange = jnp.array([[0.1, 1.0], [1.0, 0.1]])
    assert int(copositive(exchange).verdict) == Verdict.YES
    np.testing.assert_allclose(copositive(exchange).margin, 0.1, rtol=1e-14)
    assert int(positive_definite(exchange).verdict) == Verdict.NO


def test_the_error_of_any_guess_is_within_the_guarantee_and_the_constant_is_attained():
    """|z - z*| <= c |min(z, M z + q)|: for M = [[1, 4], [0, 1]] the residual of z = z* + (-4, 1) t is (0, t): c = 5."""
    np.testing.assert_allclose(error_constant(jnp.array([[1.0, 4.0], [0.0, 1.0]])), 5.0, rtol=1e-14)
    rng = np.random.default_rng(4)
    for kinds in ("bbu", "uuu"):
        N, T = random_factors(kinds, 3, seed=5)
        bound = jax.jit(lambda n, t, w, mu, xi, z, k=kinds: guaranteed_error(operators_of(n, t, k, w), mu, xi, z))
        for n, t in zip(N, T):
            r = float(critical(operators_of(jnp.asarray(n), jnp.asarray(t), kinds)))
            mu, xi, w = np.full(3, 0.7 * r), rng.choice([-1.0, 1.0], 3), rng.normal(size=3)
            (truth,) = solutions_of(n.T @ n, n.T @ t, w, mu * xi, kinds)
            for scale in (1.0, 1e-3, 1e-6):
                guess = truth + scale * rng.normal(size=3)
                error = np.abs(guess - truth).max()
                assert error <= bound(n, t, w, mu, xi, guess) * (1 + 1e-6)


def test_the_lipschitz_constant_bounds_and_reaches_the_change_of_the_forces():
    kinds = "bu"
    N, T = random_factors(kinds, 4, seed=6)
    rng = np.random.default_rng(7)
    for n, t in zip(N, T):
        here = operators_of(jnp.asarray(n), jnp.asarray(t), kinds)
        mu = np.full(2, 0.6 * float(critical(here)))
        constant = float(lipschitz(here, jnp.asarray(mu)))
        W, Wt = n.T @ n, n.T @ t
        best = 0.0
        for _ in range(400):
            xi, w, step = rng.choice([-1.0, 1.0], 2), rng.normal(size=2), rng.normal(size=2)
            a, b = (solutions_of(W, Wt, w + s * step, mu * xi, kinds)[0] for s in (0.0, 1e-4))
            best = max(best, np.linalg.norm(a - b) / np.linalg.norm(1e-4 * step))
        assert 0.8 * constant < best < constant * (1 + 1e-6)


def test_data_that_are_not_finite_are_undecided():
    A = jnp.eye(3).at[0, 1].set(jnp.nan)
    assert int(p_matrix(A).verdict) == Verdict.UNDECIDED
    assert int(positive_definite(A).verdict) == Verdict.UNDECIDED
    with pytest.raises(ValueError, match="1 to 12 rows"):
        p_matrix(jnp.eye(13))
