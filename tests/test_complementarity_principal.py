"""Principal pivoting: exact answers on P-matrices, cubes, ties and cycles of other methods; honest ends beyond them."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from families import FAMILIES, UNIQUE, circulant, fathi, infeasible_semidefinite, mass_ratio, murty, ties

from jaxcontact.complementarity import LCP, PrincipalPivoting, Status, solve

BACKWARD = {np.float64: 1e-13, np.float32: 2e-6}
"""The accuracy asked of every SOLVED."""

SIZE = 5
"""All problems are brought to one size, because compilation takes longer than solving."""

batch = jax.jit(jax.vmap(lambda M, q: solve(LCP(M, q), PrincipalPivoting())))
warm = jax.jit(jax.vmap(lambda M, q, start: solve(LCP(M, q), PrincipalPivoting(), start=start)))


def answers(problems, dtype=np.float64):
    """The solutions of LCPs, each extended to SIZE by contacts that touch no other and stay open."""
    M = np.array([np.block([[M, np.zeros((len(q), SIZE - len(q)))], [np.eye(SIZE)[len(q) :]]]) for M, q in problems])
    q = np.array([np.append(q, np.ones(SIZE - len(q))) for _, q in problems])
    return jax.tree.map(np.asarray, batch(jnp.asarray(M, dtype), jnp.asarray(q, dtype)))


@functools.cache
def fresh(dtype):
    """Family names, problems in the dtype's precision, and the exact truth of each."""
    rng = np.random.default_rng(21)
    drawn = [(f.__name__, *f(4, rng)) for f in FAMILIES for _ in range(1 if f in (murty, fathi) else 8)]
    problems = [(M.astype(dtype).astype(float), q.astype(dtype).astype(float)) for _, M, q in drawn]
    return [name for name, _, _ in drawn], problems, [oracle.lcp(M, q) for M, q in problems]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_p_matrix_is_solved_and_nothing_is_wrong_in_silence(dtype):
    names, problems, truths = fresh(dtype)
    answer = answers(problems, dtype)
    p_matrices = {f.__name__ for f in UNIQUE} - ({"mass_ratio"} if dtype == np.float32 else set())  # of ratio 1e8
    for i, (name, (M, _), truth) in enumerate(zip(names, problems, truths)):
        status = Status(int(answer.status[i]))
        assert status is Status.SOLVED or name not in p_matrices, name
        assert status is not Status.INFEASIBLE or truth.verdict == "none", name
        if status is not Status.SOLVED:
            continue
        assert truth.verdict != "none", name
        assert answer.backward_error[i] <= BACKWARD[dtype]
        if truth.verdict == "unique":
            exact = np.array(truth.points[0][0], float)
            held = exact > 0
            condition = np.linalg.cond(M[np.ix_(held, held)]) if held.any() else 1.0
            # forward error: eight roundings amplified by the condition of the active equations
            bound = (
                8
                * float(np.finfo(dtype).eps)
                * min(max(condition, float(answer.condition[i])), 1e300)
                * float(np.abs(exact).max())
            )
            assert np.abs(answer.z[i, :4] - exact).max() <= bound, name


def test_a_matrix_on_which_the_active_set_iteration_cycles_is_solved():
    # Ben Gharbia and Gilbert 2012: for I + 2 shift, min(z, M z + q) = 0 by Newton's method has period three
    M, q = circulant(3, np.random.default_rng(0))[0], np.ones(3)
    z, met = np.array([-1.0, 0.0, 0.0]), []
    for _ in range(9):
        active = z > M @ z + q
        z = np.linalg.solve(np.where(active[:, None], M, np.eye(3)), np.where(active, -q, 0))
        met.append(tuple(active))
    assert met[3:6] == met[6:9]
    assert len(set(met[3:6])) == 3
    loads = [np.ones(3), -np.ones(3), np.array([-1.0, 2.0, -3.0]), np.array([-3.0, -1.0, 0.0])]
    answer = answers([(M, load) for load in loads])
    assert (answer.status == Status.SOLVED).all()
    for z, load in zip(answer.z, loads):
        np.testing.assert_allclose(z[:3], np.array(oracle.lcp(M, load).points[0][0], float), atol=1e-15)


def test_cubes_end_within_their_corners():
    rng = np.random.default_rng(0)
    for family in (murty, fathi):
        M, q = family(10, rng)
        answer = solve(LCP(M, q), PrincipalPivoting())
        assert answer.status == Status.SOLVED
        assert answer.steps < 2**10
    short = solve(LCP(*murty(10, rng)), PrincipalPivoting(max_steps=5))
    assert short.status == Status.MAX_STEPS
    assert np.isnan(short.z).all()


def test_ties_and_mass_ratios_of_larger_size_keep_their_backward_error():
    rng = np.random.default_rng(4)
    problems = [f(SIZE, rng) for f in (mass_ratio, ties) for _ in range(20)]
    problems += [(M, -M @ (np.arange(SIZE) < 2)) for M, _ in problems[20:]]  # z = (1, 1, 0, 0, 0), all w = 0
    answer = answers(problems)
    assert (answer.status == Status.SOLVED).all()
    assert answer.backward_error.max() <= BACKWARD[np.float64]
    np.testing.assert_array_equal(answer.degenerate[40:], SIZE - 2)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_one_contact_is_right_for_every_sign(dtype):
    M, q = (x.ravel() for x in np.meshgrid([2.0, 0.0, -2.0], [3.0, 0.0, -3.0], indexing="ij"))
    answer = jax.vmap(lambda M, q: solve(LCP(M, q), PrincipalPivoting()))(
        jnp.asarray(M[:, None, None], dtype), jnp.asarray(q[:, None], dtype)
    )
    none = (M <= 0) & (q < 0)
    np.testing.assert_array_equal(answer.status == Status.SOLVED, ~none)
    np.testing.assert_array_equal(answer.status == Status.INFEASIBLE, none)
    np.testing.assert_array_equal(answer.z[~none, 0], np.where(q < 0, 1.5, 0.0)[~none])


def test_contacts_that_push_against_one_another_are_proved_infeasible():
    rng = np.random.default_rng(6)
    problems = [infeasible_semidefinite(4, rng) for _ in range(40)]
    answer = answers(problems)
    for status, problem in zip(answer.status, problems):
        solvable = oracle.lcp(*problem).verdict != "none"
        assert status == Status.SOLVED if solvable else status == Status.INFEASIBLE


def test_no_diagonal_pivot_is_no_claim_although_a_solution_exists():
    M, q = np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([-1.0, -1.0])  # z = (1, 1), by a pivot on a block of two
    assert oracle.lcp(M, q).verdict == "unique"
    answer = answers([(M, q)])
    assert answer.status[0] == Status.INACCURATE
    assert np.isnan(answer.z[0]).all()


@pytest.mark.slow
def test_a_warm_start_at_the_answer_needs_only_its_own_pivots_and_a_wrong_one_does_no_harm():
    names, problems, _ = fresh(np.float64)
    problems = [p for name, p in zip(names, problems) if name in {f.__name__ for f in UNIQUE}]
    M = jnp.asarray(np.array([p[0] for p in problems]))
    q = jnp.asarray(np.array([p[1] for p in problems]))
    right = jnp.asarray(answers(problems).z[:, :4])
    again = warm(M, q, right)
    assert (np.asarray(again.status) == Status.SOLVED).all()
    assert bool(again.start_used.all())
    np.testing.assert_array_equal(again.steps, (right > 0).sum(axis=1))
    wrong = warm(M, q, jnp.where(right > 0, 0, 1.0))
    assert (np.asarray(wrong.status) == Status.SOLVED).all()
    size = np.maximum(np.abs(np.asarray(right)).max(axis=1), 1e-3)
    far = np.abs(np.asarray(wrong.z) - np.asarray(right)).max(axis=1) / size
    assert (far <= 16 * np.finfo(float).eps * np.asarray(again.condition)).all()


@pytest.mark.parametrize(("a", "b"), [(40, -40), (-17, 33)])
def test_powers_of_two_change_no_digit(a, b):
    rng = np.random.default_rng(7)
    problems = [
        (J @ J.T + np.triu(S, 1), q)
        for J, S, q in zip(*(rng.normal(size=(20, SIZE, n)) for n in (7, SIZE)), rng.normal(size=(20, SIZE)))
    ]
    D = 2.0 ** rng.integers(-8, 9, (20, SIZE))
    plain = answers(problems)
    scaled = answers([(M * 2.0**a, q * 2.0**b) for M, q in problems])
    rows = answers([(d[:, None] * M * d, d * q) for d, (M, q) in zip(D, problems)])
    for other, factor in ((scaled, 2.0 ** (a - b)), (rows, D)):
        np.testing.assert_array_equal(other.status, plain.status)
        np.testing.assert_array_equal(other.z * factor, plain.z)


def test_numbers_that_are_not_finite_stay_in_their_lane():
    M, q = np.eye(SIZE) * 2, -np.ones(SIZE)
    answer = answers([(M, np.where(np.arange(SIZE) == 1, np.nan, q)), (M, q)])
    np.testing.assert_array_equal(answer.status, [Status.BAD_INPUT, Status.SOLVED])
    np.testing.assert_array_equal(answer.z[1], 0.5)
    with pytest.raises(ValueError, match="max_steps must be at least 1"):
        PrincipalPivoting(max_steps=0)
