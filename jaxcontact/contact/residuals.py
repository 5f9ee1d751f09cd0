"""How well forces and accelerations satisfy the mechanics: recomputed from the terms of the mechanism.

Each residual is relative and has no unit. Forces of coordinate i are measured in sqrt(M_ii), those of contact k by the
length |N_k| of its whitened gradient: all are then in sqrt(kg) m/s^2 like alpha = L^T a, comparable whatever the units.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..dynamics import Contact, Terms


class Residuals(NamedTuple):
    """Relative violations; each is the rounding of its terms where all is well."""

    dynamics: Array
    """M a + F - G lambda_n - H lambda_t, equation (1a)"""
    constraints: Array
    """G_b^T a + c_b of bilateral contacts"""
    complementarity: Array
    """min(lambda_n, G_u^T a + c_u) of unilateral contacts"""
    coulomb: Array
    """lambda_t + mu xi |lambda_n|"""

    @property
    def largest(self) -> Array:
        return linalg.greatest(jnp.stack(self))


class Motion(NamedTuple):
    """An answer and what it is measured with."""

    a: Array
    """(n,) accelerations"""
    normal: Array
    """(m,) N"""
    tangential: Array
    """(m,) N"""
    friction: Array
    """(m,) mu xi"""
    lengths: Array
    """(m,) |N_k|"""
    load: Array
    """|L^-1 F|, what acts besides the contacts"""


def residuals(contacts: tuple[Contact, ...], parts: Terms, motion: Motion) -> Residuals:
    """`Residuals` of a motion for the terms as the mechanism has them.

    >>> residuals(guides.contacts, terms(guides, state), motion).largest
    """
    a, normal, tangential, friction, lengths, load = motion
    unit = _unit_of_coordinates(parts.M)
    pushes = parts.G * normal[None, :], parts.H * tangential[None, :]
    miss = jnp.sum(parts.M * a[None, :], axis=1) + parts.F - jnp.sum(pushes[0] + pushes[1], axis=1)
    sizes = [jnp.sum(lax.abs(terms), axis=1) for terms in (parts.M * a[None, :], *pushes)]
    size = _largest((sum(sizes) + lax.abs(parts.F)) / unit)
    acceleration = linalg.gram(parts.G, a) + parts.c
    long = linalg.where(lengths > 0, lengths, 1)
    moved = (linalg.gram(lax.abs(parts.G), lax.abs(a)) + lax.abs(parts.c)) / long
    scale = jnp.maximum(jnp.maximum(_largest(moved), _largest(normal * lengths)), load)
    held = jnp.array([contact.bilateral for contact in contacts], bool)
    pair = jnp.minimum(normal * long, acceleration / long)
    return Residuals(
        _ratio(_largest(miss / unit), size),
        _ratio(_largest(linalg.where(held, acceleration / long, 0)), scale),
        _ratio(_largest(linalg.where(held, 0, pair)), scale),
        _ratio(_largest(tangential + friction * lax.abs(normal)), _largest(normal)),
    )


def _unit_of_coordinates(M: Array) -> Array:
    """(n,) sqrt(M_ii), 1 where that is zero."""
    diagonal = linalg.diagonal(M)
    return lax.sqrt(linalg.where(diagonal > 0, diagonal, 1))


def _largest(x: Array) -> Array:
    return linalg.greatest(lax.abs(x), initial=0)


def _ratio(x: Array, size: Array) -> Array:
    """x / size, where 0 / 0 is 0 and NaN stays NaN."""
    return x / linalg.where(size == 0, 1, size)
