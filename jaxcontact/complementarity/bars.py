"""How small is small enough: what the judge asks of residuals and condition numbers."""

import jax.numpy as jnp

BACKWARD_ERROR_BOUND = {"float64": 256, "float32": 16}
"""SOLVED requires eta <= BACKWARD_ERROR_BOUND eps: 5.7e-14 in float64, 1.9e-6 in float32."""

DIGITS_KEPT = 0.25
"""SOLVED requires rho <= eps^DIGITS_KEPT, a quarter of the digits, or equations whose condition is known to be
moderate: rho is about eps times that."""

DIGITS_OF_ABSENCE = 0.5
"""NO_SOLUTION asks that the best point misses by eta > eps^DIGITS_OF_ABSENCE, half of the digits: less may be the
rounding of an ill-conditioned mode."""

CONDITION_BOUND = 1 / 64
"""A condition number above CONDITION_BOUND / eps makes the active equations dependent up to rounding."""


def backward_error_bound(dtype):
    """The largest eta that SOLVED allows in a dtype."""
    return BACKWARD_ERROR_BOUND[jnp.dtype(dtype).name] * jnp.finfo(dtype).eps


def acceptable(eta, rho):
    """bool: residuals small enough for SOLVED, whatever the condition; NaN is not."""
    return small(eta) & telling(rho)


def small(eta):
    """bool: within BACKWARD_ERROR_BOUND."""
    return eta <= backward_error_bound(eta.dtype)


def close(eta):
    """bool: within DIGITS_OF_ABSENCE."""
    return eta <= jnp.finfo(eta.dtype).eps ** DIGITS_OF_ABSENCE


def telling(rho):
    """bool: rho is so small that eta says enough, whatever the condition."""
    return rho <= jnp.finfo(rho.dtype).eps ** DIGITS_KEPT


def moderate(condition):
    """bool: the equations are not dependent up to rounding."""
    return condition <= CONDITION_BOUND / jnp.finfo(condition.dtype).eps
