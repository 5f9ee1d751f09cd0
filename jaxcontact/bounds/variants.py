"""Other exact thresholds, by name: along a ray of given signs, for existence, and for one given load; what binds.

They look at every vertex by `jnp.linalg.eig`, which JAX has on CPU and only in some GPU builds; `critical` needs none.
"""

import itertools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus, without_frictionless_bilateral
from .coupling import masked_coupling, square_factors
from .critical import ratio_array, refuse_many, regular_shape, sign_array, threshold, zero_radius
from .sign_real import balanced
from .vertices import MOST_VERTICES, Reduced, reduced

MOST_FOR_LOAD = 4
"""Most contacts for which every change of the number of solutions is located: m (m + 1) roots in each of 2^m modes."""

SIGN = 1e-7
"""Share of the largest component of a null vector below which its sign is not looked at."""

ZERO = 16
NILPOTENT = 4
"""An eigenvalue below ZERO m eps |X| times its condition, or below NILPOTENT (m eps)^(1/m) |X|, may be a zero."""

TIE = 1e4
"""Vertices whose thresholds agree to this many roundings bind together."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BindingMode:
    """The vertex that sets the critical friction: there the contact forces cease to be unique first."""

    value: Array
    """r, as `critical`."""
    runner_up: Array
    """r at the next vertex; inf if no other loses uniqueness."""
    closed: Array
    """(m,) bool: the contacts that press."""
    signs: Array
    """(m,) sgn(lambda) xi of the frictional ones among them; 0 for the others."""
    kink: Array
    """bool: the two agree to rounding. Then `critical` may have one-sided derivatives only."""


def binding_mode(operators: Delassus, ratio: Array | None = None, most_vertices: int = MOST_VERTICES) -> BindingMode:
    """Which set of closed contacts with which signs loses uniqueness first, and how far the next one is.

    `binding_mode(here).signs`. A vertex and its reverse are one: the largest |real eigenvalue| over both is meant.

    Raises:
        ValueError: for more than `most_vertices` vertices.
    """
    refuse_many(operators, most_vertices, "binding_mode")
    problem = reduced(operators, ratio_array(operators, ratio))
    m = len(operators.contacts)
    if not problem.frictional or not regular_shape(problem):
        value = threshold(problem, zero_radius(problem))
        rest = jnp.zeros(m, value.dtype)
        return BindingMode(value, jnp.full_like(value, jnp.inf), rest > 0, rest, jnp.zeros((), bool))
    closed, signs = _table(problem, None)
    values = _radii(problem, closed, signs)
    order = jnp.argsort(-values)
    first, second = values[order[0]], values[order[1]] if len(closed) > 1 else jnp.zeros_like(values[0])
    value, runner_up = threshold(problem, first), threshold(problem, second)
    eps = float(jnp.finfo(values.dtype).eps)
    places = jnp.asarray(np.eye(m)[list(problem.kept)], values.dtype)
    pressing = jnp.sum(closed[order[0]][:, None] * places, axis=0) > 0
    gone = jnp.asarray([i not in problem.kept for i in range(m)], bool)
    return BindingMode(
        value=value,
        runner_up=runner_up,
        closed=pressing | gone,
        signs=jnp.sum((signs * closed)[order[0]][:, None] * places, axis=0),
        kink=(first > 0) & (second >= first * (1 - TIE * eps)),
    )


def critical_along_ray(operators: Delassus, xi: Array, ratio: Array | None = None) -> Array:
    """The first r at which mu = r ratio, with sliding signs xi (m,), loses "one solution for every load".

    A first loss: uniqueness may come back for larger r (mathematics 3(d)), so never read it as "unique iff below".
    At least `critical_for_signs`. `critical_along_ray(here, jnp.array([1.0, -1.0]))`

    Raises:
        ValueError: for a wrong shape, or too many vertices.
    """
    refuse_many(operators, MOST_VERTICES, "critical_along_ray")
    problem = reduced(operators, ratio_array(operators, ratio))
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    xi = sign_array(operators, xi)
    given = jnp.stack([xi[i] for i in problem.kept])
    return threshold(problem, linalg.greatest(_radii(problem, *_table(problem, given))))


def critical_existence(operators: Delassus, xi: Array, ratio: Array | None = None) -> Array:
    """r up to which, with mu = r ratio and sliding signs xi (m,), some solution exists for every load.

    The first r at which the problem without load has a solution other than zero. Below it the degree of the piecewise
    linear map load <- force stays one by homotopy from r = 0, so every load has a solution (Cottle, Pang & Stone, The
    Linear Complementarity Problem, section 6.1). Guaranteed below; exact for two guides of Painlevé-Klein type, where
    |xi_1 mu_1 - xi_2 mu_2| < 2 cot theta (mathematics 3(h)); in general existence may outlast it. At least
    `critical_along_ray`. No derivative. `critical_existence(here, jnp.array([1.0, 1.0]))`

    Raises:
        ValueError: for a wrong shape, or too many vertices.
    """
    refuse_many(operators, MOST_VERTICES, "critical_existence")
    problem = lax.stop_gradient(reduced(operators, ratio_array(operators, ratio)))
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    xi = sign_array(operators, xi)
    closed, signs = _table(problem, jnp.stack([xi[i] for i in problem.kept]))
    xi_kept = jnp.stack([xi[i] for i in problem.kept])
    N, T = square_factors(problem.N, problem.T)
    both = jnp.asarray([i in problem.bilateral for i in range(len(problem.kept))], bool)

    def radius(closed, signs):
        X = masked_coupling(N, T, closed, signs)
        values, vectors = jnp.linalg.eig(X)
        size = linalg.greatest(abs(vectors), axis=0)
        place = jnp.argmax(abs(vectors), axis=0)
        # The phase that makes the largest component real makes the vector of a real eigenvalue real.
        leading = jnp.take_along_axis(vectors, place[None, :], axis=0)
        v = (vectors * jnp.conj(leading)).real / (size * size)[None, :]
        real = (abs(values.imag) <= SIGN * abs(values.real)) & (values.real > 0) & _not_rounding(X, values, vectors)
        r = 1 / jnp.where(real, values.real, 1)
        gap = _product(N.T, _product(N * closed[None, :], v) - r[None, :] * _product(T * signs[None, :], v))
        # Bilateral: sgn(v_i) = xi_i S_i; closed unilateral: v_i >= 0; open: the gap may only open.
        wanted = jnp.where(both, xi_kept * signs, 1)[:, None] * jnp.where(closed[:, None] > 0, v, 0)
        scale = linalg.greatest(abs(N)) ** 2
        opening = jnp.where(closed[:, None] > 0, 0, gap / scale)
        fits = [jnp.all(s * wanted >= -SIGN, axis=0) & jnp.all(s * opening >= -SIGN, axis=0) for s in (1.0, -1.0)]
        return linalg.greatest(jnp.where(real & (fits[0] | fits[1]), values.real, 0))

    return threshold(problem, linalg.greatest(jax.vmap(radius)(closed, signs)))


def critical_for_load(operators: Delassus, xi: Array, ratio: Array | None = None) -> Array:
    """The smallest r at which this very problem, load w included, ceases to have exactly one solution; mu = r ratio.

    Between the values of r at which some normal force vanishes or grows without bound in some mode the number of
    solutions does not change; it is counted between each two of them. inf if it stays one. No derivative; for loads in
    general position (a load for which a force vanishes at every r, such as w = 0, is not).
    `critical_for_load(here, jnp.array([-1.0, -1.0]))`

    Raises:
        ValueError: for a wrong shape, or more than MOST_FOR_LOAD contacts that are not frictionless bilateral.
    """
    problem = lax.stop_gradient(reduced(operators, ratio_array(operators, ratio)))
    m = len(problem.kept)
    if m > MOST_FOR_LOAD:
        raise ValueError(
            f"critical_for_load takes at most {MOST_FOR_LOAD} contacts, got {m}: 2^m modes, m (m + 1) roots"
        )
    if not problem.frictional or not regular_shape(problem):
        return threshold(problem, zero_radius(problem))
    w = lax.stop_gradient(without_frictionless_bilateral(operators).w)
    xi = sign_array(operators, xi)
    xi = jnp.stack([xi[i] for i in problem.kept])
    W, Wt = _product(problem.N.T, problem.N), _product(problem.N.T, problem.T) * xi[None, :]
    modes = jnp.asarray(
        np.array(list(itertools.product(*[(1, -1) if i in problem.bilateral else (1, 0) for i in range(m)]))), W.dtype
    )
    events = jnp.sort(jnp.concatenate([_events(W, Wt, w, mode) for mode in modes]))
    last = linalg.greatest(jnp.where(events < jnp.inf, events, 0))
    ends = jnp.concatenate([jnp.zeros(1, W.dtype), events])
    after = jnp.concatenate([events, jnp.full(1, jnp.inf, W.dtype)])
    after = jnp.where(after < jnp.inf, after, 2 * last + 1)
    count = jax.vmap(lambda r: _count(W, Wt, w, modes, r))(0.5 * (ends + after))
    wide = after - ends > TIE * float(jnp.finfo(W.dtype).eps) * after
    changed = wide & (ends < jnp.inf) & (count != 1)
    value = linalg.least(jnp.where(changed, ends, jnp.inf))
    return jnp.where(jnp.isnan(jnp.sum(w)), jnp.nan, jnp.where(problem.singular, 0, value))


def _events(W: Array, Wt: Array, w: Array, mode: Array) -> Array:
    """(m (m + 1),) r > 0, or inf: a force of this mode vanishes (Cramer's rule) or its determinant does."""
    m = W.shape[0]
    one = jnp.eye(m, dtype=W.dtype)
    A = jnp.where(mode[None, :] != 0, W, one)
    B = Wt * mode[None, :]
    replaced = [(A, B)]
    for i in range(m):
        at = (jnp.arange(m) == i)[None, :]
        replaced.append((jnp.where(at, w[:, None], A), jnp.where(at, 0, B)))
    P, Q = (jnp.stack(parts) for parts in zip(*replaced))
    X = _finite(jnp.linalg.solve(P, Q))
    values, vectors = jnp.linalg.eig(X)
    real = (abs(values.imag) <= SIGN * abs(values.real)) & (values.real > 0)
    real = real & jax.vmap(_not_rounding)(X, values, vectors)
    return jnp.where(real, 1 / jnp.where(real, values.real, 1), jnp.inf).reshape(-1)


def _not_rounding(X: Array, values: Array, vectors: Array) -> Array:
    """(m,) bool: eigenvalues of X that are not zero up to rounding.

    Rounding moves each by eps |X| times its condition |y| |v| / |y'v| (Wilkinson), where X is nearly nilpotent by up to
    (m eps)^(1/m) |X| (Elsner, Linear Algebra Appl. 71 (1985)), whichever is less.
    """
    m, eps = X.shape[0], float(jnp.finfo(X.dtype).eps)
    left = jnp.linalg.inv(vectors)
    condition = jnp.sqrt(jnp.sum(abs(left) ** 2, axis=1) * jnp.sum(abs(vectors) ** 2, axis=0))
    share = jnp.fmin(ZERO * m * eps * condition, NILPOTENT * (m * eps) ** (1 / m))
    return abs(values) > share * jnp.sqrt(jnp.sum(X * X))


def _count(W: Array, Wt: Array, w: Array, modes: Array, r: Array) -> Array:
    """The number of modes that hold a solution; away from the events these are different solutions."""

    def holds(mode):
        one = jnp.eye(W.shape[0], dtype=W.dtype)
        # Column i: force i of this sign, or, open, minus its gap.
        K = jnp.where(mode[None, :] != 0, W - r * Wt * mode[None, :], -one)
        x = jnp.linalg.solve(K, -w)
        return jnp.all(jnp.where(mode != 0, mode * x, x) >= 0)

    return jnp.sum(jax.vmap(holds)(modes))


def _table(problem: Reduced, xi: Array | None) -> tuple[Array, Array]:
    """(closed (v, m), S (v, m)) of every vertex; with xi, friction at unilateral contacts has that one sign."""
    rows = []
    for members in problem.sets():
        free = [i for i in members if i in problem.frictional and (xi is None or i in problem.bilateral)]
        for signs in itertools.product((1.0, -1.0), repeat=len(free)):
            closed, sign = np.zeros((2, len(problem.kept)))
            closed[list(members)] = 1
            sign[list(set(members) & set(problem.frictional))] = 1
            sign[free] = signs
            rows.append((closed, sign))
    closed, signs = (jnp.asarray(np.array(part), problem.N.dtype) for part in zip(*rows))
    if xi is not None:
        both = jnp.asarray([i in problem.bilateral for i in range(len(problem.kept))], bool)
        signs = jnp.where(both[None, :], signs, signs * xi[None, :])
    return closed, signs


def _radii(problem: Reduced, closed: Array, signs: Array) -> Array:
    """(v,) the largest positive real eigenvalue at each vertex."""
    N, T = square_factors(problem.N, problem.T)
    return jax.vmap(lambda c, s: linalg.real_eigenvalue_max(balanced(masked_coupling(N, T, c, s))))(closed, signs)


def _product(A: Array, B: Array) -> Array:
    return jnp.matmul(A, B, precision=lax.Precision.HIGHEST)


def _finite(X: Array) -> Array:
    """X where it is finite, zero (no event) for a matrix that is not: its force vanishes at r = 0 or at every r."""
    return jnp.where(jnp.all(jnp.isfinite(X), axis=(-2, -1), keepdims=True), X, 0)
