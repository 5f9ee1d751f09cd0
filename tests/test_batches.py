"""What holds of a batch as of each of its problems: NaN is never lost, chunks and skipped work change nothing."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import operators_of, random_factors

import jaxcontact as jc
from jaxcontact import linalg, native

MANY = 5000
"""XLA's own maximum drops NaN on a CPU once a loop is vectorised, from about a thousand lanes (openxla/xla 21461)."""


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("place", [0, 2, 5])
def test_no_extremum_loses_nan(dtype, place):
    x = np.zeros((MANY, 6), dtype)
    x[:, place] = np.nan
    for found in (linalg.greatest, linalg.least):
        assert np.isnan(jax.jit(jax.vmap(found))(jnp.asarray(x))).all()
        assert np.isnan(jax.jit(lambda x, found=found: found(x, 0))(jnp.asarray(x))[place])


def test_extrema_of_numbers_are_those_of_numpy():
    x = np.random.default_rng(0).normal(size=(7, 5))
    assert np.array_equal(linalg.greatest(jnp.asarray(x), 1), x.max(1))
    assert np.array_equal(linalg.least(jnp.asarray(x), 0), x.min(0))
    assert linalg.greatest(jnp.zeros((0,)), initial=0) == 0
    assert linalg.greatest(jnp.arange(3)) == 2
    with pytest.raises(ValueError, match="give `initial`"):
        linalg.least(jnp.zeros((0,)))


def test_in_a_large_batch_bad_lanes_are_bad_and_the_others_untouched():
    rng = np.random.default_rng(1)
    m = 6
    A = rng.normal(size=(MANY, m, m))
    M, q = A @ A.transpose(0, 2, 1) + np.eye(m), rng.normal(size=(MANY, m))
    poisoned = M.copy()
    poisoned[::7, 3, 2] = np.nan
    solve = jax.jit(jax.vmap(lambda M, q: jc.solve(jc.LCP(M, q), jc.Lemke())))
    clean, dirty = solve(M, q), solve(poisoned, q)
    bad = np.arange(MANY) % 7 == 0
    assert (np.asarray(dirty.status)[bad] == jc.Status.BAD_INPUT).all()
    assert np.isnan(np.asarray(dirty.z)[bad]).all()
    assert (np.asarray(clean.status) == jc.Status.SOLVED).all()
    assert np.array_equal(np.asarray(dirty.z)[~bad], np.asarray(clean.z)[~bad])


def test_in_a_large_batch_a_threshold_of_nan_is_nan():
    N, T = random_factors("bbb", MANY, seed=2)
    N[::7, 0, 1] = np.nan
    critical = np.asarray(jax.jit(jax.vmap(lambda n, t: jc.bounds.critical(operators_of(n, t, "bbb"))))(N, T))
    assert np.array_equal(np.isnan(critical), np.arange(MANY) % 7 == 0)


def halvings(x):
    """How often a number can be halved before it is below one: a loop that ends at another time in every lane."""
    return jax.lax.while_loop(lambda c: c[0] >= 1, lambda c: (c[0] / 2, c[1] + 1), (x, 0))[1]


@pytest.mark.parametrize("size", [0, 1, 4, 5, 11])
def test_chunks_are_the_batch(size):
    x = jnp.asarray(2.0 ** np.arange(size) * 1.5)
    chunked = linalg.in_chunks(halvings, 4)
    assert np.array_equal(jax.vmap(chunked)(x), np.arange(size) + 1)
    assert np.array_equal(jax.jit(jax.vmap(jax.vmap(chunked, 0), 0))(x.reshape(1, -1)), np.arange(size)[None] + 1)


def test_a_batch_of_batches_without_kernels_keeps_every_field():
    """Those of no entries too, in a batch of none as well."""
    q = -np.ones((2, 4, 3))
    one = lambda q: jc.solve(jc.LCP(np.eye(3), q), jc.Lemke())  # noqa: E731
    with native.unused():
        nested, none = jax.vmap(jax.vmap(one))(q), jax.vmap(jax.vmap(one))(q[:0])
    assert np.array_equal(nested.z, -q)
    assert nested.free.shape == (2, 4, 0)
    assert (none.z.shape, none.free.shape) == ((0, 4, 3), (0, 4, 0))


@pytest.mark.parametrize("pick", [linalg.where_needed, partial(linalg.for_the_few, lanes=2)])
def test_skipped_work_is_as_if_done(pick):
    def square(x):
        return {"value": x * x}

    def chosen(x, limit):
        return pick(x > limit, square, {"value": -x}, x)["value"]

    x = jnp.arange(6.0)
    for limit in (-1.0, 2.5, 9.0):
        expected = np.where(np.arange(6) > limit, np.arange(6.0) ** 2, -np.arange(6.0))
        over = jax.vmap(chosen, (0, None))
        assert np.array_equal([chosen(x[i], limit) for i in range(6)], expected)
        assert np.array_equal(over(x, limit), expected)
        assert np.array_equal(jax.jit(over)(x, limit), expected)
        assert np.array_equal(jax.vmap(over, (0, None))(x.reshape(2, 3), limit), expected.reshape(2, 3))
    limits = jnp.array([-1.0, 2.5, 9.0])
    rows = jax.vmap(over, (None, 0))(x, limits)
    assert np.array_equal(rows, [over(x, limit) for limit in limits])


def test_on_an_accelerator_there_are_no_walls_and_the_few_are_many_at_a_time(monkeypatch):
    """A branch there would wait for the host; what is computed is the same."""
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    x = jnp.linspace(0, 1, 77)
    program = jax.jit(jax.vmap(linalg.walled(lambda x: jnp.sin(x) + 1))).lower(x)
    assert "stablehlo.case" not in program.as_text()
    np.testing.assert_allclose(program.compile()(x), np.sin(x) + 1, rtol=1e-15)
    again = jax.vmap(lambda x: linalg.for_the_few(x > 0.5, lambda x: 2 * x, -x, x, lanes=3))
    assert np.array_equal(again(x), np.where(x > 0.5, 2 * x, -x))
    assert "slice_sizes=(77,)" in str(jax.make_jaxpr(again)(x))  # not three at a time
    assert linalg.compiler_options() == {}


def test_solutions_are_the_same_as_on_an_accelerator(monkeypatch):
    N, T = random_factors("uuu", 91, seed=5)
    W, q = jnp.einsum("bki,bkj->bij", N, N), jnp.asarray(T[:, 0])
    methods = jc.Direct(), jc.Lemke(), jc.PrincipalPivoting()
    with native.unused():
        here = [jax.vmap(lambda M, q, method=method: jc.solve(jc.LCP(M, q), method))(W, q) for method in methods]
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    jax.clear_caches()  # what was traced for a CPU has its walls
    for method, expected in zip(methods, here, strict=True):
        found = jax.vmap(lambda M, q, method=method: jc.solve(jc.LCP(M, q), method))(W, q)
        assert np.array_equal(found.status, expected.status)
        # the same steps, each of which XLA may contract otherwise: eps times the condition of each problem
        error = np.abs(found.z - expected.z).max(1)
        assert (error <= 256 * np.finfo(float).eps * expected.condition * np.abs(expected.z).max(1)).all()
    jax.clear_caches()
