"""Critical friction of many contacts between two certified values, without looking at every vertex."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus
from .coupling import masked_coupling, square_factors
from .critical import ratio_array, regular_shape, threshold, zero_radius
from .ladder import operator_norm, perron, sharper_direct
from .norm_ratio import norm_ratio
from .sign_real import balanced
from .vertices import Reduced, reduced

STARTS = 8
"""Vertices the search starts from: the largest couplings, then random ones (always the same)."""

ROUNDS_PER_CONTACT = 2
"""A start ends when no single change helps, or after this many changes for each contact."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Bracket:
    """lower <= critical <= upper."""

    lower: Array
    """The best of the bounds that cost no enumeration: below it uniqueness is certain."""
    upper: Array
    """The threshold of one vertex that was found: above it uniqueness is lost. inf if none was found."""
    closed: Array
    """(m,) bool: the witness, the contacts that press at that vertex."""
    signs: Array
    """(m,) the signs of friction there, 0 where there is none: det (W - upper Wt diag(ratio) S)_I = 0."""


def critical_bracket(operators: Delassus, ratio: Array | None = None) -> Bracket:
    """Two values that enclose `critical`, for any number of contacts.

    Lower: the largest of `norm_ratio`, `sharper_direct` and, for bilateral contacts, `operator_norm` and `perron`.
    Upper: a local search over the vertices, every single change of a sign or of an open contact tried in each round,
    from several starts. It may stop short of the binding vertex, but each vertex it names is a true witness. Cost: some
    thousand eigenvalue problems of size m (`jnp.linalg.eigvals`: on CPU). No derivative.

    `critical_bracket(here).upper`
    """
    rungs = [bound(operators, ratio) for bound in (norm_ratio, sharper_direct, operator_norm, perron)]
    lower = lax.stop_gradient(jnp.nanmax(jnp.stack(rungs)))
    problem = lax.stop_gradient(reduced(operators, ratio_array(operators, ratio)))
    m = len(operators.contacts)
    poisoned = jnp.isnan(jnp.sum(operators.N) + jnp.sum(operators.T))
    lower = jnp.where(poisoned, jnp.nan, lower)
    kept = jnp.asarray([i in problem.kept for i in range(m)], bool)
    if not problem.frictional or not regular_shape(problem):
        value = threshold(problem, zero_radius(problem))
        return Bracket(value, value, ~kept, jnp.zeros(m, lower.dtype))
    radius, closed, signs = _search(problem)
    upper = threshold(problem, radius)
    places = jnp.eye(m, dtype=lower.dtype)[jnp.asarray(problem.kept)]
    pressing = jnp.sum(closed[:, None] * places, axis=0) > 0
    # Rounding may put two equal values in the wrong order; the witness is the better known.
    friction = jnp.sum((signs * closed)[:, None] * places, axis=0)
    return Bracket(jnp.minimum(lower, upper), upper, pressing | ~kept, friction)


def _search(problem: Reduced) -> tuple[Array, Array, Array]:
    """(lambda, closed, signs) of the best vertex found."""
    N, T = square_factors(problem.N, problem.T)
    m = N.shape[1]
    may_open = jnp.asarray([i in problem.unilateral for i in range(m)], bool)
    rough = jnp.asarray([float(i in problem.frictional) for i in range(m)], N.dtype)

    def value(closed, signs):
        return linalg.real_eigenvalue_max(balanced(masked_coupling(N, T, closed, signs * rough)))

    def climbed(start):
        closed, signs = start
        flips = jnp.eye(m, dtype=N.dtype)

        def changed(state):
            closed, signs, best, _, rounds = state
            same = jnp.ones((m, 1), N.dtype)
            toggled = jnp.where((flips > 0) & may_open[None, :], 1 - closed[None, :], closed[None, :])
            trial_closed = jnp.concatenate([same * closed[None, :], toggled])
            trial_signs = jnp.concatenate([signs[None, :] * (1 - 2 * flips), same * signs[None, :]])
            values = jax.vmap(value)(trial_closed, trial_signs)
            place = jnp.argmax(values)
            better = values[place] > best
            return (
                jnp.where(better, trial_closed[place], closed),
                jnp.where(better, trial_signs[place], signs),
                jnp.maximum(best, values[place]),
                better,
                rounds + 1,
            )

        state = closed, signs, value(closed, signs), jnp.ones((), bool), jnp.zeros((), jnp.int32)
        ended = lax.while_loop(lambda s: s[3] & (s[4] < ROUNDS_PER_CONTACT * m), changed, state)
        return ended[2], ended[0], ended[1]

    values, closed, signs = lax.map(climbed, _starts(N, T, may_open))
    best = jnp.argmax(values)
    return values[best], closed[best], signs[best] * rough


def _starts(N: Array, T: Array, may_open: Array) -> tuple[Array, Array]:
    """(closed, signs), STARTS of each: everything closed with the signs of the diagonal, and random choices."""
    m = N.shape[1]
    coin = jax.random.bernoulli(jax.random.key(0), shape=(2, STARTS - 1, m))
    closed = jnp.concatenate([jnp.ones((STARTS // 2, m), bool), coin[0][STARTS // 2 - 1 :]])
    diagonal = jnp.where(jnp.sum(N * T, axis=0) < 0, -1, 1).astype(N.dtype)
    signs = jnp.concatenate([diagonal[None, :], jnp.where(coin[1], 1, -1).astype(N.dtype)])
    return (closed | ~may_open[None, :]).astype(N.dtype), signs
