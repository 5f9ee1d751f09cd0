"""All solutions of small problems, against exact rational enumeration."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from families import FAMILIES, fathi, murty, near_critical

from jaxcontact.complementarity import LCP, MLCP, AbsoluteValueEquation, HorizontalLCP, all_solutions

CASES = json.loads((Path(__file__).parent / "data" / "lcp_cases.json").read_text())["cases"]


def verdict(every, i=()):
    if every.infinite[i]:
        return "infinite"
    return {0: "none", 1: "unique"}.get(int(every.count[i]), "finite")


@pytest.mark.parametrize("size", [2, 4, 6])
def test_published_problems_have_as_many_solutions_as_published(size):
    cases = [c for c in CASES if c["kind"] == "lcp" and c["n"] == size]
    M, q = (jnp.array([c[name] for c in cases], float) for name in ("M", "q"))
    every = jax.vmap(lambda M, q: all_solutions(LCP(M, q)))(M, q)
    for i, case in enumerate(cases):
        assert verdict(every, i) == case["status"], case["name"]
        if case["status"] in ("unique", "finite"):
            assert every.count[i] == len(case["solutions"]), case["name"]
            found = np.asarray(every.z[i])[np.asarray(every.valid[i])]
            for exact in case["solutions"]:
                assert np.abs(found - np.array(exact)).max(axis=1).min() <= 1e-9 * max(exact), case["name"]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_fresh_problems_have_as_many_solutions_as_exact_arithmetic_finds(dtype):
    seed = np.random.SeedSequence().entropy % 2**32
    rng = np.random.default_rng(seed)
    chosen = [f for f in FAMILIES if f is not near_critical for _ in range(1 if f in (murty, fathi) else 8)]
    if dtype == np.float32:  # families whose data float32 holds, away from the edge of singularity
        chosen = [f for f in chosen if f.__name__ not in ("mass_ratio", "sliding", "beyond_critical", "hidden_scales")]
    data = [f(3, rng) for f in chosen]
    M, q = (np.array([d[part] for d in data]).astype(dtype) for part in (0, 1))
    every = jax.vmap(lambda M, q: all_solutions(LCP(M, q)))(jnp.asarray(M), jnp.asarray(q))
    print(f"seed {seed}: {len(data)} instances")
    undecided = 0
    for i, family in enumerate(chosen):
        truth = oracle.lcp(M[i], q[i])
        if every.undecided[i]:
            undecided += 1
            continue
        assert verdict(every, i) == truth.verdict, (seed, family.__name__, M[i], q[i])
        if truth.verdict in ("unique", "finite"):
            assert every.count[i] == len(truth.points), (seed, family.__name__)
    assert undecided <= len(data) / 10  # modes of rank m - 2, in the semidefinite families and among small integers


@pytest.mark.parametrize(
    ("M", "q"),
    [
        ([[2, 3, -1], [3, 5, -1], [-1, -1, 1]], [0, 0, 0]),
        ([[5, 0, 2], [0, 5, 6], [2, 6, 8]], [-5, 0, -2]),
        ([[2, 1, -1], [1, 5, 1], [-1, 1, 1]], [-2, -1, 1]),
        ([[5, -3, -1], [-3, 2, 1], [-1, 1, 1]], [-5, 3, 1]),
        ([[1, 2, 2], [2, 4, 3], [3, 3, 5]], [-1, -2, -3]),
        ([[5, 2, 3], [2, 8, 6], [3, 6, 5]], [-1, -4, -3]),
    ],
)
def test_rounding_in_the_kernel_of_a_mode_is_no_family(M, q):
    """Matrices of rank two: what the inverse of a regular block leaves of its own columns is rounding, in any
    direction."""
    truth = oracle.lcp(np.array(M, float), np.array(q, float))
    every = all_solutions(LCP(jnp.array(M, float), jnp.array(q, float)))
    assert truth.verdict in ("unique", "finite")
    assert every.count == len(truth.points)
    assert not every.infinite
    assert not every.undecided


def sliding_mixed(rng, bilateral, unilateral, strength):
    """The mixed sliding problem (60) in the form (61): P_j, N_j are W -+ Wt mu xi for guides; N_j = e_j for tips."""
    m = bilateral + unilateral
    J, H = rng.normal(size=(m + 1, m)), rng.normal(size=(m + 1, m))
    W, Y = J.T @ J, (J.T @ H) * rng.uniform(0.2, 1.0, m) * strength
    P, N = W - Y, np.eye(m)
    N[:, :bilateral] = (W + Y)[:, :bilateral]
    return N, P, rng.normal(size=m)


@pytest.mark.parametrize(("bilateral", "unilateral", "copies"), [(2, 2, 12), (4, 4, 2)])
def test_mixed_sliding_problems_are_enumerated_completely(bilateral, unilateral, copies):
    rng = np.random.default_rng(bilateral)
    data = [sliding_mixed(rng, bilateral, unilateral, s) for s in np.linspace(0.2, 2.5, copies)]
    N, P, w = (np.array([d[part] for d in data]) for part in range(3))
    every = jax.vmap(lambda N, M, q: all_solutions(HorizontalLCP(N, M, q)))(*map(jnp.asarray, (N, P, w)))
    for i in range(copies):
        truth = oracle.horizontal(N[i], P[i], w[i])
        assert every.count[i] == len(truth.points)
        found = np.asarray(every.z[i] - every.w[i])[np.asarray(every.valid[i])]
        for z, minus in truth.points:
            exact = np.array(z, float) - np.array(minus, float)
            assert np.abs(found - exact).max(axis=1).min() <= 1e-9 * np.abs(exact).max()


def painleve_klein(theta, mu, xi, gravity):
    """Two frictional guides (tutorial 3.2, m = l = 1, at rest): A, A_t [mu xi], w for a vertical load."""
    s, c = np.sin(theta), np.cos(theta)
    e, u = np.ones(2), np.array([1.0, -1.0])
    A = np.outer(e, e) + 3 * c**2 * np.outer(u, u)
    At = -3 * s * c * np.outer(u, u)
    return A, At * (np.asarray(mu) * xi), -gravity * e


def test_painleve_klein_has_three_solutions_where_the_printed_criterion_promises_one():
    # theta = pi/4, mu = 1.5 on both guides, xi = -1: |mu1 - mu2| = 0 < 2, but mu1 + mu2 = 3 > 2 (erratum B1)
    every = all_solutions(AbsoluteValueEquation(*painleve_klein(np.pi / 4, (1.5, 1.5), -1.0, 1.0)))
    assert every.count == 3
    assert every.several


@pytest.mark.parametrize(("mu", "counts"), [((0.9, 1.0), {1}), ((1.5, 1.4), {1, 3}), ((2.9, 0.2), {0, 2})])
def test_the_three_regimes_of_painleve_klein(mu, counts):
    # thresholds at theta = pi/4: uniqueness mu1 + mu2 < 2, existence |mu1 - mu2| < 2
    A, B, _ = painleve_klein(np.pi / 4, mu, -1.0, 1.0)
    w = np.random.default_rng(1).normal(size=(400, 2))
    every = jax.vmap(lambda w: all_solutions(AbsoluteValueEquation(A, B, w)))(jnp.asarray(w))
    assert set(np.asarray(every.count).tolist()) == counts
    assert not np.asarray(every.infinite).any()


def test_a_singular_mode_holds_a_family_only_where_its_load_allows():
    ones = np.ones((2, 2))
    supported = all_solutions(LCP(ones, -np.ones(2)))
    assert supported.infinite
    assert verdict(all_solutions(LCP(ones, np.ones(2)))) == "unique"
    assert verdict(all_solutions(LCP(ones, np.array([-1.0, -2.0])))) == "unique"
    # the ray z_1 >= 1 of the zero diagonal, found in a singular mode only
    ray = all_solutions(LCP(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([0.0, -1.0])))
    assert ray.infinite


def test_each_branch_has_its_own_derivative():
    # M = -1: z = 0 and z = q (Painlevé's two solutions)
    branches = lambda q: all_solutions(LCP(jnp.array([[-1.0]]), q)).z[:, 0]  # noqa: E731
    np.testing.assert_allclose(jax.jacfwd(branches)(jnp.array([2.0]))[:, 0], [0.0, 1.0])


def test_rows_without_a_solution_are_nan_and_bad_data_are_undecided():
    every = jax.vmap(lambda q: all_solutions(LCP(jnp.array([[2.0]]), q)))(jnp.array([[-2.0], [jnp.nan]]))
    np.testing.assert_array_equal(every.valid, [[False, True], [False, False]])
    np.testing.assert_array_equal(np.isnan(every.z[..., 0]), [[True, False], [True, True]])
    np.testing.assert_array_equal(every.undecided, [False, True])


def test_free_unknowns_come_along():
    mixed = MLCP(A=[[2.0]], C=[[1.0]], a=[-1.0], D=[[1.0]], B=[[3.0]], b=[-2.0])
    every = all_solutions(mixed)
    assert every.unique
    np.testing.assert_allclose(every.free[every.valid], [[0.2]], rtol=1e-14)
    np.testing.assert_allclose(every.z[every.valid], [[0.6]], rtol=1e-14)
