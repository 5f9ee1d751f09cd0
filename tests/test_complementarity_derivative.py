"""Derivatives of solutions: exact rational derivatives, kinks, second order, failed lanes, dependent contacts."""

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest

from jaxcontact.complementarity import (
    LCP,
    MLCP,
    AbsoluteValueEquation,
    Direct,
    HorizontalLCP,
    Lemke,
    ProjectedGaussSeidel,
    Status,
    implicit,
    solve,
)

M = np.array([[4.0, 1.0, -0.5], [0.5, 3.0, 1.0], [-1.0, 0.25, 2.0]])
Q = np.array([-3.0, 2.0, -1.0])
"""Contacts 0 and 2 held, contact 1 open, far from any kink."""


def z_of(M, q):
    return solve(LCP(M, q), Lemke()).z


def exact_response(M, held, load):
    """-M_SS^-1 load_S in rational arithmetic, zero elsewhere."""
    block = oracle.rational(M[np.ix_(held, held)])
    inner = oracle.solve(block, [-x for x in oracle.rational([load[held]])[0]])
    response = np.zeros(len(load))
    response[held] = [float(x) for x in inner]
    return response


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev])
def test_the_derivative_is_the_exact_response_of_the_held_contacts(jacobian, dtype):
    held = np.array([0, 2])
    expected = np.stack([exact_response(M, held, e) for e in np.eye(3)], axis=1)
    found = jacobian(z_of, 1)(jnp.asarray(M, dtype), jnp.asarray(Q, dtype))
    # 64 roundings times a condition of 2
    np.testing.assert_allclose(found, expected, atol=64 * 2 * np.finfo(dtype).eps)
    assert found.dtype == dtype


def test_derivative_with_respect_to_the_matrix_against_central_differences():
    direction = np.array([[0.3, -0.2, 0.1], [0.0, 0.5, 0.4], [-0.6, 0.2, 0.7]])
    step = 1e-5
    _, tangent = jax.jvp(z_of, (jnp.asarray(M), jnp.asarray(Q)), (jnp.asarray(direction), jnp.zeros(3)))
    difference = (z_of(M + step * direction, Q) - z_of(M - step * direction, Q)) / (2 * step)
    np.testing.assert_allclose(tangent, difference, atol=1e-9)  # step^2 times a third derivative of size one


def test_second_derivatives_match_the_closed_form_of_one_contact():
    z = lambda a, b: solve(LCP(a[None, None], b[None]), Lemke()).z[0]  # noqa: E731  z = -b / a
    a, b = jnp.asarray(2.0), jnp.asarray(-3.0)
    np.testing.assert_allclose(jax.grad(jax.grad(z, 0), 0)(a, b), -2 * b / a**3, rtol=1e-14)
    np.testing.assert_allclose(jax.jacfwd(jax.jacrev(z, 0), 1)(a, b), 1 / a**2, rtol=1e-14)
    np.testing.assert_allclose(jax.grad(jax.grad(z, 1), 1)(a, b), 0.0)


@pytest.mark.parametrize("method", [Direct(), ProjectedGaussSeidel()])
def test_the_derivative_does_not_depend_on_the_method(method):
    matrix, q = jnp.asarray(M[:2, :2]), jnp.asarray([-3.0, -2.0])
    found = jax.jacfwd(lambda q: solve(LCP(matrix, q), method).z)(q)
    np.testing.assert_allclose(found, -np.linalg.inv(M[:2, :2]), rtol=1e-13)


def test_at_a_kink_the_derivative_lies_between_the_one_sided_ones():
    q = jnp.asarray([-3.0, -0.375])  # z = (3/4, 0), w_2 = 0 exactly: contact 2 touches without force
    matrix = jnp.asarray(M[:2, :2])
    answer = solve(LCP(matrix, q), Lemke())
    assert (answer.status, answer.degenerate) == (Status.SOLVED, 1)
    load = np.array([0.0, 1.0])
    opening, closing = exact_response(M[:2, :2], np.array([0]), load), exact_response(M[:2, :2], np.array([0, 1]), load)
    _, tangent = jax.jvp(lambda q: z_of(matrix, q), (q,), (jnp.asarray(load),))
    share = (tangent - opening) @ (closing - opening) / ((closing - opening) @ (closing - opening))
    assert 0 <= share <= 1
    np.testing.assert_allclose(tangent, opening + share * (closing - opening), atol=1e-14)


def test_failed_lanes_are_nan_with_zero_derivative_and_leave_their_neighbours_alone():
    matrices = jnp.array([[[2.0]], [[-1.0]], [[jnp.nan]], [[4.0]]])
    q = jnp.array([[-3.0], [-1.0], [-1.0], [-2.0]])
    answer = jax.vmap(lambda M, q: solve(LCP(M, q), Lemke()))(matrices, q)
    np.testing.assert_array_equal(answer.status, [Status.SOLVED, Status.INFEASIBLE, Status.BAD_INPUT, Status.SOLVED])
    np.testing.assert_array_equal(np.isnan(answer.z[:, 0]), [False, True, True, False])
    total = lambda M, q: jnp.nansum(jax.vmap(z_of)(M, q))  # noqa: E731
    gradient = jax.grad(total, (0, 1))(matrices, q)
    np.testing.assert_allclose(gradient[0][:, 0, 0], [-3 / 4, 0, 0, -2 / 16], rtol=1e-15)
    np.testing.assert_allclose(gradient[1][:, 0], [-1 / 2, 0, 0, -1 / 4], rtol=1e-15)


def test_dependent_contacts_are_flagged_and_what_is_determined_is_differentiated():
    ones = jnp.ones((2, 2))  # two supports under one block: z_1 + z_2 = load
    weight = lambda load: solve(LCP(ones, -load * jnp.ones(2)), Lemke())  # noqa: E731
    assert weight(1.0).status == Status.SOLVED
    assert weight(1.0).redundant
    assert not solve(LCP(jnp.eye(2), -jnp.ones(2)), Lemke()).redundant
    np.testing.assert_allclose(jax.grad(lambda load: weight(load).z.sum())(1.0), 1.0, rtol=1e-14)
    np.testing.assert_allclose(jax.jacfwd(lambda load: weight(load).w)(1.0), 0.0, atol=1e-15)


def test_implicit_differentiates_every_kind_of_problem():
    A, B, w = jnp.array([[3.0, 1.0], [0.0, 2.0]]), jnp.array([[0.5, 0.0], [0.25, 0.5]]), jnp.array([-2.0, 3.0])
    x = solve(AbsoluteValueEquation(A, B, w), Lemke()).free
    expected = -np.linalg.inv(np.asarray(A) - np.asarray(B) * np.sign(np.asarray(x)))
    np.testing.assert_allclose(
        jax.jacfwd(lambda w: implicit(AbsoluteValueEquation(A, B, w), x))(w), expected, rtol=1e-14
    )
    attached = lambda w: solve(AbsoluteValueEquation(A, B, w), Lemke()).free  # noqa: E731
    np.testing.assert_allclose(jax.jacrev(attached)(w), expected, rtol=1e-14)

    pair = (jnp.maximum(x, 0), jnp.maximum(-x, 0))
    found = jax.jacfwd(lambda w: implicit(HorizontalLCP(A + B, A - B, w), pair))(w)
    np.testing.assert_allclose(found[0] - found[1], expected, rtol=1e-14)

    blocks = {"A": jnp.eye(1) * 2, "C": jnp.ones((1, 1)), "D": jnp.ones((1, 1)), "B": jnp.eye(1) * 3}
    mixed = lambda b: MLCP(a=jnp.array([-1.0]), b=b[None], **blocks)  # noqa: E731
    answer = solve(mixed(jnp.asarray(-2.0)), Lemke())
    whole = np.linalg.inv([[2.0, 1.0], [1.0, 3.0]]) @ [0.0, -1.0]
    u, v = jax.jacfwd(lambda b: implicit(mixed(b), (answer.free, answer.z)))(jnp.asarray(-2.0))
    np.testing.assert_allclose([u[0], v[0]], whole, rtol=1e-14)


def test_forward_and_reverse_agree_through_vmap():
    q = jnp.asarray(Q + np.linspace(-0.1, 0.1, 5)[:, None])
    loss = lambda M: jnp.sum(jax.vmap(lambda q: z_of(M, q))(q) ** 2)  # noqa: E731
    np.testing.assert_allclose(jax.jacfwd(loss)(jnp.asarray(M)), jax.grad(loss)(jnp.asarray(M)), rtol=1e-13)
