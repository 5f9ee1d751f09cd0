"""Compensated arithmetic against exact rationals; factors, solves and eigenvalues against what defines them."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxcontact import linalg

DTYPES = [np.float64, np.float32]
mpmath.mp.dps = 40


def exact(x):
    return Fraction(float(x))


def random_for(seed):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("compile_it", [False, True])
def test_sums_and_products_with_their_errors_are_exact(dtype, compile_it):
    a, b = random_for(0).standard_normal((2, 200)).astype(dtype)
    for operation, truth in (
        (linalg.two_sum, lambda x, y: exact(x) + exact(y)),
        (linalg.two_product, lambda x, y: exact(x) * exact(y)),
    ):
        high, low = (jax.jit(operation) if compile_it else operation)(jnp.asarray(a), jnp.asarray(b))
        assert all(exact(h) + exact(l) == truth(x, y) for h, l, x, y in zip(high, low, a, b))


@pytest.mark.parametrize("dtype", DTYPES)
def test_small_determinants_keep_their_digits_when_they_cancel(dtype):
    rng = random_for(1)
    eps = np.finfo(dtype).eps
    det = jax.jit(linalg.det)
    for _ in range(20):
        a, b, c = rng.standard_normal(3)
        A = np.array([[a, b], [c, b * c / a]], dtype)
        truth = exact(A[0, 0]) * exact(A[1, 1]) - exact(A[0, 1]) * exact(A[1, 0])
        assert abs(exact(det(A)) - truth) <= abs(truth) * Fraction(4 * float(eps))
    # The third row is the sum of the others but for rounding, so the determinant is of rounding size itself.
    A = rng.standard_normal((3, 3)).astype(dtype)
    A[2] = A[0] + A[1]
    truth = mpmath.det(mpmath.matrix(A.astype(float).tolist()))
    assert abs(mpmath.mpf(float(det(A))) - truth) <= 4 * eps * abs(truth)


def test_a_determinant_has_its_cofactors_as_gradient():
    A = random_for(2).standard_normal((3, 3))
    assert np.allclose(jax.grad(linalg.det)(A), np.linalg.det(A) * np.linalg.inv(A).T, rtol=1e-12, atol=0)
    assert linalg.det(jnp.zeros((0, 0))) == 1


@pytest.mark.parametrize("n", [1, 3, 6, 11])
def test_cholesky_and_the_triangular_solves_undo_the_product(n):
    rng = random_for(n)
    L = np.tril(rng.standard_normal((n, n)), -1) + np.diag(rng.uniform(1, 2, n))
    B = rng.standard_normal((n, 2))
    M = L @ L.T
    M[np.triu_indices(n, 1)] = np.nan  # only the lower triangle is read
    slack = 1e-12  # condition of L below 1e3, times a few roundings
    assert np.allclose(linalg.cholesky(M), L, rtol=0, atol=slack)
    assert np.allclose(linalg.solve_lower(L, L @ B), B, rtol=0, atol=slack)
    assert np.allclose(linalg.solve_lower_transposed(L, L.T @ B[:, 0]), B[:, 0], rtol=0, atol=slack)


def test_cholesky_of_an_indefinite_or_singular_matrix_is_nan():
    assert jnp.any(jnp.isnan(linalg.cholesky(jnp.array([[1.0, 2.0], [2.0, 1.0]]))))
    assert jnp.any(jnp.isnan(linalg.cholesky(jnp.array([[1.0, 1.0], [1.0, 1.0]]))))


@pytest.mark.parametrize("m", [1, 2, 4, 6])
def test_solve_needs_its_pivots(m):
    rng = random_for(m)
    A = np.roll(np.eye(m), 1, axis=0) + 1e-3 * rng.standard_normal((m, m))
    A[0, 0] = 0 if m > 1 else 2.0
    x = rng.standard_normal(m)
    assert np.allclose(jax.jit(linalg.solve)(A, A @ x), x, rtol=0, atol=1e-14 * m)
    slope = jax.jacfwd(lambda b: linalg.solve(A, b))(A @ x)
    assert np.allclose(slope, np.linalg.inv(A), rtol=0, atol=1e-13)


def test_empty_sizes_give_empty_answers():
    assert linalg.cholesky(jnp.zeros((0, 0))).shape == (0, 0)
    assert linalg.solve_lower(jnp.eye(3), jnp.zeros((3, 0))).shape == (3, 0)
    assert linalg.gram(jnp.zeros((3, 0)), jnp.ones((3, 2))).shape == (0, 2)
    assert linalg.project_out(jnp.zeros((3, 0)), jnp.ones((3, 2))).shape == (3, 2)
    assert linalg.project_out(jnp.ones((3, 1)), jnp.zeros((3, 0))).shape == (3, 0)
    assert linalg.solve(jnp.zeros((0, 0)), jnp.zeros(0)).shape == (0,)


def test_project_out_keeps_what_a_formed_schur_complement_loses():
    # x leaves the line of q by an angle of 1e-12: the squared sine, 1e-24, is below the rounding of W = N^T N.
    q, normal = np.array([1.0, 2.0, 2.0]) / 3, np.array([2.0, 1.0, -2.0]) / 3
    x = (7 * q + 7e-12 * normal)[:, None]
    left = jax.jit(linalg.project_out)(q[:, None], x)[:, 0]
    q_exact, x_exact = (mpmath.matrix(v.tolist()) for v in (q, x[:, 0]))
    truth = x_exact - q_exact * ((q_exact.T * x_exact)[0] / (q_exact.T * q_exact)[0])
    assert max(abs(mpmath.mpf(float(l)) - t) for l, t in zip(left, truth)) <= 4 * np.finfo(float).eps * mpmath.norm(
        truth
    )


@pytest.mark.parametrize("n", [5, 12])
def test_project_out_leaves_vectors_normal_to_the_span(n):
    rng = random_for(n)
    Q, X = rng.standard_normal((n, 2)), rng.standard_normal((n, 3))
    left = linalg.project_out(Q, X)
    assert np.allclose(Q.T @ left, 0, atol=1e-14)
    assert np.allclose(left, X - Q @ np.linalg.lstsq(Q, X, rcond=None)[0], rtol=0, atol=1e-13)


def test_project_out_ignores_columns_that_repeat_the_span():
    rng = random_for(5)
    Q, X = rng.standard_normal((4, 1)), rng.standard_normal((4, 2))
    twice = np.concatenate([Q, 3 * Q], axis=1)
    assert np.allclose(linalg.project_out(twice, X), linalg.project_out(Q, X), rtol=0, atol=1e-14)
    assert np.all(np.isfinite(jax.jacfwd(linalg.project_out)(twice, X)))


@pytest.mark.parametrize("dtype", DTYPES)
def test_symmetric_eigenvalues_are_right_also_when_they_crowd_together(dtype):
    rng = random_for(6)
    eps = np.finfo(dtype).eps
    extremes = jax.jit(lambda S: (linalg.symmetric_eigenvalue_max(S), linalg.symmetric_eigenvalue_min(S)))
    for values in (
        [1.0, 1.0, -2.0],
        [3.0, 1.0, 1.0],
        [2.0, 2.0, 2.0],
        [0.0, 0.0, 0.0],
        [1.0, 1.0 + 1e-9, 5.0],
        [1e3, 1.0, -1e3],
    ):
        Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        S = ((Q * np.array(values)) @ Q.T).astype(dtype)
        S = np.tril(S) + np.tril(S, -1).T
        truth = mpmath.eigsy(mpmath.matrix(S.astype(float).tolist()), eigvals_only=True)
        top, bottom = extremes(S)
        for value, exact_value in ((top, max(truth)), (bottom, min(truth))):
            assert abs(float(value) - float(exact_value)) <= 8 * eps * max(map(abs, values))


@pytest.mark.parametrize("m", [2, 3, 5])
def test_symmetric_eigenvalues_differentiate_twice_and_stay_finite_at_repeats(m):
    A = random_for(m).standard_normal((m, m))
    S, D = A + A.T, random_for(m + 1).standard_normal((m, m))
    values, X = np.linalg.eigh(S)
    D = D + D.T
    P = X.T @ D @ X
    bend = 2 * np.sum(P[-1, :-1] ** 2 / (values[-1] - values[:-1]))  # second-order perturbation theory

    def slope(S):
        return jax.jvp(linalg.symmetric_eigenvalue_max, (S,), (jnp.asarray(D),))[1]

    assert abs(slope(S) - P[-1, -1]) <= 1e-12
    assert abs(jax.jvp(slope, (S,), (jnp.asarray(D),))[1] - bend) <= 1e-10 * (1 + abs(bend))
    assert jnp.all(jnp.isfinite(jax.jacfwd(jax.grad(linalg.symmetric_eigenvalue_max))(jnp.eye(m))))


def test_the_largest_positive_real_eigenvalue():
    largest = linalg.real_eigenvalue_max
    assert largest(jnp.zeros((0, 0))) == 0
    assert largest(jnp.array([[-1.0]])) == 0
    assert largest(jnp.array([[0.0, -1.0], [1.0, 0.0]])) == 0  # a rotation
    assert largest(jnp.array([[2.0, 1.0], [0.0, 2.0]])) == 2  # defective
    assert (
        abs(largest(jnp.array([[-1e8, 1.0], [1.0, 0.0]])) - 1e-8) <= 1e-23
    )  # -det / trace to first order, no cancellation
    spin = np.array([[3.0, -4.0, 0.0], [4.0, 3.0, 0.0], [0.0, 0.0, 0.5]])
    assert abs(largest(jnp.asarray(spin)) - 0.5) <= 3 * 5 * np.finfo(float).eps  # n |X| eps of a backward stable method
    assert jnp.isnan(largest(jnp.full((3, 3), jnp.nan)))


@pytest.mark.parametrize("m", [2, 3])
def test_a_simple_real_eigenvalue_differentiates_although_others_coincide(m):
    # X = S diag(3, 1, 1) S^-1: d lambda = y^T dX x with y^T x = 1; the derivative of eigvals would be NaN for m = 3.
    S = random_for(7).standard_normal((m, m)) + 2 * np.eye(m)
    X = S @ np.diag([3.0, 1.0, 1.0][:m]) @ np.linalg.inv(S)
    x, y = S[:, 0], np.linalg.inv(S)[0]
    assert np.allclose(jax.grad(linalg.real_eigenvalue_max)(X), np.outer(y, x), rtol=0, atol=1e-12)
    assert jnp.all(jnp.isfinite(jax.grad(linalg.real_eigenvalue_max)(2.0 * jnp.eye(m))))
