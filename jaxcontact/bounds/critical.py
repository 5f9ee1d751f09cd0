"""The exact friction threshold: one solution for every load below it, not above."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from ..dynamics import Delassus
from ..dynamics.numbers import as_float_array
from .sign_real import radius_of_two
from .vertices import MOST_VERTICES, Reduced, at_vertex, largest_vertex, reduced

CLOSED_FORM = 2
"""Largest number of frictional contacts whose threshold is a formula."""


def critical(operators: Delassus, ratio: Array | None = None, most_vertices: int = MOST_VERTICES) -> Array:
    """The supremum of r such that for every load, every sign of sliding and all |mu_i| <= r ratio_i the sliding problem
    has exactly one solution.

    Exact, for bilateral, unilateral and mixed contacts alike: r = 1 / max over the sets I of closed contacts (all
    bilateral ones and any choice of unilateral ones) of the sign-real spectral radius of W_I^-1 Wt_I diag(ratio).
    Proof: uniqueness for every load is the column W-property, the determinants of W_I - r Wt_I S being positive for all
    signatures S (Sznajder & Gowda, Linear Algebra Appl. 223 (1995) 695-715); they are multi-affine in friction. With
    two frictional guides: r = cot theta for PainleveKlein.

    `critical(delassus(guides, guides.state(theta=0.9)))`

    Args:
        operators: from `delassus`, one configuration; batches through `jax.vmap`.
        ratio: (m,) friction coefficients up to a factor; entries of frictionless contacts are ignored. None: ones.
        most_vertices: the cost grows as 2^b 3^u for b bilateral and u unilateral frictional contacts, doubled for each
            frictionless unilateral one; beyond this many vertices the question is refused.

    Returns:
        r, dimensionless: 0 if W is singular (dependent gaps), inf if uniqueness is never lost, NaN for NaN operators.
        It depends neither on units nor on the scaling of rows. Derivatives of every order through the left and right
        null vectors at the binding vertex; where several vertices bind (`binding_mode` flags it), those of one of them
        or of their mean.

    Raises:
        ValueError: for more than `most_vertices` vertices; `critical_bracket` then brackets the value.
    """
    refuse_many(operators, most_vertices, "critical")
    return _critical(operators, ratio_array(operators, ratio))


def critical_for_signs(
    operators: Delassus, xi: Array, ratio: Array | None = None, most_vertices: int = MOST_VERTICES
) -> Array:
    """The same for one given vector xi (m,) of signs of sliding, and all 0 <= mu_i <= r ratio_i.

    For bilateral contacts it is `critical`, whatever xi (mathematics: S runs over all signatures); at a unilateral
    contact the sign matters, friction there runs from 0 to xi. `critical_for_signs(here, jnp.array([1.0, -1.0]))`

    Raises:
        ValueError: if xi has another shape than (m,), or there are too many vertices.
    """
    refuse_many(operators, most_vertices, "critical_for_signs")
    return _critical_for_signs(operators, sign_array(operators, xi), ratio_array(operators, ratio))


def threshold(problem: Reduced, radius: Array) -> Array:
    """1 / radius; inf for 0; 0 where W is singular; NaN passed on."""
    lost = radius > 0
    value = jnp.where(lost, 1 / jnp.where(lost, radius, 1), jnp.inf)
    value = jnp.where(problem.singular, 0, value)
    return jnp.where(jnp.isnan(radius) | jnp.isnan(jnp.sum(problem.N)), jnp.nan, value)


def refuse_many(operators: Delassus, most: int, name: str) -> None:
    """Raise ValueError before more than `most` vertices are looked at."""
    count = count_of_vertices(operators)
    if count > most:
        raise ValueError(
            f"{name} would look at {count} vertices for {len(operators.contacts)} contacts, more than {most}: "
            f"use critical_bracket, or pass most_vertices={count} and wait"
        )


def count_of_vertices(operators: Delassus) -> int:
    """How many determinants decide: 2^b 3^u 2^s, for s frictionless unilateral contacts. `count_of_vertices(here)`"""
    rough_b = sum(c.bilateral and c.frictional for c in operators.contacts)
    rough_u = sum(not c.bilateral and c.frictional for c in operators.contacts)
    smooth_u = sum(not c.bilateral and not c.frictional for c in operators.contacts)
    return 2**rough_b * 3**rough_u * 2**smooth_u


def ratio_array(operators: Delassus, ratio: Array | None) -> Array | None:
    """None, or the ratio as an array."""
    return None if ratio is None else as_float_array("ratio", ratio)


def sign_array(operators: Delassus, xi: Array) -> Array:
    """xi as an array (m,) of the operators' dtype. Raises ValueError for another shape."""
    xi = jnp.asarray(xi).astype(operators.N.dtype)
    if xi.shape != (len(operators.contacts),):
        raise ValueError(f"xi must have one sign per contact, shape ({len(operators.contacts)},), got {xi.shape}")
    return xi


@partial(jax.jit, inline=True)
def _critical(operators: Delassus, ratio: Array | None) -> Array:
    problem = reduced(operators, ratio)
    return threshold(problem, radius(problem))


@partial(jax.jit, inline=True)
def _critical_for_signs(operators: Delassus, xi: Array, ratio: Array | None) -> Array:
    problem = reduced(operators, ratio)
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    signs = jnp.stack([xi[i] for i in problem.kept])
    return threshold(problem, _vertex_radius(problem, signs))


def radius(problem: Reduced) -> Array:
    """The largest sign-real spectral radius over the sets of closed contacts."""
    if not problem.frictional or not regular_shape(problem):
        return zero_radius(problem)
    if len(problem.frictional) > CLOSED_FORM:
        return _vertex_radius(problem, None)
    values = [radius_of_two(problem.coupling_of(members)) for members in problem.sets()]
    return linalg.greatest(jnp.stack(values))


def regular_shape(problem: Reduced) -> bool:
    """False for more contacts than degrees of freedom: W is singular whatever the numbers."""
    return problem.N.shape[0] >= problem.N.shape[1]


def zero_radius(problem: Reduced) -> Array:
    """0, or NaN with the problem."""
    return 0 * (jnp.sum(problem.N) + jnp.sum(problem.T))


def _vertex_radius(problem: Reduced, xi: Array | None) -> Array:
    value, closed, signs = largest_vertex(problem, xi)
    lost = value > 0
    exact = at_vertex(problem, jnp.where(lost, value, 1), closed, signs)
    return jnp.where(lost, exact, 0 * value)
