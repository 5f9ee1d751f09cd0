"""Boxed problems: exact rational answers, infinite and equal bounds, units, derivatives, bad bounds."""

import functools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from families import indefinite, nonsymmetric, positive_definite, triangular

from jaxcontact.complementarity import (
    LCP,
    BoxedLCP,
    Lemke,
    Status,
    all_solutions,
    boxed_as_lcp,
    boxed_as_mlcp,
    implicit,
    lcp_as_boxed,
    solve,
)

CASE = next(
    c
    for c in json.loads((Path(__file__).parent / "data" / "lcp_cases.json").read_text())["cases"]
    if c["kind"] == "blcp"
)

BACKWARD = {np.float64: 1e-13, np.float32: 2e-6}
"""The accuracy asked of every SOLVED."""

SIZE, LANES = 5, 64
"""All problems are brought to one shape, because compilation takes longer than solving."""

batch = jax.jit(jax.vmap(lambda M, q, lower, upper: solve(BoxedLCP(M, q, lower, upper), Lemke())))


def answers(problems, dtype=np.float64):
    """The solutions of up to LANES problems (M, q, lower, upper), each extended by free unknowns on springs of their
    own; the extensions stay in the answer."""
    wide = [extended(*problem, dtype) for problem in problems]
    filled = (wide * LANES)[:LANES]
    answer = batch(*(jnp.asarray(np.array(part)) for part in zip(*filled)))
    return jax.tree.map(lambda x: np.asarray(x)[: len(wide)], answer)


def extended(M, q, lower, upper, dtype):
    m = len(q)
    wide = np.eye(SIZE, dtype=dtype), np.zeros(SIZE, dtype), np.full(SIZE, -np.inf, dtype), np.full(SIZE, np.inf, dtype)
    wide[0][:m, :m], wide[1][:m], wide[2][:m], wide[3][:m] = M, q, lower, upper
    return wide


def draw(m, rng, family, count):
    """(M, q, lower, upper) in sixteenths: finite, half infinite, infinite and equal bounds."""
    problems = []
    for _ in range(count):
        M, q = family(m, rng)
        lower, upper = np.sort(rng.integers(-24, 25, (2, m)) / 16, axis=0)
        lower, upper = np.where(rng.random((2, m)) < 0.25, [[-np.inf], [np.inf]], [lower, upper])
        upper = np.where((rng.random(m) < 0.1) & np.isfinite(lower), lower, upper)
        problems.append((M, q, lower, upper))
    return problems


def violation(M, q, lower, upper, x):
    """max |mid(x - upper, M x + q, x - lower)| relative to max(|M| |x| + |q|), from its definition, in rationals."""
    M, (q, x) = oracle.rational(M), oracle.rational([q, x])
    w = [sum(a * b for a, b in zip(row, x)) + c for row, c in zip(M, q)]
    size = max(sum(abs(a * b) for a, b in zip(row, x)) + abs(c) for row, c in zip(M, q)) or 1
    worst = 0
    for xi, wi, low, high in zip(x, w, lower, upper):
        above = xi - oracle.rational([[high]])[0][0] if np.isfinite(high) else -abs(wi)
        below = xi - oracle.rational([[low]])[0][0] if np.isfinite(low) else abs(wi)
        worst = max(worst, abs(sorted((above, wi, below))[1]))
    return float(worst / size)


@functools.cache
def known():
    """Fresh problems of P-matrices of size four and their exact answers."""
    rng = np.random.default_rng(17)
    problems = [p for family in (positive_definite, nonsymmetric, triangular) for p in draw(4, rng, family, 20)]
    return problems, [np.array([float(x) for x in oracle.boxed(*p)]) for p in problems]


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_the_stored_problem_has_its_exact_answer(dtype):
    lower = [-np.inf if b is None else b for b in CASE["lo"]]
    upper = [np.inf if b is None else b for b in CASE["hi"]]
    answer = answers([(np.array(CASE["M"]), CASE["q"], lower, upper)], dtype)
    exact = np.array(CASE["solutions"][0])
    assert answer.status[0] == Status.SOLVED
    assert answer.backward_error[0] <= BACKWARD[dtype]
    bound = 8 * np.finfo(dtype).eps * answer.condition[0] * np.abs(exact).max()
    assert np.abs(answer.free[0] - exact).max() <= bound


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_fresh_problems_agree_with_exact_arithmetic(dtype):
    problems, exact = known()
    answer = answers(problems, dtype)
    assert (answer.status == Status.SOLVED).all()
    assert answer.backward_error.max() <= BACKWARD[dtype]
    for i, (M, q, lower, upper) in enumerate(problems):
        x = exact[i]
        # forward error: eight roundings amplified by the condition of the active equations; the data are above 1/16
        bound = 8 * np.finfo(dtype).eps * float(answer.condition[i]) * max(np.abs(x).max(), 2.0**-4)
        assert np.abs(answer.free[i, :4] - x).max() <= bound
        reaction = answer.w[i, :4].astype(float) - answer.z[i, SIZE : SIZE + 4]
        rounding = 8 * np.finfo(dtype).eps * (np.abs(M) @ np.abs(x) + np.abs(q)).max()
        assert np.abs(reaction - (M @ x + q)).max() <= bound * np.abs(M).sum(axis=1).max() + rounding
        assert violation(M, q, lower, upper, answer.free[i, :4]) <= BACKWARD[dtype]


def test_any_matrix_without_a_silent_wrong_answer():
    problems = draw(4, np.random.default_rng(3), indefinite, LANES)
    answer = answers(problems)
    assert (answer.status == Status.SOLVED).mean() > 0.3
    for status, x, problem in zip(answer.status, answer.free, problems):
        answered = status in (Status.SOLVED, Status.REDUNDANT)
        assert not answered or violation(*problem, x[:4]) <= BACKWARD[np.float64]
        if np.isfinite(problem[2:]).all():
            assert status != Status.INFEASIBLE  # a compact box always holds a solution (Hartman and Stampacchia 1966)


def test_a_free_unknown_that_cannot_be_balanced_is_not_solved():
    M, infinity = [[0.0, 0.0], [0.0, 1.0]], np.inf
    answer = answers(
        [
            (M, [1.0, -1.0], [-infinity, 0.0], [infinity, infinity]),  # w_1 = 1, to be zero
            (M, [1.0, -1.0], [-infinity, 0.0], [3.0, infinity]),  # w_1 = 1 needs a lower bound
            (M, [-1.0, -1.0], [-infinity, 0.0], [3.0, infinity]),
        ]
    )
    assert answer.status[0] == Status.INFEASIBLE
    assert answer.status[1] in (Status.INFEASIBLE, Status.RAY)
    assert answer.status[2] == Status.SOLVED
    np.testing.assert_array_equal(answer.free[2, :2], [3.0, 1.0])


def test_equal_bounds_prescribe_the_unknown_and_leave_its_reaction_free():
    M, q = np.array([[2.0, 1.0], [0.5, 1.0]]), np.array([1.0, -1.0])
    values = (-3.0, -4 / 3, 0.0, 5.0)  # -4/3: the reaction vanishes
    answer = answers([(M, q, [value, -np.inf], [value, np.inf]) for value in values] + [(M, q, [1.0, 2.0], [1.0, 2.0])])
    assert (answer.status == Status.SOLVED).all()
    assert not answer.redundant.any()
    for i, value in enumerate(values):
        x = np.array([value, 1 - 0.5 * value])
        np.testing.assert_allclose(answer.free[i, :2], x, atol=1e-15)
        np.testing.assert_allclose(answer.w[i, :2] - answer.z[i, SIZE : SIZE + 2], M @ x + q, atol=4e-15)
    np.testing.assert_array_equal(answer.free[-1, :2], [1.0, 2.0])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("far", [1e3, 1e6, 1e18])
def test_a_large_number_instead_of_infinity_costs_digits_but_never_in_silence(far, dtype):
    problems, exact = known()
    answer = answers([(M, q, np.maximum(low, -far), np.minimum(high, far)) for M, q, low, high in problems], dtype)
    solved = answer.status == Status.SOLVED
    assert solved.all() or far * np.finfo(dtype).eps > 1e-6  # distances of this size keep so few digits
    size = np.array([max(np.abs(x).max(), 2.0**-4) for x in exact])
    none = answers(problems, dtype)
    # roundings times the condition of the problem without the bounds far away, which play no part
    bound = 16 * np.finfo(dtype).eps * none.condition * size
    assert (np.abs(answer.free[:, :4] - exact).max(axis=1) <= bound)[solved].all()


@pytest.mark.parametrize(("a", "b"), [(40, -40), (-40, 40), (-17, 33)])
def test_powers_of_two_change_nothing_but_units(a, b):
    problems, length = [extended(*p, float) for p in known()[0]], 2.0 ** (b - a)
    plain = answers(problems)
    scaled = answers([(M * 2.0**a, q * 2.0**b, low * length, high * length) for M, q, low, high in problems])
    np.testing.assert_array_equal(scaled.status, plain.status)
    np.testing.assert_array_equal(scaled.degenerate, plain.degenerate)
    # the unit of x against that of M x + q changes the order of elimination, hence roundings
    bound = 16 * np.finfo(float).eps * plain.condition * np.maximum(np.abs(plain.free).max(axis=1), 2.0**-4)
    assert (np.abs(scaled.free / length - plain.free).max(axis=1) <= bound).all()


def test_rows_in_units_of_their_own_do_not_hide_each_other():
    problems, exact = known()
    D = 2.0 ** np.random.default_rng(10).integers(-20, 21, (len(problems), 4))
    answer = answers([(d[:, None] * M * d, d * q, low / d, high / d) for d, (M, q, low, high) in zip(D, problems)])
    plain = answers(problems)
    assert (answer.status == Status.SOLVED).all()
    np.testing.assert_array_equal(answer.degenerate, plain.degenerate)
    bound = 16 * np.finfo(float).eps * plain.condition * np.array([max(np.abs(x).max(), 2.0**-4) for x in exact])
    assert (np.abs(answer.free[:, :4] * D - exact).max(axis=1) <= bound).all()


def test_without_upper_bounds_it_is_the_lcp_and_conversions_lead_back():
    lower = np.array([-np.inf if b is None else b for b in CASE["lo"]])
    upper = np.array([np.inf if b is None else b for b in CASE["hi"]])
    lower[2], upper[0], lower[4] = -np.inf, np.inf, -1.0
    problem = BoxedLCP(CASE["M"], CASE["q"], lower, upper)
    exact = np.array([float(x) for x in oracle.boxed(CASE["M"], CASE["q"], lower, upper)])
    lcp, back = boxed_as_lcp(problem)
    assert lcp.q.shape == (10,)
    y = solve(lcp, Lemke()).z
    x, z, w = back(y, None)
    np.testing.assert_allclose(x, exact, atol=1e-14)
    np.testing.assert_allclose(w[:5] - z[5:], problem.M @ exact + problem.q, atol=1e-14)
    mixed, back = boxed_as_mlcp(problem)
    residual = mixed.A @ x + mixed.C @ z + mixed.a, mixed.D @ x + mixed.B @ z + mixed.b - w
    np.testing.assert_allclose(np.concatenate(residual), 0, atol=1e-14)
    assert back(x, z, w) == (x, z, w)

    boxed, back = lcp_as_boxed(LCP(CASE["M"], CASE["q"]))
    answer = answers([tuple(map(np.asarray, (boxed.M, boxed.q, boxed.lower, boxed.upper)))])
    free, z, w = back(answer.z[0], answer.w[0])
    truth = oracle.lcp(np.array(CASE["M"]), np.array(CASE["q"])).points[0]
    assert free.shape == (0,)
    np.testing.assert_allclose((z, w), np.array(truth, float), atol=1e-14)


def test_every_equilibrium_of_an_unstable_spring_between_stops():
    every = all_solutions(BoxedLCP([[-1.0]], [0.25], [-1.0], [1.0]))  # w = 1/4 - x: both stops and the balance between
    np.testing.assert_allclose(sorted(every.free[every.valid][:, 0]), [-1.0, 0.25, 1.0])
    assert every.several


@pytest.mark.parametrize(
    ("lower", "upper", "where"),
    [
        ([0.0, 2.0], [1.0, 1.0], r"lower\[1\] is 2.0 and upper\[1\] is 1.0"),
        ([0.0, np.nan], [1.0, 1.0], r"lower\[1\] is nan"),
        ([0.0, 0.0], [np.nan, 1.0], r"upper\[0\] is nan"),
        ([np.inf, 0.0], [np.inf, 1.0], r"lower\[0\] is inf"),
        ([-np.inf, 0.0], [-np.inf, 1.0], r"upper\[0\] is -inf"),
    ],
)
def test_bounds_that_hold_no_number_are_named_or_bad_input_in_their_lane(lower, upper, where):
    with pytest.raises(ValueError, match=where):
        BoxedLCP(np.eye(2), -np.ones(2), np.array(lower), np.array(upper))
    answer = answers([(np.eye(2), -np.ones(2), lower, upper), (np.eye(2), -np.ones(2), [0.0, 0.0], [0.5, 0.5])])
    np.testing.assert_array_equal(answer.status, [Status.BAD_INPUT, Status.SOLVED])
    assert np.isnan(answer.free[0]).all()
    np.testing.assert_array_equal(answer.free[1, :2], 0.5)


def test_shapes_and_starts_that_do_not_fit_are_told():
    with pytest.raises(ValueError, match=r"expected M \(m, m\), q \(m\), lower \(m\), upper \(m\)"):
        BoxedLCP(np.eye(2), np.zeros(2), np.zeros(1), np.ones(2))
    problem = BoxedLCP(np.eye(2), -np.ones(2), np.zeros(2), np.ones(2))
    with pytest.raises(ValueError, match=r"start has shape \(2,\), the problem needs \(4,\)"):
        solve(problem, Lemke(), start=np.zeros(2))
    with pytest.raises(ValueError, match=r"write jax\.vmap"):
        solve(jax.tree.map(lambda x: jnp.stack([x, x]), problem), Lemke())


def test_the_derivative_matches_central_differences_in_every_argument():
    M = np.array([[3.0, 1.0, -0.5, 0.5], [0.5, 2.0, 1.0, 0.0], [-1.0, 0.25, 2.0, 0.5], [0.0, 0.5, -0.5, 2.0]])
    q = np.array([4.0, -6.0, -1.0, 0.5])  # at its lower bound, at its upper bound, between, free
    lower, upper = np.array([-0.5, -1.0, -3.0, -np.inf]), np.array([2.0, 1.0, 3.0, np.inf])
    data, rng, step = (M, q, lower, upper), np.random.default_rng(0), 1e-5
    directions = [rng.normal(size=part.shape) for part in data]
    moved = [
        [part + (k == j) * sign * step * way for j, (part, way) in enumerate(zip(data, directions))]
        for k in range(4)
        for sign in (1, -1)
    ]
    x = answers([data])
    np.testing.assert_array_equal(x.free[0, :2], [-0.5, 1.0])
    assert abs(x.free[0, 2]) < 3
    nearby = answers(moved).free[:, :4].reshape(4, 2, 4)
    differences = (nearby[:, 0] - nearby[:, 1]) / (2 * step)

    given = tuple(map(jnp.asarray, data))
    x_of = lambda *data: implicit(BoxedLCP(*data), x.free[0, :4])  # noqa: E731
    pushed, pulled = (jax.jit(jac(x_of, (0, 1, 2, 3)))(*given) for jac in (jax.jacfwd, jax.jacrev))
    for forward, backward, way, difference in zip(pushed, pulled, directions, differences):
        np.testing.assert_allclose(np.tensordot(forward, way, way.ndim), difference, atol=1e-8)  # step^2 and eps / step
        np.testing.assert_allclose(backward, forward, atol=1e-14)


def test_equal_bounds_that_move_together_carry_their_unknown():
    M, q = jnp.array([[2.0, 1.0], [0.5, 1.0]]), jnp.array([1.0, -1.0])
    held = lambda s: BoxedLCP(M, q, jnp.array([s, -jnp.inf]), jnp.array([s, jnp.inf]))  # noqa: E731
    tangent = jax.jacfwd(lambda s: implicit(held(s), jnp.array([0.5, 0.75])))(jnp.asarray(0.5))
    np.testing.assert_allclose(tangent, [1.0, -0.5], rtol=1e-14)


@pytest.mark.slow
def test_a_bad_lane_keeps_its_nan_and_infinite_bounds_have_a_finite_derivative():
    problems = [extended(*p, float) for p in known()[0][:LANES]]
    problems = (problems * 2)[:LANES]
    problems[2][1][1] = np.nan
    given = [jnp.asarray(np.array(part)) for part in zip(*problems)]
    clean = jnp.arange(LANES) % len(known()[0]) != 2
    total = lambda *data: jnp.nansum(batch(*data).free)  # noqa: E731
    for gradient in jax.grad(total, (0, 1, 2, 3))(*given):
        assert np.isfinite(gradient).all()
        assert (np.asarray(gradient)[2] == 0).all()
    together = batch(*given)
    assert (np.asarray(together.status)[np.asarray(clean)] == Status.SOLVED).all()
    alone = solve(BoxedLCP(*problems[5]), Lemke())
    np.testing.assert_allclose(alone.free, together.free[5], rtol=1e-12, atol=1e-15)  # fused differently
