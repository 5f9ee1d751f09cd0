"""The other methods and the other kinds of problem: what each promises, and where its promise ends."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from families import circulant, critical_friction, low_rank

from jaxcontact.complementarity import (
    LCP,
    MLCP,
    AbsoluteValueEquation,
    Banach,
    Claim,
    HorizontalLCP,
    Lemke,
    ProjectedGaussSeidel,
    Status,
    ave_as_horizontal,
    ave_as_lcp,
    contraction_rate,
    horizontal_as_ave,
    horizontal_as_lcp,
    judge,
    lcp_as_ave,
    lcp_as_horizontal,
    mlcp_as_lcp,
    solve,
)

CASES = {c["name"]: c for c in json.loads((Path(__file__).parent / "data" / "lcp_cases.json").read_text())["cases"]}

EPS = np.finfo(float).eps


def arrays(case, *names):
    return {name: np.array(case[name], float) for name in names}


def record_of(case):
    if case["kind"] == "ave":
        return AbsoluteValueEquation(**arrays(case, "A", "B", "w"))
    if case["kind"] == "hlcp":
        return HorizontalLCP(**arrays(case, "N", "M", "q"))
    return MLCP(**arrays(case, "A", "B", "C", "D", "a", "b"))


def unknowns(case, answer):
    """In the order in which the file stores solutions."""
    parts = {"ave": (answer.free,), "hlcp": (answer.w, answer.z), "mlcp": (answer.free, answer.z)}
    return np.concatenate(parts[case["kind"]])


@pytest.mark.parametrize("name", [n for n, c in CASES.items() if c["kind"] in ("ave", "hlcp", "mlcp")])
def test_published_problems_of_other_kinds(name):
    case = CASES[name]
    answer = solve(record_of(case), Lemke())
    redundant = "redundant=True" in name
    assert answer.status == (Status.REDUNDANT if redundant else Status.SOLVED)
    assert answer.backward_error <= 1e-13
    if case["status"] == "unique":
        exact = np.array(case["solutions"][0])
        bound = 8 * EPS * np.asarray(answer.condition) * np.abs(exact).max()
        assert np.abs(unknowns(case, answer) - exact).max() <= bound
    elif redundant:  # v and w are determined, u is not: it is the shortest one
        exact = np.array(case["solutions"][0])
        k = len(answer.free)
        np.testing.assert_allclose(answer.z, exact[k:], atol=1e-13)
        assert np.linalg.norm(answer.free) <= np.linalg.norm(exact[:k]) * (1 + 1e-14)


def test_gauss_seidel_never_raises_the_energy_of_a_semidefinite_problem():
    rng = np.random.default_rng(2)
    for _ in range(3):
        M, q = low_rank(5, rng)
        M = M + np.diag((np.diag(M) == 0).astype(float))
        sweeps = jax.jit(lambda z, M=M, q=q: solve(LCP(M, q), ProjectedGaussSeidel(sweeps=1), start=z))
        z, energy = np.zeros(5), 0.0
        for _ in range(12):
            answer = sweeps(z)
            z = np.asarray(answer.attempt)
            lower = z @ M @ z / 2 + q @ z
            assert lower <= energy + 8 * EPS * (np.abs(z @ M @ z) + np.abs(q) @ z)  # rounding of the energy itself
            energy = lower


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_gauss_seidel_reports_the_residual_of_what_it_returns(dtype):
    M = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 2.0]], dtype)
    q = np.array([-1.0, 1.0, -3.0], dtype)
    answer = solve(LCP(M, q), ProjectedGaussSeidel(sweeps=3))
    z = np.asarray(answer.attempt)
    w = M @ z + q
    rho = np.abs(np.minimum(np.diag(M) * z, w)).max() / np.abs(q).max()
    np.testing.assert_allclose(answer.residual, rho, rtol=4 * np.finfo(dtype).eps, atol=4 * np.finfo(dtype).eps)


def test_gauss_seidel_out_of_budget_is_not_called_solved():
    M, q = circulant(3, np.random.default_rng(0))[0], -np.ones(3)
    answer = solve(LCP(M, q), ProjectedGaussSeidel(sweeps=200))  # Gauss-Seidel cycles
    assert answer.status == Status.MAX_STEPS
    assert np.isnan(answer.z).all()
    assert np.isfinite(answer.attempt).all()
    relaxed = np.eye(3) + 1.25 * np.roll(np.eye(3), 1, axis=1)  # Gauss-Seidel radius above one, damped below
    assert solve(LCP(relaxed, q), ProjectedGaussSeidel(sweeps=200)).status == Status.MAX_STEPS
    damped = solve(LCP(relaxed, q), ProjectedGaussSeidel(sweeps=2000, relaxation=0.3))
    assert damped.status == Status.SOLVED
    np.testing.assert_allclose(damped.z, 1 / 2.25, rtol=1e-13)


def test_a_loose_tolerance_stops_early_and_says_inaccurate():
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])
    loose = solve(LCP(M, q), ProjectedGaussSeidel(tolerance=1e-3))
    assert loose.status == Status.INACCURATE
    assert loose.backward_error <= 1e-3
    np.testing.assert_allclose(loose.attempt, [4 / 3, 7 / 3], rtol=1e-2)
    assert loose.steps < solve(LCP(M, q), ProjectedGaussSeidel()).steps


def sliding_rod(theta, mu):
    """One guided contact of a homogeneous rod: A = 1 + 3 cos^2, At = -3 sin cos (tutorial, 1.1 and 3.1), m = 1."""
    A, At = 1 + 3 * np.cos(theta) ** 2, -3 * np.sin(theta) * np.cos(theta)
    return np.array([[A]]), np.array([[At * mu]])


def test_banach_contracts_with_the_printed_rate():
    A, B = sliding_rod(0.9, 0.7)
    problem = AbsoluteValueEquation(A, B, np.array([-1.0]))
    rate = contraction_rate(problem)
    np.testing.assert_allclose(rate, abs(B[0, 0] / A[0, 0]), rtol=1e-15)
    exact = 1 / (A - B)[0, 0]
    answer = solve(problem, Banach())
    np.testing.assert_allclose(answer.free, exact, rtol=1e-14)
    # the start is off by one rate, each step gains another, the stop is a few roundings of size one
    assert int(answer.steps) <= np.log(EPS) / np.log(float(rate)) + 2


@pytest.mark.parametrize("method", [Lemke(), Banach()])
def test_an_absolute_value_equation_below_its_bound_is_solved_by_every_method(method):
    rng = np.random.default_rng(8)
    A = rng.normal(size=(20, 3, 3)) + 4 * np.eye(3)
    B = rng.normal(size=(20, 3, 3))
    B *= 0.9 * (np.linalg.svd(A)[1][:, -1] / np.linalg.svd(B)[1][:, 0])[:, None, None]
    w = rng.normal(size=(20, 3))
    answer = jax.vmap(lambda A, B, w: solve(AbsoluteValueEquation(A, B, w), method))(*map(jnp.asarray, (A, B, w)))
    assert (np.asarray(answer.status) == Status.SOLVED).all()
    for data, x in zip(zip(A, B, w), np.asarray(answer.free)):
        plus, minus = oracle.absolute_value(*data).points[0]
        exact = np.array(plus, float) - np.array(minus, float)
        np.testing.assert_allclose(x, exact, atol=64 * EPS * np.linalg.cond(data[0]) * np.abs(exact).max())


def test_conversions_keep_the_solution_and_lead_back():
    M, q = np.array([[2.0, 1.0, 0.0], [0.5, 3.0, -1.0], [1.0, 0.0, 2.0]]), np.array([-3.0, 1.0, -2.0])
    z, w = (np.array(part, float) for part in oracle.lcp(M, q).points[0])
    lcp = LCP(M, q)

    def same(problem, back):
        answer = solve(problem, Lemke())
        assert answer.status == Status.SOLVED
        free, z_back, w_back = back(answer.z, answer.w)
        np.testing.assert_allclose(z_back, z, atol=1e-14)
        np.testing.assert_allclose(w_back, w, atol=1e-14)
        return free

    horizontal, back = lcp_as_horizontal(lcp)
    same(horizontal, back)
    ave, back = lcp_as_ave(lcp)
    same(ave, back)
    same(*horizontal_as_ave(horizontal))
    same(*horizontal_as_lcp(horizontal))
    same(*ave_as_horizontal(ave))
    np.testing.assert_allclose(same(*ave_as_lcp(ave)), z - w, atol=1e-14)
    mixed = MLCP(A=M[:1, :1], C=M[:1, 1:], a=q[:1], D=M[1:, :1], B=M[1:, 1:], b=q[1:])
    reduced, _ = mlcp_as_lcp(mixed)
    schur = M[1:, 1:] - M[1:, :1] @ M[:1, 1:] / M[0, 0]
    np.testing.assert_allclose(reduced.M, schur, rtol=1e-14)


def test_friction_beyond_the_critical_one_has_loads_without_solution():
    A, B = sliding_rod(np.pi / 4, 2.0)  # mu_crit = 5/3
    assert critical_friction(A, -B / 2.0) == pytest.approx(5 / 3, rel=1e-14)
    for load in (-1.0, 1.0):
        truth = oracle.absolute_value(A, B, [load])
        answer = solve(AbsoluteValueEquation(A, B, np.array([load])), Lemke())
        assert (answer.status == Status.SOLVED) == (truth.verdict != "none")


def test_the_judge_believes_no_claim():
    problem = LCP(np.array([[2.0, 0.0], [0.0, 1e-12]]), np.array([-2.0, -1e-12]))
    right, none = jnp.array([1.0, 1.0]), jnp.zeros(2)
    says = lambda z, outcome: judge(problem, Claim(jnp.zeros(0), jnp.asarray(z), none, jnp.int32(outcome), none)).status  # noqa: E731
    assert says(right, Status.SOLVED) == Status.SOLVED
    assert says(right, Status.MAX_STEPS) == Status.SOLVED
    assert says([1.0, 0.0], Status.SOLVED) == Status.INACCURATE  # the second row hides behind the units of the first
    assert says([1.0, 0.0], Status.RAY) == Status.RAY
    assert says([np.nan, 1.0], Status.SOLVED) == Status.BAD_INPUT


def test_a_false_certificate_is_refused():
    problem = LCP(np.array([[1.0]]), np.array([-1.0]))
    false = Claim(jnp.zeros(0), jnp.zeros(1), jnp.zeros(1), jnp.int32(Status.RAY), -jnp.ones(1))
    assert judge(problem, false).status == Status.RAY
