"""Kinks of the bound: where singular values coincide it has one-sided slopes and no derivative."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from ..dynamics import Delassus
from .norm_ratio import remaining_factors, safe_ratio
from .ratio import ratio_of

COINCIDENT = 64
"""Singular values closer than this many roundings of the largest one count as one, unless the caller says how close."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Slopes:
    """The bound along a line: its value and both one-sided slopes."""

    value: Array
    """() the bound."""
    left: Array
    """() slope on the side the direction comes from, per unit of the direction."""
    right: Array
    """() slope on the side it goes to."""
    kink: Array
    """() bool: singular values coincide here and the two slopes differ."""


def slopes(
    operators_of: Callable[[Any], Delassus],
    at: Any,
    direction: Any,
    ratio: Array | None = None,
    closeness: float | None = None,
) -> Slopes:
    """`norm_ratio` at a point of a family of configurations, with its one-sided slopes along a direction.

    At coincident singular values the one-sided derivatives are those of the largest or smallest eigenvalue over the
    singular subspaces (mathematics: max' = lambda_max(sym(U^T dX V)), min' = lambda_min(V^T dW V)); a gradient there is
    only one element of Clarke's set. The best geometry of an optimiser is often such a point.

    Args:
        operators_of: from a point (any pytree of floats) to its Delassus operators.
        at, direction: the point and the direction, of the same structure.
        closeness: singular values within `closeness` times the largest count as coincident; None: 64 roundings. A
        larger
            value asks whether a kink is near.

    Example: at the top of the Painlevé-Klein curve,
        slopes(lambda theta: jc.delassus(guides, guides.state(theta=theta)), jnp.arccos(3**-0.5), 1.0)
    gives left 0.5, right -1.5.
    """
    at, direction = (jax.tree.map(jnp.asarray, tree) for tree in (at, direction))
    here, change = jax.jvp(operators_of, (at,), (direction,))
    rates = ratio_of(here.contacts, ratio, here.N.dtype)

    def factors(operators):
        N, T = remaining_factors(operators, rates)
        return linalg.gram(N, N), linalg.gram(N, T)

    (W, Y), (dW, dY) = jax.jvp(factors, (here,), (change,))
    return _slopes_of_ratio(W, Y, dW, dY, closeness)


def _slopes_of_ratio(W: Array, Y: Array, dW: Array, dY: Array, closeness: float | None) -> Slopes:
    """Quotient rule for sigma_min(W) / sigma_max(Y), each side with its own one-sided derivatives."""
    if Y.shape[1] == 0:
        zero = jnp.zeros((), W.dtype)
        return Slopes(value=zero + jnp.inf, left=zero, right=zero, kink=zero > 0)
    closeness = COINCIDENT * jnp.finfo(W.dtype).eps if closeness is None else closeness
    eigenvalues, V = jnp.linalg.eigh(W)
    top = eigenvalues[0]
    low = eigenvalues - top <= closeness * eigenvalues[-1]
    top_right, top_left = _extremes(V, dW, V, low)
    U, sigma, Zt = jnp.linalg.svd(Y, full_matrices=False)
    high = sigma[0] - sigma <= closeness * sigma[0]
    bottom_left, bottom_right = _extremes(U, dY, Zt.T, high)
    bottom = sigma[0]
    value = safe_ratio(top, bottom)
    right = (top_right - value * bottom_right) / bottom
    left = (top_left - value * bottom_left) / bottom
    several = (jnp.sum(low) > 1) | (jnp.sum(high) > 1)
    rounding = closeness**0.5 * (abs(left) + abs(right))
    return Slopes(value=value, left=left, right=right, kink=several & (abs(left - right) > rounding))


def _extremes(U: Array, D: Array, V: Array, chosen: Array) -> tuple[Array, Array]:
    """Smallest and largest eigenvalue of sym(U^T D V) over the chosen columns."""
    B = jnp.matmul(jnp.matmul(U.T, D, precision="highest"), V, precision="highest")
    B = jnp.where(chosen[:, None] & chosen[None, :], 0.5 * (B + B.T), 0.0)
    beyond = 1 + 2 * jnp.sum(abs(B))
    smallest = jnp.linalg.eigvalsh(B + jnp.diag(jnp.where(chosen, 0.0, beyond)))[0]
    largest = jnp.linalg.eigvalsh(B - jnp.diag(jnp.where(chosen, 0.0, beyond)))[-1]
    return smallest, largest
