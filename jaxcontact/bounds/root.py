"""The one sign change of a function on a bracket."""

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array, lax

STEPS_PER_BIT = 2
"""Steps allowed for each bit of the dtype; bisection alone takes one for each bit of the bracket."""


def sign_change(
    function: Callable[[Array], tuple[Array, Array]], low: Array, high: Array, floor: Array
) -> tuple[Array, Array]:
    """(x, note): the function is negative below x and positive above; it returns its value and an integer to note.

    Chandrupatla, "A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without
    using derivatives", Adv. Eng. Software 28 (1997) 145-149: inverse quadratic interpolation where the three last
    points allow it, else bisection. Ends when the bracket is two roundings of x, or `floor`, wide. The note is that of
    the last point where the function was not positive, or of the last point. The ends are not evaluated: their signs
    are known. No derivative.

    `sign_change(lambda x: (x * x - 2, jnp.int32(x)), jnp.float32(0), jnp.float32(2), jnp.float32(0))`
    """
    info = jnp.finfo(low.dtype)
    one, none = jnp.ones_like(low), jnp.zeros((), jnp.int32)
    start = (none, high, one, low, -one, low, -one, 0.5 * one, none, one < 0)

    def unfinished(state):
        step, a, fa, b, fb = state[:5]
        best = jnp.where(abs(fa) < abs(fb), a, b)
        return (step < STEPS_PER_BIT * info.bits) & (abs(b - a) > 2 * info.eps * abs(best) + floor) & (fa != 0)

    def narrowed(state):
        step, a, fa, b, fb, _, _, t, note, sure = state
        x = a + t * (b - a)
        fx, here = function(x)
        same = (fx > 0) == (fa > 0)
        c, fc = jnp.where(same, a, b), jnp.where(same, fa, fb)
        b, fb = jnp.where(same, b, a), jnp.where(same, fb, fa)
        a, fa = x, fx
        least = (2 * info.eps * abs(x) + floor) / jnp.maximum(abs(b - a), float(info.tiny))
        t = jnp.clip(
            _interpolated(a, fa, b, fb, c, fc), jnp.minimum(0.5 * least, 0.5), jnp.maximum(1 - 0.5 * least, 0.5)
        )
        below = ~(fx > 0)
        note = jnp.where(below | ~sure, here.astype(jnp.int32), note)
        return step + 1, a, fa, b, fb, c, fc, t, note, sure | below

    _, a, fa, b, fb, _, _, _, note, _ = lax.while_loop(unfinished, narrowed, start)
    return jnp.where(abs(fa) < abs(fb), a, b), note


def _interpolated(a, fa, b, fb, c, fc):
    """The fraction of the way from a to b: inverse quadratic interpolation where it is monotone, else a half."""
    xi, phi = _quotient(a - b, c - b), _quotient(fa - fb, fc - fb)
    monotone = (phi * phi < xi) & ((1 - phi) * (1 - phi) < 1 - xi)
    quadratic = _quotient(fa, fb - fa) * _quotient(fc, fb - fc)
    quadratic = quadratic + _quotient(c - a, b - a) * _quotient(fa, fc - fa) * _quotient(fb, fc - fb)
    return jnp.where(monotone & (quadratic == quadratic), quadratic, 0.5)


def _quotient(x, y):
    return x / jnp.where(y == 0, 1, y)
