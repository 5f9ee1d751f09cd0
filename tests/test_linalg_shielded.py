"""Sine, cosine, root and quotient as primitives: values against 200 bits, derivatives against closed forms."""

from itertools import product

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxcontact.linalg.circular import ULPS
from jaxcontact.linalg.shielded import cosine_p, quotient_p, root_p, sine_p

SLOPES = {
    "sine": (sine_p, np.sin, [np.cos, lambda x: -np.sin(x), lambda x: -np.cos(x)]),
    "cosine": (cosine_p, np.cos, [lambda x: -np.sin(x), lambda x: -np.cos(x), np.sin]),
    "root": (root_p, np.sqrt, [lambda x: 0.5 * x**-0.5, lambda x: -0.25 * x**-1.5, lambda x: 0.375 * x**-2.5]),
}
"""By name: the primitive, its value and its first three derivatives."""

AT = np.array([0.3, 1.0, 1.9, 4.7])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ["sine", "cosine"])
def test_a_number_by_itself_and_a_batch_are_within_a_unit_in_the_last_place(name, dtype):
    primitive, exact = {"sine": (sine_p, mpmath.sin), "cosine": (cosine_p, mpmath.cos)}[name]
    x = np.random.default_rng(0).uniform(-50, 50, 200).astype(dtype)
    batch, single = jax.jit(jax.vmap(primitive.bind))(x), jax.jit(primitive.bind)
    with mpmath.workprec(200):
        for argument, together in zip(x, np.asarray(batch), strict=True):
            true = exact(mpmath.mpf(float(argument)))
            unit = float(np.spacing(np.abs(dtype(true))))
            for found in (together, single(argument)):
                assert found.dtype == dtype
                assert abs(float(found) - true) <= ULPS * unit, argument


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_roots_and_quotients_are_those_of_the_standard(dtype):
    """IEEE 754 rounds both correctly, so that they are NumPy's to the last bit."""
    x, y = np.random.default_rng(1).uniform(0.1, 9, (2, 300)).astype(dtype)
    assert np.array_equal(jax.jit(jax.vmap(root_p.bind))(x), np.sqrt(x))
    assert np.array_equal(jax.jit(jax.vmap(quotient_p.bind))(x, y), x / y)
    assert root_p.bind(x[0]) == np.sqrt(x[0])
    assert quotient_p.bind(x[0], y[0]) == x[0] / y[0]


@pytest.mark.parametrize("axes", [(0, 0), (0, None), (None, 0), (1, 0), (1, None), (None, 1)])
def test_a_quotient_is_batched_along_either_operand(axes):
    rng = np.random.default_rng(2)
    operands = [rng.uniform(1, 2, 3 if axis is None else (3, 3)) for axis in axes]
    x, y = (a if axis is None else np.moveaxis(a, axis, 0) for a, axis in zip(operands, axes, strict=True))
    assert np.array_equal(jax.vmap(quotient_p.bind, axes)(*operands), x / y)


def test_a_batch_of_batches_mixes_what_is_batched_where():
    x, y = AT, np.array([2.0, 3.0])
    table = jax.jit(jax.vmap(lambda b: jax.vmap(lambda a: quotient_p.bind(a, b))(x)))(y)
    assert np.array_equal(table, x[None, :] / y[:, None])


@pytest.mark.parametrize("name", SLOPES)
def test_derivatives_up_to_the_third(name):
    primitive, value, slopes = SLOPES[name]
    for order, slope in enumerate([value, *slopes]):
        for modes in product((jax.jacfwd, jax.grad), repeat=order):
            found = primitive.bind
            for mode in modes:
                found = mode(found)
            # A few roundings for each order: products of at most `order` quotients and roots.
            np.testing.assert_allclose(jax.vmap(found)(AT), slope(AT), rtol=(2 + 8 * order) * np.finfo(float).eps)
            np.testing.assert_allclose(found(AT[1]), slope(AT[1]), rtol=(2 + 8 * order) * np.finfo(float).eps)


def test_derivatives_of_a_quotient():
    x, y, eps = 1.7, -0.6, np.finfo(float).eps
    first = jax.grad(quotient_p.bind, argnums=(0, 1))(x, y)
    np.testing.assert_allclose(first, [1 / y, -x / y**2], rtol=8 * eps)
    second = jax.hessian(lambda p: quotient_p.bind(p[0], p[1]))(jnp.array([x, y]))
    np.testing.assert_allclose(second, [[0, -1 / y**2], [-1 / y**2, 2 * x / y**3]], rtol=16 * eps)
    along = jax.grad(lambda x: jnp.sum(jax.vmap(lambda y: quotient_p.bind(x, y))(AT)))(x)
    np.testing.assert_allclose(along, np.sum(1 / AT), rtol=8 * eps)


def test_a_single_number_costs_the_library_s_operation_and_a_batch_none():
    """What the compiled program holds: one sine by itself is XLA's, a batch of them polynomials."""
    single = jax.jit(sine_p.bind).lower(1.0).as_text()
    batch = jax.jit(jax.vmap(sine_p.bind)).lower(jnp.ones(8)).as_text()
    assert "stablehlo.sine" in single
    assert "stablehlo.sine" not in batch
