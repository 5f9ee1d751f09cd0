"""Sine and cosine by polynomials, against arithmetic with 200 bits."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxcontact.linalg.circular import MULTIPLE, ULPS, cosine, sine

FUNCTIONS = {"sine": (sine, mpmath.sin), "cosine": (cosine, mpmath.cos)}


def arguments(dtype):
    """All quadrants, both sides of each multiple of a quarter turn, near zero, up to the last that is promised."""
    rng = np.random.default_rng(0)
    most = MULTIPLE[np.dtype(dtype).itemsize] * np.pi / 2
    near = np.arange(-300, 300) * (np.pi / 2)
    far = [rng.uniform(-8, 8, 1000), rng.uniform(-most, most, 1000), 10.0 ** rng.uniform(-30, 0, 500)]
    return np.concatenate([near, near + 1e-9, np.pi / 2 - 10.0 ** -np.arange(1, 16.0), *far]).astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_result_is_within_a_unit_in_the_last_place(name, dtype):
    ours, exact = FUNCTIONS[name]
    x = arguments(dtype)
    found = np.asarray(jax.jit(jax.vmap(ours))(x))
    assert found.dtype == dtype
    with mpmath.workprec(200):
        for argument, value in zip(x, found):
            true = exact(mpmath.mpf(float(argument)))
            unit = np.spacing(np.abs(dtype(true)))
            assert abs(float(value) - true) <= ULPS * float(unit), argument


@pytest.mark.parametrize("name", FUNCTIONS)
def test_huge_arguments_stay_in_range_and_infinite_ones_are_undefined(name):
    ours, _ = FUNCTIONS[name]
    for dtype in (np.float32, np.float64):
        largest = np.finfo(dtype).max
        # A reduced argument of up to BEYOND, out of the range that the polynomials are made for: some roundings more.
        assert np.all(np.abs(ours(jnp.array([1e20, -1e30, largest], dtype))) <= 1 + 1e-5)
        assert np.all(np.isnan(ours(jnp.array([np.inf, -np.inf, np.nan], dtype))))
    x = jnp.linspace(1e6, 1e12, 1000)
    moved = np.abs(ours(x) - {"sine": np.sin, "cosine": np.cos}[name](x))
    assert np.all(moved <= 2 * np.finfo(float).eps * x)  # a rounding of the argument and one of the result
