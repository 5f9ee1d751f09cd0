"""float32 first, float64 where that is in doubt: what is promised of the answers, and which lanes are solved twice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from families import (
    beyond_critical,
    infeasible_semidefinite,
    low_rank,
    mass_ratio,
    near_critical,
    positive_definite,
    sliding,
    ties,
)

from jaxcontact.complementarity import (
    LCP,
    MLCP,
    AbsoluteValueEquation,
    Lemke,
    PrincipalPivoting,
    Status,
    solve,
    solve_in_two_precisions,
)
from jaxcontact.complementarity.bars import backward_error_bound

ACCURACY = 1e-3

SAME = ("z", "w", "status", "steps", "residual")
"""What is computed again in float64 and is that of float64 alone."""


def batch(families, m, each=40, seed=0):
    rng = np.random.default_rng(seed)
    drawn = [family(m, rng) for family in families for _ in range(each)]
    return tuple(jnp.asarray(np.array(part)) for part in zip(*drawn, strict=True))


def twice(M, q, method=None, **options):
    return solve_in_two_precisions(LCP(M, q), method or PrincipalPivoting(), **options)


@pytest.mark.parametrize("m", [2, 5])
def test_answers_of_float32_are_as_accurate_as_promised_and_the_others_are_those_of_float64(m):
    """On families with one solution, where float64 is right to 1e-9 (condition below 1e5)."""
    M, q = batch((positive_definite, sliding, near_critical, mass_ratio), m)
    found = jax.vmap(lambda M, q: twice(M, q, accuracy=ACCURACY))(M, q)
    exact = jax.vmap(lambda M, q: solve(LCP(M, q), PrincipalPivoting()))(M, q)
    redone = np.asarray(found.redone)
    assert 10 < redone.sum() < len(q) - 10
    assert np.asarray(exact.condition)[~redone].max() < 1e5
    size = np.abs(exact.z).max(1) + np.abs(exact.w).max(1)
    miss = np.abs(found.solution.z - exact.z).max(1)
    assert (miss <= ACCURACY * size)[~redone].all()
    pairs = {name: (getattr(found.solution, name)[redone], getattr(exact, name)[redone]) for name in SAME}
    if jax.default_backend() == "cpu":
        assert all(np.array_equal(*pair, equal_nan=True) for pair in pairs.values())
    else:  # libraries choose their code by the size of the batch: both are right to their eta times the condition
        assert np.array_equal(*pairs["status"])
        allowed = 2 * float(backward_error_bound(jnp.float64)) * (exact.condition * size)[redone]
        assert (np.abs(pairs["z"][0] - pairs["z"][1]).max(1) <= allowed).all()
    assert (found.solution.status == Status.SOLVED)[~redone].all()


def test_no_margin_no_solution_and_dependent_equations_are_doubtful():
    M, q = batch((ties, low_rank, infeasible_semidefinite, beyond_critical), 4)
    M, q = M.at[7, 0, 0].set(jnp.nan), q.at[9, 1].set(jnp.inf)
    found = jax.jit(jax.vmap(lambda M, q: twice(M, q, Lemke(), accuracy=np.inf)))(M, q)
    exact = jax.vmap(lambda M, q: solve(LCP(M, q), Lemke()))(M, q)
    assert np.asarray(found.redone)[[7, 9]].all()
    assert (exact.degenerate[~found.redone] == 0).all()
    assert exact.redundant.any()
    assert not exact.redundant[~found.redone].any()
    assert np.array_equal(found.solution.status, exact.status)
    assert {Status.INFEASIBLE, Status.RAY, Status.BAD_INPUT} <= set(np.asarray(exact.status).tolist())


def test_one_problem_batches_of_batches_and_of_none_are_the_same():
    M, q = batch((sliding, near_critical), 3, each=6)
    whole = jax.vmap(twice)(M, q)
    nested = jax.vmap(jax.vmap(twice))(M.reshape(3, 4, 3, 3), q.reshape(3, 4, 3))
    assert np.array_equal(nested.solution.z.reshape(whole.solution.z.shape), whole.solution.z, equal_nan=True)
    assert np.array_equal(nested.redone.ravel(), whole.redone)
    for k in range(0, 12, 3):
        alone = twice(M[k], q[k])
        assert bool(alone.redone) == bool(whole.redone[k])
        np.testing.assert_allclose(alone.solution.z, whole.solution.z[k], rtol=1e-6)
    shared = jax.vmap(lambda q: twice(M[0], q))(q)
    assert shared.redone.shape == (12,)
    assert jax.vmap(twice)(M[:0], q[:0]).solution.z.shape == (0, 3)


def test_more_doubtful_lanes_than_are_solved_at_a_time():
    """Six hundred of them, and every one is the answer of float64."""
    M = jnp.asarray(np.diag([1.0, 1e-9]) + 1e-5)
    q = jnp.asarray(np.random.default_rng(0).normal(size=(600, 2)) - 2)
    found = jax.vmap(lambda q: twice(M, q, accuracy=1e-9))(q)
    assert found.redone.all()
    assert np.array_equal(found.solution.z, jax.vmap(lambda q: solve(LCP(M, q), PrincipalPivoting()).z)(q))


@pytest.mark.parametrize("accuracy", [1e-3, 1e-12])
def test_the_derivative_is_that_of_the_given_problem(accuracy):
    """dz/dq = -M_SS^-1 on the active rows S, from float32 (to its rounding of z, which does not enter) and float64."""
    M, q = jnp.array([[2.0, 1.0], [0.5, 3.0]]), jnp.array([-1.0, -2.0])
    found = jax.jacrev(lambda q: twice(M, q, accuracy=accuracy).solution.z)(q)
    np.testing.assert_allclose(found, -np.linalg.inv(M), rtol=1e-14)
    q = jnp.stack([q, q * jnp.nan])
    slopes = jax.vmap(jax.grad(lambda q: twice(M, q, accuracy=accuracy).solution.z.sum()))(q)
    assert np.isfinite(slopes).all()


def test_other_kinds_of_problems():
    A, B, w = np.array([[3.0, 1.0], [0.0, 2.0]]), np.array([[1.0, 0.5], [0.0, 1.0]]), np.array([-1.0, 4.0])
    found = solve_in_two_precisions(AbsoluteValueEquation(A, B, w), Lemke()).solution
    np.testing.assert_allclose(A @ found.free - B @ np.abs(found.free) + w, 0, atol=1e-6)
    one = np.ones((1, 1))
    found = solve_in_two_precisions(MLCP(2 * one, one, -one[0], -one, one, -one[0]), Lemke()).solution
    # 2 u + v = 1 and w = -u + v - 1 = 0: u = 0, v = 1
    np.testing.assert_allclose([found.free[0], found.z[0]], [0, 1], atol=1e-6)


def test_what_cannot_be_meant_is_refused():
    with pytest.raises(ValueError, match="float64"):
        twice(jnp.eye(2, dtype=jnp.float32), jnp.ones(2, jnp.float32))
    with pytest.raises(ValueError, match="positive"):
        twice(jnp.eye(2), jnp.ones(2), accuracy=0)
