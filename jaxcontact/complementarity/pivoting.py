"""What pivoting methods share: the cap on their pivots, and the correction at the end."""

import jax.numpy as jnp

from jaxcontact.complementarity.short import dot, largest

REFINEMENTS = 2
"""Correction steps with the final basis; the best of all candidates is kept."""

PIVOTS_PER_ROW = 50
PIVOTS_OF_A_CUBE = 12
"""The default budget is PIVOTS_PER_ROW m + 2^min(m, PIVOTS_OF_A_CUBE): Murty's and Fathi's cubes need 2^m pivots."""


def check_cap(method):
    """Raise ValueError for a `max_steps` below one."""
    if method.max_steps is not None and method.max_steps < 1:
        owner = type(method).__name__
        raise ValueError(f"{owner}: max_steps must be at least 1, got {method.max_steps}; None chooses by size")


def pivot_budget(m):
    """Pivots allowed by default for m contacts."""
    return PIVOTS_PER_ROW * m + 2 ** min(m, PIVOTS_OF_A_CUBE)


def violation(M, q, z):
    """max |min(z_i, (M z + q)_i)|, for data balanced by powers of two."""
    return largest(jnp.minimum(z, dot(M, z) + q))


def refined(M, q, z, correction):
    """(m,) >= 0, the candidate with the least violation among z and z - correction(M z + q), repeated.

    Rounding may leave a basic z slightly negative: it is set to zero before the violation is measured, so that what is
    measured is what is returned.
    """
    best = jnp.maximum(z, 0)
    least = violation(M, q, best)
    for _ in range(REFINEMENTS):
        z = z - correction(dot(M, z) + q)
        held = jnp.maximum(z, 0)
        size = violation(M, q, held)
        better = size < least
        best, least = jnp.where(better, held, best), jnp.where(better, size, least)
    return best
