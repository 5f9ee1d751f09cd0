"""Programs for a batch: against the same function called lane by lane and against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxcontact import linalg

EPS = np.finfo(float).eps
ROUNDINGS = 64 * EPS
"""Two programs of some twenty operations on numbers of about one, contracted differently by the compiler."""


def everything(A, x, shift, on):
    """Products, running sums, selections, expensive operations, entries that are constant, results of three dtypes."""
    y = jnp.sin(A @ x) / (1 + jnp.cumsum(x**2)) + shift
    z = jnp.where(on, jnp.sqrt(1 + y * y), jnp.stack([y[0], jnp.zeros_like(y[1]), jnp.ones_like(y[2])]))
    count = jnp.where(on, 3, jnp.int32(0))
    return {"y": y, "table": jnp.outer(y, z)[:, :2], "most": jnp.max(z), "whole": z > 1, "count": count}


def data(lanes):
    rng = np.random.default_rng(0)
    return rng.normal(size=(lanes, 3, 3)), rng.normal(size=(3, lanes)), rng.normal(), rng.random(lanes) < 0.5


AXES = (0, 1, None, 0)


def lanes_of(arguments, axes=AXES):
    for k in range(len(arguments[0])):
        yield [x if axis is None else np.take(x, k, axis) for x, axis in zip(arguments, axes, strict=True)]


@pytest.mark.parametrize("made", [linalg.fused_in_batches, linalg.packed], ids=["fused_in_batches", "packed"])
def test_a_batch_is_its_lanes(made):
    def function(*arguments):
        found = everything(*arguments)
        return {name: found[name] for name in ("y", "table", "most", "whole")}

    arguments = data(7)
    found = jax.jit(jax.vmap(made(function), AXES))(*arguments)
    for k, lane in enumerate(lanes_of(arguments)):
        alone, expected = made(function)(*lane), function(*map(jnp.asarray, lane))
        for name, value in expected.items():
            np.testing.assert_allclose(found[name][k], value, rtol=ROUNDINGS, atol=ROUNDINGS)
            np.testing.assert_allclose(alone[name], value, rtol=ROUNDINGS, atol=ROUNDINGS)


@pytest.mark.parametrize("lanes", [0, 1])
def test_batches_of_none_and_of_one(lanes):
    arguments = data(lanes)
    found = jax.vmap(linalg.fused_in_batches(everything), AXES)(*arguments)
    shapes = jax.eval_shape(jax.vmap(everything, AXES), *arguments)
    assert jax.tree.map(lambda x: (x.shape, x.dtype), found) == jax.tree.map(lambda x: (x.shape, x.dtype), shapes)


def test_a_batch_of_batches():
    x = np.random.default_rng(1).normal(size=(4, 5, 3))
    twice = jax.vmap(jax.vmap(linalg.fused_in_batches(lambda x: jnp.outer(x, jnp.cos(x)))))
    np.testing.assert_allclose(twice(x), x[..., :, None] * np.cos(x)[..., None, :], rtol=ROUNDINGS)


def test_what_is_the_same_for_all_lanes_is_given_to_all():
    function = linalg.fused_in_batches(lambda x, y: (jnp.zeros(2), 2 * y, x[:0]))
    found = jax.vmap(function, (0, None))(jnp.ones((3, 2)), 1.5)
    assert [a.tolist() for a in found] == [[[0, 0]] * 3, [3.0] * 3, [[]] * 3]


def test_one_lane_never_changes_another():
    A, x, shift, on = data(6)
    clean = jax.vmap(linalg.fused_in_batches(everything), AXES)(A, x, shift, on)
    A[2] = np.nan
    spoilt = jax.vmap(linalg.fused_in_batches(everything), AXES)(A, x, shift, on)
    others = np.arange(6) != 2
    assert all(np.array_equal(a[others], b[others]) for a, b in zip(*map(jax.tree.leaves, (clean, spoilt))))
    assert np.isnan(spoilt["y"][2]).all()


def curvature(x):
    """The second derivatives of s / d, s = sum sin(x_i)^2, d = 1 + |x|^2."""
    s, ds, d, dd = np.sum(np.sin(x) ** 2), np.sin(2 * x), 1 + x @ x, 2 * x
    mixed = (np.outer(ds, dd) + np.outer(dd, ds) + 2 * s * np.eye(len(x))) / d**2
    return np.diag(2 * np.cos(2 * x)) / d - mixed + 2 * s * np.outer(dd, dd) / d**3


def test_derivatives_before_and_after_the_batch():
    """f(x) = sum sin(x_i)^2 / (1 + |x|^2), differentiated by hand."""
    f = linalg.fused_in_batches(lambda x, on: jnp.where(on, jnp.sum(jnp.sin(x) ** 2) / (1 + x @ x), jnp.nan))
    x, on = np.random.default_rng(2).normal(size=(5, 3)), np.ones(5, bool)
    size = 1 + np.sum(x * x, axis=1, keepdims=True)
    slope = np.sin(2 * x) / size - 2 * x * np.sum(np.sin(x) ** 2, axis=1, keepdims=True) / size**2
    whole = jax.grad(lambda x: jnp.sum(jax.vmap(f)(x, on)))(x)
    for found in (jax.vmap(jax.grad(f))(x, on), jax.vmap(jax.jacfwd(f))(x, on), whole):
        np.testing.assert_allclose(found, slope, rtol=ROUNDINGS, atol=ROUNDINGS)
    curved = [curvature(a) for a in x]
    np.testing.assert_allclose(jax.vmap(jax.hessian(f))(x, on), curved, rtol=ROUNDINGS, atol=ROUNDINGS)


def test_a_program_that_cannot_be_taken_apart_is_batched_as_it_is():
    def halved(x):
        return lax.while_loop(lambda y: jnp.max(y) > 1, lambda y: y / 2, x)

    x = jnp.array([[3.0, 1.0], [0.5, 0.25], [8.0, 6.0]])
    expected = [[0.75, 0.25], [0.5, 0.25], [1.0, 0.75]]
    assert jax.vmap(linalg.fused_in_batches(halved))(x).tolist() == expected
    assert jax.vmap(linalg.packed(halved))(x).tolist() == expected


def test_a_batch_is_traced_once():
    calls = []

    def function(x):
        calls.append(x)
        return jnp.outer(x, x)

    jax.jit(jax.vmap(linalg.fused_in_batches(function))).lower(jnp.ones((4, 3)))
    assert len(calls) == 1
