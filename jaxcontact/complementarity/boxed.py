"""Unknowns between two bounds: the normal form of a boxed problem, and how far a point is from solving it.

With M x + q = a - b, where 0 <= a ⟂ x - lower >= 0 and 0 <= b ⟂ upper - x >= 0, unknown i has two pairs,

    z = (x - lower, b),   w = (a, upper - x),   so that   M x + q = w[:m] - z[m:].

Three equations of unknown i determine x_i and one of each pair:

    bounds         first                        second                   third
    finite         x - lower = z_1              M x + q + z_2 = w_1      upper - x = w_2
    lower = -inf   M x + q + z_2 = 0            z_1 = idle               (as above)
    upper = inf    (without z_2)                (without z_2)            w_2 = idle
    equal          x = (lower + upper) / 2      M x + q + t z_1 = w_1    M x + q + z_2 = t w_2

The first ones give x and the others w_1, w_2, so no number is divided to reach the LCP of [[M, I], [-I, 0]], and x_i
without a lower bound is eliminated by its own row of M. Between equal bounds the pairs are (b / t, a) and (b, a / t),
t a power of two near M_ii. An infinite bound reaches no arithmetic: `idle`, which has the size of M x + q at the point
of the box nearest to zero, takes its place.

Powers of two bring every row to the balanced unit of M x + q. A bound far beyond that size has its row lowered further,
so that an upper bound of 1e20 does not make everything else look like rounding.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact import linalg
from jaxcontact.complementarity.forms import NormalForm, normal_form
from jaxcontact.complementarity.problems import BoxedLCP
from jaxcontact.complementarity.scaling import exponent, power_of_two, row_exponents
from jaxcontact.complementarity.short import dot, largest, largest_of_rows


class Box(NamedTuple):
    """Bounds made safe for arithmetic, and what kind they are; (m,) each."""

    lower: jax.Array
    """0 where infinite"""
    upper: jax.Array
    """0 where infinite"""
    from_below: jax.Array
    """bool: lower is finite, and not equal to upper"""
    from_above: jax.Array
    """bool"""
    fixed: jax.Array
    """bool: lower = upper"""
    valid: jax.Array
    """bool: lower <= upper, lower < inf, upper > -inf; false for NaN"""


def box_of(problem: BoxedLCP) -> Box:
    """The `Box` of a problem."""
    lower, upper = problem.lower, problem.upper
    bounded_below, bounded_above = lower > -jnp.inf, upper < jnp.inf
    fixed = (lower == upper) & bounded_below & bounded_above
    return Box(
        jnp.where(bounded_below, lower, 0),
        jnp.where(bounded_above, upper, 0),
        bounded_below & ~fixed,
        bounded_above & ~fixed,
        fixed,
        (lower <= upper) & (lower < jnp.inf) & (upper > -jnp.inf),
    )


@normal_form.register
def _(problem: BoxedLCP):
    if problem.q.ndim != 1:
        raise ValueError(f"BoxedLCP: takes one problem, got q {problem.q.shape}; write jax.vmap")
    box = box_of(problem)
    force, stiff, low, high, idle = _weights(problem, box)
    below, above, fixed = box.from_below, box.from_above, box.fixed
    free_below = ~(below | fixed)
    row, one, zero = force[:, None] * problem.M, jnp.ones_like(force), jnp.zeros_like(force)

    def rows(of_force, of_bound, bound):
        return jnp.where(of_force[:, None], row, _diagonal(bound * of_bound))

    def load(of_force, otherwise):
        return jnp.where(of_force, force * problem.q, otherwise)

    pushed = jnp.where(above, force, 0)
    middle = box.lower / 2 + box.upper / 2
    F = [rows(free_below, one, low), rows(~free_below, zero, low), rows(fixed, jnp.where(above, -one, 0), high)]
    P = [
        [jnp.where(below, -low, 0), jnp.where(free_below, pushed, 0)],
        [jnp.where(below, 0, jnp.where(fixed, stiff, 1)), jnp.where(below, pushed, 0)],
        [zero, jnp.where(fixed, force, 0)],
    ]
    N = [
        [zero, zero],
        [jnp.where(free_below, 0, force), zero],
        [zero, jnp.where(fixed, stiff, jnp.where(above, high, 1))],
    ]
    q = [
        load(free_below, -low * jnp.where(fixed, middle, box.lower)),
        load(~free_below, -idle),
        load(fixed, jnp.where(above, high * box.upper, idle)),
    ]
    return NormalForm(
        jnp.concatenate(F), _blocks(P), _blocks(N), jnp.where(jnp.tile(box.valid, 3), jnp.concatenate(q), jnp.nan)
    )


def _blocks(diagonals):
    return jnp.concatenate([jnp.concatenate([_diagonal(d) for d in line], axis=1) for line in diagonals])


def _diagonal(d):
    return jnp.where(np.eye(len(d), dtype=bool), d[:, None], 0)


def _weights(problem, box):
    """(force, stiff, low, high, idle), constants of differentiation: powers of two for the rows of M, for lengths in
    these rows (t times force) and for the rows of the two bounds, (m,) each, and the size () of the balanced data."""
    M, q = lax.stop_gradient((problem.M, problem.q))
    lower, upper = lax.stop_gradient((box.lower, box.upper))
    rows = row_exponents(M)
    force = power_of_two(rows, q.dtype)
    size = largest(force * given_size(M, q, lax.stop_gradient(problem)))
    size = power_of_two(exponent(jnp.where(size > 0, size, 1)), q.dtype)

    def of_bound(bound):
        held = jnp.where(bound == 0, -rows, jnp.minimum(-rows, exponent(size) - exponent(bound)))
        return power_of_two(held, q.dtype)

    return force, power_of_two(-rows, q.dtype), of_bound(lower), of_bound(upper), size


def given_size(M, q, problem):
    """(m,) |M| |x| + |q| at the point of the box nearest to zero: the size of the data, as |q| is that of an LCP."""
    nearest = jnp.clip(jnp.zeros_like(q), problem.lower, problem.upper)
    return dot(lax.abs(M), lax.abs(nearest)) + lax.abs(q)


def residuals_of_box(problem: BoxedLCP, x):
    """(eta, rho) of x: the largest |mid(x - upper, M x + q, x - lower)|, which is zero at solutions only, relative to
    the sizes that enter (eta, the larger of the caller's and the balanced units) and to the data (rho). Where all x are
    zero, every distance from a bound is large."""
    M, q = problem.M, problem.q
    w, terms = dot(M, x) + q, dot(lax.abs(M), lax.abs(x)) + lax.abs(q)
    diagonal, side = linalg.diagonal(M), largest_of_rows(M)
    t = jnp.where(diagonal > 0, diagonal, jnp.where(side > 0, side, 1))
    rows = row_exponents(M)
    force, length = power_of_two(rows, q.dtype), power_of_two(-rows, q.dtype)

    def backward(force, length):
        size, load = largest(length * x), largest(force * terms)
        reach = jnp.where(size > 0, length / _above_zero(size), jnp.inf)
        return largest(_middle(problem, x, reach, force * w / _above_zero(load)))

    one = jnp.ones_like(q)
    given = largest(given_size(M, q, problem))
    rho = largest(_middle(problem, x, t, w)) / _above_zero(given)
    return jnp.maximum(backward(one, one), backward(force, length)), rho


def _middle(problem, x, t, w):
    """(m,) the middle one of t (x - upper), w, t (x - lower); a distance of zero stays zero for infinite t."""
    above, below = (jnp.where(x == bound, 0, t * (x - bound)) for bound in (problem.upper, problem.lower))
    return jnp.maximum(above, jnp.minimum(w, below))


def _above_zero(x):
    return jnp.where(x > 0, x, 1)


def pairs_of_box(problem: BoxedLCP, x):
    """(z, w), (2 m,) each, of the pairs above at a solution x."""
    box = box_of(problem)
    force, stiff, _, _, idle = _weights(problem, box)
    w = dot(problem.M, x) + problem.q
    a, b = jnp.maximum(w, 0), jnp.maximum(-w, 0)
    free_below, free_above = ~(box.from_below | box.fixed), ~(box.from_above | box.fixed)
    over = jnp.where(box.fixed, b * force / stiff, jnp.where(free_below, idle, jnp.maximum(x - box.lower, 0)))
    under = jnp.where(box.fixed, a * force / stiff, jnp.where(free_above, idle, jnp.maximum(box.upper - x, 0)))
    return jnp.concatenate([over, b]), jnp.concatenate([a, under])
