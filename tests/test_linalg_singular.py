"""Singular values against 40-digit arithmetic and stored true values; their derivatives against differences."""

import json
import pathlib
import re
import zlib

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxcontact import linalg

CASES = json.loads((pathlib.Path(__file__).parent / "data" / "sigma_cases.json").read_text())["cases"]
DTYPES = [np.float64, np.float32]
mpmath.mp.dps = 40


def true_values(X):
    """Singular values in 40 digits, descending, of the matrix exactly as stored."""
    S = mpmath.svd_r(mpmath.matrix(np.asarray(X, float).tolist()), compute_uv=False)
    return sorted(S, reverse=True)


def relative_error(value, truth):
    return float(abs(mpmath.mpf(float(value)) - truth) / truth)


def with_condition(rng, n, m, condition, dtype):
    """A random (n, m) matrix with singular values spread geometrically from 1 to 1 / condition, then rounded."""
    U = np.linalg.qr(rng.standard_normal((n, m)))[0]
    V = np.linalg.qr(rng.standard_normal((m, m)))[0]
    return ((U * np.logspace(0, -np.log10(condition), m)) @ V).astype(dtype)


def random_for(*key):
    return np.random.default_rng(zlib.crc32(repr(key).encode()))


def extremes(X):
    return linalg.singular_value_max(X), linalg.singular_value_min(X)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(1, 1), (4, 1), (2, 2), (3, 2), (6, 2), (3, 3)])
def test_to_three_columns_the_extremes_are_right_to_rounding_at_any_condition(shape, dtype):
    conditions = [1.0, 1e5, 1e10, 1e15] if dtype == np.float64 else [1.0, 1e3, 1e6]
    rng = random_for(shape, dtype.__name__)
    X = np.stack([with_condition(rng, *shape, c, dtype) for c in conditions for _ in range(5)])
    top, bottom = jax.jit(jax.vmap(extremes))(X)
    # Bar 8 of the project's numerics: 1e-14 and 2e-6, that is 45 and 17 roundings; measured below 2.
    bar = 1e-14 if dtype == np.float64 else 2e-6
    for X_k, top_k, bottom_k in zip(X, top, bottom):
        truth = true_values(X_k)
        assert relative_error(top_k, truth[0]) <= bar
        assert relative_error(bottom_k, truth[-1]) <= bar


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(6, 3), (12, 2), (4, 4), (7, 6)])
def test_beyond_the_smallest_values_are_right_to_the_condition(shape, dtype):
    conditions = [1.0, 1e5, 1e10] if dtype == np.float64 else [1.0, 1e3, 1e5]
    rng = random_for(shape, dtype.__name__)
    X = np.stack([with_condition(rng, *shape, c, dtype) for c in conditions for _ in range(5)])
    # Compiled once as a whole; in the other precision operation by operation, which is quicker.
    mapped = jax.vmap(extremes)
    top, bottom = (jax.jit(mapped) if dtype == np.float64 else mapped)(X)
    eps = np.finfo(dtype).eps
    for X_k, top_k, bottom_k in zip(X, top, bottom):
        truth = true_values(X_k)
        assert relative_error(top_k, truth[0]) <= 16 * eps
        # Bar 9: 16 eps cond.
        assert relative_error(bottom_k, truth[-1]) <= 16 * eps * float(truth[0] / truth[-1])


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_stored_true_values(case):
    A = np.array(case["A"], float)
    top, bottom = linalg.singular_value_max(A), linalg.singular_value_min(A)
    largest, smallest = case["sigma"][0], case["sigma"][-1]
    # Bar 8 to three columns; bar 9, 16 eps cond(A) sigma_min = 16 eps sigma_max, beyond.
    slack = 1e-14 * smallest if len(A) <= 3 else 16 * np.finfo(float).eps * largest
    assert abs(top - largest) <= 1e-14 * largest
    assert abs(bottom - smallest) <= slack


@pytest.mark.parametrize("case", [c for c in CASES if "sigma_factor" in c], ids=lambda case: case["name"])
def test_factors_keep_the_digits_that_the_delassus_matrix_loses(case):
    X = linalg.solve_lower(linalg.cholesky(jnp.array(case["mass"], float)), jnp.array(case["J"], float).T)
    truth = np.array(case["sigma_factor"])
    condition = truth[0] / truth[-1]
    # Bar 10: 32 eps cond(X); cond(X)^2 is the condition of the Delassus matrix, whose smallest value has no digit left.
    assert abs(linalg.singular_value_min(X) / truth[-1] - 1) <= 32 * np.finfo(float).eps * condition
    assert abs(linalg.singular_value_max(X) / truth[0] - 1) <= 1e-14


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(2, 2), (5, 3), (8, 6)])
def test_jacobi_keeps_the_small_values_of_graded_columns(shape, dtype):
    rng = random_for(shape, dtype.__name__)
    well = with_condition(rng, *shape, 3.0, float)
    X = (well * rng.permutation(np.logspace(0, -14, shape[1]))).astype(dtype)
    values = linalg.singular_values_jacobi(X)
    # Bar 11; the condition of the columns scaled to unit length, here below 10, is what counts.
    bar = 1e-14 if dtype == np.float64 else 1e-6 * 4
    assert max(relative_error(v, t) for v, t in zip(values, true_values(X))) <= bar


def test_sizes_without_entries_or_with_more_columns_than_rows():
    assert linalg.singular_value_min(jnp.zeros((3, 0))) == jnp.inf
    assert linalg.singular_value_max(jnp.zeros((3, 0))) == 0
    assert linalg.singular_value_max(jnp.zeros((0, 2))) == 0
    assert linalg.singular_value_min(jnp.zeros((0, 2))) == 0
    assert linalg.singular_values_jacobi(jnp.zeros((3, 0))).shape == (0,)
    wide = jnp.array([[3.0, 4.0]])
    assert linalg.singular_value_min(wide) == 0
    assert abs(linalg.singular_value_max(wide) - 5) < 1e-15
    u, sigma, v = linalg.singular_pair_min(wide)
    assert u == 0
    assert sigma == 0
    assert jnp.allclose(jnp.abs(v), jnp.array([0.8, 0.6]))
    assert jnp.all(jax.grad(linalg.singular_value_min)(wide) == 0)


def test_a_batch_is_refused_with_the_way_to_map_it():
    with pytest.raises(ValueError, match="vmap"):
        linalg.singular_value_min(jnp.ones((4, 3, 2)))
    with pytest.raises(ValueError, match="transpose"):
        linalg.singular_values_jacobi(jnp.ones((2, 3)))


SPECIAL = {
    "zero": lambda n, m: np.zeros((n, m)),
    "repeated": np.eye,
    "rank one": lambda n, m: np.outer(np.arange(1.0, n + 1), np.arange(2.0, m + 2)),
    "rank two": lambda n, m: np.diag([1.0, 1.0, *[0.0] * 9])[:n, :m],
    "large": lambda n, m: 2.0**100 * np.eye(n, m),
    "small": lambda n, m: 2.0**-100 * np.eye(n, m),
}


@pytest.mark.parametrize(
    ("shape", "dtype"),
    [
        *(((n, m), np.float64) for n, m in [(2, 1), (2, 2), (4, 2), (3, 3), (5, 3), (5, 4)]),
        *(((m, m), np.float32) for m in (3, 4)),
    ],
)
def test_singular_triples_are_valid_and_gradients_finite_where_values_repeat_or_vanish(shape, dtype):
    def everything(X):
        pairs = linalg.singular_pair_max(X), linalg.singular_pair_min(X)
        gradient = jax.grad(lambda X: sum(extremes(X)))
        second = jax.jvp(gradient, (X,), (jnp.ones_like(X),))[1] if shape[1] == 2 else X
        return pairs, extremes(X), gradient(X), second

    X = np.stack([build(*shape) for build in SPECIAL.values()]).astype(dtype)
    # Not compiled as a whole: the many outputs would take longer to compile than to compute.
    pairs, values, gradient, second = jax.vmap(everything)(X)
    truth = np.linalg.svd(X.astype(float), compute_uv=False)
    eps = np.finfo(dtype).eps
    size = truth[:, :1]
    for (u, sigma, v), value, exact in zip(pairs, values, (truth[:, 0], truth[:, -1])):
        u, sigma, v = (np.asarray(a, float) for a in (u, sigma, v))
        # Unit vectors, and residuals relative to the largest value: a few roundings in each of n m products.
        assert np.all(abs(np.sum(u * u, 1) - 1) <= 20 * eps)
        assert np.all(abs(np.sum(v * v, 1) - 1) <= 20 * eps)
        assert np.all(abs(np.einsum("bij,bj->bi", X.astype(float), v) - sigma[:, None] * u) <= 20 * eps * size)
        assert np.all(abs(np.einsum("bij,bi->bj", X.astype(float), u) - sigma[:, None] * v) <= 20 * eps * size)
        assert np.all(abs(np.asarray(value, float) - exact) <= 10 * eps * size[:, 0])
    assert np.all(np.isfinite(gradient))
    assert np.all(np.isfinite(second))


def test_nan_in_one_entry_is_nan_in_the_values_and_stays_in_its_lane():
    for shape in [(3, 2), (3, 3), (6, 5)]:
        X = np.stack([np.eye(*shape), np.eye(*shape)])
        X[1, -1, -1] = np.nan
        for values in jax.vmap(extremes)(X):
            assert values[0] == 1
            assert np.isnan(values[1])


@pytest.mark.parametrize("shape", [(2, 2), (5, 2), (3, 3), (5, 4), (6, 5)])
def test_first_and_second_derivatives_agree_with_differences_in_forty_digits(shape):
    rng = random_for(shape)
    X, D = rng.standard_normal(shape), rng.standard_normal(shape)
    step = mpmath.mpf(10) ** -10

    def along(value):
        def slope(X):
            return jax.jvp(value, (X,), (jnp.asarray(D),))[1]

        return jax.jvp(slope, (X,), (jnp.asarray(D),))

    def moved(k):
        return true_values_of(mpmath.matrix(X.tolist()) + k * step * mpmath.matrix(D.tolist()))

    after, here, before = moved(1), moved(0), moved(-1)
    for value, place in ((linalg.singular_value_max, 0), (linalg.singular_value_min, -1)):
        first, second = along(value)
        slope = (after[place] - before[place]) / (2 * step)
        bend = (after[place] - 2 * here[place] + before[place]) / step**2
        # 40 digits leave 20 in the second difference; the gaps that the formula divides by are above 1e-3 here.
        assert abs(first - float(slope)) <= 1e-11 * (1 + abs(float(slope)))
        assert abs(second - float(bend)) <= 1e-9 * (1 + abs(float(bend)))


@pytest.mark.parametrize(("dtype", "condition"), [(np.float64, 1e10), (np.float32, 1e4)])
def test_the_slopes_of_four_columns_are_right_to_the_condition(dtype, condition):
    """d sigma = u^T dX v with the vectors of 40 digits, at singular values that are far apart.

    A rounding of X turns u of the smallest value out of the span of the columns by roundings times the condition.
    """
    X = with_condition(random_for("slopes"), 6, 4, condition, dtype)
    U, _, Vt = mpmath.svd_r(mpmath.matrix(X.astype(float).tolist()))
    eps = np.finfo(dtype).eps
    for value, k, bar in (
        (linalg.singular_value_max, 0, 16 * eps),
        (linalg.singular_value_min, 3, 16 * eps * condition),
    ):
        expected = np.array([[float(U[i, k] * Vt[k, j]) for j in range(4)] for i in range(6)])
        np.testing.assert_allclose(jax.grad(value)(X), expected, rtol=0, atol=bar)


def true_values_of(A):
    return sorted(mpmath.svd_r(A, compute_uv=False), reverse=True)


def test_reverse_mode_is_the_transpose_of_forward_mode():
    X = random_for("reverse").standard_normal((5, 3))
    for value in (linalg.singular_value_max, linalg.singular_value_min):
        assert jnp.allclose(jax.grad(value)(X), jax.jacfwd(value)(X), rtol=0, atol=1e-15)


@pytest.mark.parametrize("shape", [(6, 2), (3, 3)])
def test_eager_jitted_and_batched_agree(shape):
    X = random_for("agree", shape).standard_normal((3, *shape))
    batched = jax.jit(jax.vmap(linalg.singular_value_min))(X)
    jitted = jnp.stack([jax.jit(linalg.singular_value_min)(X_k) for X_k in X])
    eager = jnp.stack([linalg.singular_value_min(X_k) for X_k in X])
    # Not bit for bit: a compiled program may contract products with sums.
    assert jnp.allclose(batched, eager, rtol=1e-13, atol=0)
    assert jnp.allclose(jitted, eager, rtol=1e-13, atol=0)


def test_the_slope_of_four_columns_needs_no_library_call():
    """LAPACK takes a microsecond for each lane: sixty times the value."""
    X = jax.ShapeDtypeStruct((1000, 5, 4), float)

    def slope(X, D):
        return jax.jvp(linalg.singular_value_min, (X,), (D,))[1]

    assert "custom-call" not in jax.jit(jax.vmap(slope)).lower(X, X).as_text()
    compiled = jax.jit(jax.vmap(linalg.fused(slope, final=True))).lower(X, X).compile().as_text()
    assert compiled.count(" fusion(") == 1


@pytest.mark.parametrize("shape", [(2, 2), (3, 2), (6, 2), (6, 1)])
def test_a_batch_of_small_extremes_compiles_to_one_loop(shape):
    for value in (linalg.singular_value_max, linalg.singular_value_min):
        compiled = jax.jit(jax.vmap(value)).lower(jax.ShapeDtypeStruct((1000, *shape), float)).compile().as_text()
        entry = compiled[compiled.index("ENTRY") :]
        assert len(re.findall(r" fusion\(", entry)) == 1
        assert "custom-call" not in compiled
        assert " while(" not in compiled
