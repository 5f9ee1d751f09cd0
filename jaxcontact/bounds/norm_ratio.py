"""The tutorial's friction bound: smallest singular value of the normal coupling over largest of the tangential one."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from ..dynamics import Delassus, without_frictionless_bilateral
from ..dynamics.delassus import select, select_columns
from .ratio import ratio_of


def norm_ratio(operators: Delassus, ratio: Array | None = None) -> Array:
    """The bound r on friction, mu = r * ratio, below which the contact forces exist and are unique for every load.

    The frictionless bilateral contacts are eliminated by Schur complement; of what is left the bound is
    sigma_min(W) / sigma_max(Wt diag(ratio)). That one rule is Proposition 10 (all contacts bilateral and frictional),
    12 (bilateral, some frictionless), 13 (unilateral), 15 (frictionless bilateral with unilateral) or the direct bound
    (anything else), according to the contacts. Sufficient; the exact threshold is `critical`.

    `norm_ratio(delassus(guides, guides.state(theta=0.9)))`

    It depends on the scaling of the rows: a gap measured in other units than metres, or by a function whose gradient is
    not that of a distance, changes it, though the contact problem stays the same. Masses enter by their ratios only.

    Args:
        operators: from `delassus`.
        ratio: (m,) friction coefficients up to a factor, in the order of the contacts; entries of frictionless contacts
        are
            ignored. None: equal coefficients.

    Returns:
        r, dimensionless. inf if nothing is frictional or friction does no harm to any normal direction; 0 if the gaps
        depend on each other (W singular: the hypothesis fails); NaN if the operators hold NaN.
        Differentiable in both modes; at repeated singular values the derivative is an element of Clarke's set, see
        `slopes`.
    """
    return _norm_ratio(operators, ratio_of(operators.contacts, ratio, operators.N.dtype))


def norm_ratio_of_factors(N: Array, T: Array) -> Array:
    """sigma_min(N^T N) / sigma_max(N^T T), inf for an empty T, 0 if the columns of N depend on each other.

    N (n, m), T (n, k): whitened gaps, and tangential directions already scaled by the ratio of coefficients.
    """
    if T.shape[1] == 0:
        return jnp.full((), jnp.inf, N.dtype)
    if N.shape[1] == 1:
        return safe_ratio(linalg.gram(N, N)[0, 0], jnp.abs(linalg.gram(N, T)[0, 0]))
    normal = linalg.singular_value_min(N) ** 2
    return safe_ratio(normal, linalg.singular_value_max(linalg.gram(N, T)))


def safe_ratio(top: Array, bottom: Array) -> Array:
    """top / bottom for top, bottom >= 0: inf where only bottom is zero, 0 where top is zero, NaN of either passed
    on."""
    quotient = top / jnp.where(bottom == 0, 1.0, bottom)
    return jnp.where(bottom == 0, jnp.where(top > 0, jnp.inf, top), quotient)


def scaled_tangents(operators: Delassus, ratio: Array) -> Array:
    """(n, k) whitened tangential directions of the k frictional contacts, times their ratio."""
    T = select_columns(operators.T, operators.frictional)
    return jnp.stack([T[:, j] * ratio[i] for j, i in enumerate(operators.frictional)], axis=1) if T.shape[1] else T


def remaining_factors(operators: Delassus, ratio: Array) -> tuple[Array, Array]:
    """(N, T) without the frictionless bilateral contacts; T of the frictional ones, times their ratio (m,)."""
    kept = [i for i, contact in enumerate(operators.contacts) if contact.frictional or not contact.bilateral]
    rest = without_frictionless_bilateral(operators)
    return rest.N, scaled_tangents(rest, select(ratio, kept))


@partial(jax.jit, inline=True)
@linalg.fused
def _norm_ratio(operators: Delassus, ratio: Array) -> Array:
    return norm_ratio_of_factors(*remaining_factors(operators, ratio))
