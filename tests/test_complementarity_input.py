"""Bad input at the door of complementarity: eager raises and explains, traced becomes a status."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact.complementarity import (
    LCP,
    MLCP,
    AbsoluteValueEquation,
    Banach,
    BoxedLCP,
    Direct,
    Lemke,
    ProjectedGaussSeidel,
    Status,
    all_solutions,
    solve,
)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_eager_numbers_that_are_not_finite_are_named_with_their_index(bad):
    with pytest.raises(ValueError, match=r"LCP\.q\[1\] is (nan|inf|-inf)"):
        LCP(np.eye(2), np.array([1.0, bad]))
    with pytest.raises(ValueError, match=r"LCP\.M\[0, 1\]"):
        LCP(np.array([[1.0, bad], [0.0, 1.0]]), np.zeros(2))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_traced_numbers_that_are_not_finite_are_bad_input_in_their_lane_only(bad):
    q = jnp.array([[-1.0, bad], [-1.0, -2.0]])
    answer = jax.jit(jax.vmap(lambda q: solve(LCP(jnp.eye(2), q), Lemke())))(q)
    np.testing.assert_array_equal(answer.status, [Status.BAD_INPUT, Status.SOLVED])
    assert np.isnan(answer.z[0]).all()
    np.testing.assert_array_equal(answer.z[1], [1.0, 2.0])


@pytest.mark.parametrize("shapes", [((2, 3), (2,)), ((2, 2), (3,)), ((2,), (2,)), ((2, 2), (2, 2)), ((4, 2, 2), (2,))])
def test_shapes_that_do_not_fit_are_told_apart_eagerly_and_in_a_trace(shapes):
    data = [np.ones(shape) for shape in shapes]
    with pytest.raises(ValueError, match=r"expected M \(m, m\), q \(m\)"):
        LCP(*data)
    with pytest.raises(ValueError, match=r"expected M \(m, m\), q \(m\)"):
        jax.eval_shape(LCP, *data)


def test_a_batch_is_sent_to_vmap():
    problem = LCP(np.stack([np.eye(2)] * 3), -np.ones((3, 2)))
    with pytest.raises(ValueError, match=r"write jax\.vmap"):
        solve(problem, Lemke())
    np.testing.assert_array_equal(jax.vmap(solve, (0, None))(problem, Lemke()).z, np.ones((3, 2)))


def test_no_contact_is_solved_and_an_empty_batch_stays_empty():
    answer = solve(LCP(np.zeros((0, 0)), np.zeros(0)), Lemke())
    assert answer.status == Status.SOLVED
    assert answer.z.shape == (0,)
    assert jax.jacfwd(lambda q: solve(LCP(jnp.zeros((0, 0)), q), Lemke()).z)(jnp.zeros(0)).shape == (0, 0)
    assert all_solutions(LCP(np.zeros((0, 0)), np.zeros(0))).count == 1
    batch = jax.vmap(lambda M, q: solve(LCP(M, q), Lemke()))(jnp.zeros((0, 2, 2)), jnp.zeros((0, 2)))
    assert batch.z.shape == (0, 2)


def test_equations_without_contacts_are_a_linear_solve():
    empty = {"C": np.zeros((2, 0)), "D": np.zeros((0, 2)), "B": np.zeros((0, 0)), "b": np.zeros(0)}
    answer = solve(MLCP(A=np.array([[2.0, 1.0], [1.0, 3.0]]), a=np.array([-3.0, -4.0]), **empty), Lemke())
    assert answer.status == Status.SOLVED
    np.testing.assert_allclose(answer.free, [1.0, 1.0], rtol=1e-15)


def test_integers_become_the_default_float_and_halves_are_refused():
    answer = solve(LCP([[2, 1], [1, 2]], [-5, -6]), Lemke())
    assert answer.z.dtype == jnp.float64
    with pytest.raises(TypeError, match=r"bfloat16.*float32 or float64"):
        LCP(jnp.eye(2, dtype=jnp.bfloat16), jnp.zeros(2, jnp.bfloat16))
    with pytest.raises(TypeError, match="complex"):
        LCP(np.eye(2) * 1j, np.zeros(2))
    with pytest.raises(TypeError, match=r"one dtype.*float32.*float64"):
        LCP(np.eye(2, dtype=np.float32), np.zeros(2))


def test_float64_that_jax_would_round_is_announced():
    with jax.enable_x64(False), pytest.warns(UserWarning, match="rounded to float32"):
        LCP(np.eye(2), np.zeros(2, np.float32))


def test_half_made_methods_and_problems_are_refused():
    problem = LCP(np.eye(2), np.zeros(2))
    with pytest.raises(TypeError, match=r"expected a method such as Lemke\(\)"):
        solve(problem, Lemke)
    with pytest.raises(TypeError, match="expected a method"):
        solve(problem, "lemke")
    with pytest.raises(TypeError, match="expected a problem"):
        solve((np.eye(2), np.zeros(2)), Lemke())
    with pytest.raises(TypeError, match="without free unknowns, got BoxedLCP"):
        solve(BoxedLCP(np.eye(2), np.zeros(2), np.zeros(2), np.ones(2)), Banach())


@pytest.mark.parametrize("covering", [(0.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (np.inf, 1.0)])
def test_a_covering_vector_must_be_positive(covering):
    with pytest.raises(ValueError, match="covering must be positive"):
        Lemke(covering=covering)


def test_a_covering_vector_must_have_an_entry_per_contact():
    with pytest.raises(ValueError, match="3 entries for 2 contacts"):
        solve(LCP(np.eye(2), -np.ones(2)), Lemke(covering=(1.0, 1.0, 1.0)))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Lemke(max_steps=0),
        lambda: ProjectedGaussSeidel(sweeps=0),
        lambda: ProjectedGaussSeidel(relaxation=2.0),
        lambda: ProjectedGaussSeidel(relaxation=np.nan),
        lambda: ProjectedGaussSeidel(tolerance=0.0),
        lambda: Banach(iterations=-1),
    ],
)
def test_budgets_and_tolerances_out_of_range_are_refused(make):
    with pytest.raises(ValueError, match="must be"):
        make()


def test_too_many_contacts_for_a_method_are_counted_for_the_user():
    with pytest.raises(ValueError, match="5 contacts, takes at most 4"):
        solve(LCP(np.eye(5), -np.ones(5)), Direct())
    with pytest.raises(ValueError, match=r"2\^11 modes"):
        all_solutions(LCP(np.eye(11), np.zeros(11)))


@pytest.mark.parametrize("start", [np.array([np.nan, 1.0]), np.array([-1.0, 1.0]), np.array([np.inf, 0.0])])
def test_a_bad_warm_start_is_ignored_and_flagged(start):
    problem = LCP(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0]))
    answer = solve(problem, ProjectedGaussSeidel(), start=start)
    assert not answer.start_used
    np.testing.assert_allclose(answer.z, [4 / 3, 7 / 3], rtol=1e-14)
    good = solve(problem, ProjectedGaussSeidel(), start=np.array([4 / 3, 7 / 3]))
    assert good.start_used
    assert good.steps < answer.steps
    with pytest.raises(ValueError, match=r"start has shape \(3,\)"):
        solve(problem, ProjectedGaussSeidel(), start=np.zeros(3))


@pytest.mark.parametrize("method", [Lemke(), ProjectedGaussSeidel(sweeps=50), Direct()])
def test_a_contact_between_immovable_bodies_is_never_divided_by(method):
    M = jnp.array([[0.0, 0.0], [0.0, 2.0]])
    idle = solve(LCP(M, jnp.array([1.0, -2.0])), method)
    assert idle.status == Status.SOLVED
    np.testing.assert_array_equal(idle.z, [0.0, 1.0])
    assert solve(LCP(M, jnp.array([-1.0, -2.0])), method).status == Status.INFEASIBLE


@pytest.mark.parametrize(("matrix", "load"), [(1e-300, -1e300), (1e300, -1e300), (1e-300, -1e-300), (1e290, -1e-10)])
def test_scales_at_the_ends_of_the_format_solve_or_say_bad_input(matrix, load):
    answer = solve(LCP(matrix * np.eye(2), load * np.ones(2)), Lemke())
    if np.isfinite(-load / matrix):
        assert answer.status == Status.SOLVED
        np.testing.assert_allclose(answer.z, -load / matrix, rtol=1e-15)
    else:
        assert answer.status == Status.BAD_INPUT
        assert np.isnan(answer.z).all()


def test_every_status_has_a_sentence_and_a_remedy():
    for status in Status:
        assert status.sentence.endswith(".")
        assert status.remedy.endswith(".")


def test_equations_that_contradict_each_other_are_infeasible():
    empty = {"C": np.zeros((2, 1)), "D": np.zeros((1, 2)), "B": np.eye(1), "b": np.array([-1.0])}
    twice = np.array([[1.0, 2.0], [1.0, 2.0]])
    consistent = solve(MLCP(A=twice, a=np.array([-5.0, -5.0]), **empty), Lemke())
    assert consistent.status == Status.REDUNDANT
    np.testing.assert_allclose(consistent.free, [1.0, 2.0], rtol=1e-14)  # the least norm on u_1 + 2 u_2 = 5
    np.testing.assert_allclose(consistent.z, 1.0, rtol=1e-14)
    assert solve(MLCP(A=twice, a=np.array([-5.0, -6.0]), **empty), Lemke()).status == Status.INFEASIBLE


def test_an_absolute_value_equation_needs_square_matrices():
    with pytest.raises(ValueError, match="AbsoluteValueEquation"):
        AbsoluteValueEquation(np.eye(2), np.eye(3), np.zeros(2))
