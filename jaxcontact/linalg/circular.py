"""Sine and cosine as polynomials, so that a loop over a batch holds no library call.

XLA's own are computed one lane at a time in float64. The argument is reduced by the nearest multiple k of pi / 2, which
is subtracted in three or four parts (Cody & Waite, Software Manual for the Elementary Functions, 1980, ch. 8); the
products of all but the last with k are exact, up to MULTIPLE, and what each difference rounds away is kept. The minimax
polynomials on |r| <= pi / 4 are those of fdlibm (Sun Microsystems, 1993: k_sin.c, k_cos.c) and, in float32, of Cephes
(Moshier, sinf.c). Below MULTIPLE quarter turns the error is at most ULPS units in the last place; beyond, the argument
is moved by about a rounding of itself.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxcontact.linalg.tracing import where

ULPS = 1.0
"""Units in the last place by which the results may be off; measured: 0.8."""

MULTIPLE = {4: 2**12, 8: 2**20}
"""By bytes of the dtype: quarter turns up to which this holds: 6,400 and 1,600,000 radians."""

QUARTER_TURN = {
    4: (1.5703125, 4.837512969970703125e-4, 7.549533620476723e-8, 2.563344151594519e-12),
    8: (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
}
"""pi / 2 in parts, all but the last short."""

SINE = {
    4: (-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4),
    8: (
        *(-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04),
        *(2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10),
    ),
}
"""(sin r / r - 1) / r^2 in powers of r^2."""

COSINE = {
    4: (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
    8: (
        *(4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05),
        *(-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11),
    ),
}
"""(cos r - 1 + r^2 / 2) / r^4 in powers of r^2."""

BEYOND = 0.8
"""A reduced argument of a huge one is noise; it is kept in the range of the polynomials."""


def has_polynomials(dtype) -> bool:
    """Whether there are polynomials for this dtype."""
    return jnp.issubdtype(dtype, jnp.floating) and jnp.dtype(dtype).itemsize in SINE


def sine(x: Array) -> Array:
    """sin x for x float32 or float64 of any shape; NaN for infinite x. `sine(jnp.pi / 6)` is 0.5."""
    return _turned(x, 0)


def cosine(x: Array) -> Array:
    """cos x, as `sine`."""
    return _turned(x, 1)


@partial(jax.jit, static_argnames="quarters")
def _turned(x: Array, quarters: int) -> Array:
    """sin(x + quarters pi / 2). The parts that sine and cosine share are the same instructions, which XLA merges."""
    k, odd, even = _of_the_rest(x)
    k = k + quarters
    half_turns = lax.floor(0.5 * k)
    value = where(k - 2 * half_turns == 0, odd, even)
    return where(half_turns - 2 * lax.floor(0.5 * half_turns) == 0, value, -value)


@jax.jit  # traced once for both
def _of_the_rest(x: Array) -> tuple[Array, Array, Array]:
    """(k, sin r, cos r) with x = k pi / 2 + r, |r| <= pi / 4."""
    size = jnp.dtype(x.dtype).itemsize
    k = lax.round(x * (2 / jnp.pi), lax.RoundingMethod.TO_NEAREST_EVEN)
    r, rest = _reduced(x, k, QUARTER_TURN[size])
    square = r * r
    odd = r + (rest + r * (square * _polynomial(SINE[size], square)))
    half = 0.5 * square
    one_less = 1 - half
    even = one_less + (((1 - one_less) - half) + (square * square * _polynomial(COSINE[size], square) - r * rest))
    return k, odd, even


def _reduced(x: Array, k: Array, parts: tuple[float, ...]) -> tuple[Array, Array]:
    """x - k pi / 2 as a number and a rest below its rounding: each difference with its error (Knuth's two-sum)."""
    r, rest = x - k * parts[0], jnp.zeros_like(x)
    for part in parts[1:]:
        taken = -k * part
        total = r + taken
        seen = total - r
        rest = rest + ((r - (total - seen)) + (taken - seen))
        r = total
    bound = jnp.array(BEYOND, x.dtype)
    r, rest = lax.clamp(-bound, r, bound), lax.clamp(-bound, rest, bound)
    total = r + rest
    return total, (r - total) + rest


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    value = lax.full_like(x, coefficients[-1])
    for c in np.array(coefficients[-2::-1], x.dtype):
        value = lax.add(lax.mul(value, x), c)
    return value
