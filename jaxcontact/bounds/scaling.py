"""The diagonal scaling that makes the norm of a matrix smallest, with the multipliers that prove it smallest.

With Y = D^-1 X D, D = exp(t), and G = Y^T Y the squared norm is the smallest lambda for which S = lambda - G is
positive semidefinite; log lambda is convex in t. At the minimum there is a Z >= 0 of trace one with S Z = 0 and

    g_i = <Z, dG/dt_i> = 2 (Z G)_ii - 2 (Y Z Y^T)_ii = 0    for every i:

Z weighs the largest singular values, which are repeated there as a rule. (t, lambda, Z) are followed along the path
S Z = tau, tau -> 0, by Newton steps in the direction of Nesterov & Todd, SIAM J. Optim. 8 (1998) 324-364: dZ = tau
S^-1 - Z - V dS V, where V is the geometric mean of S^-1 and Z. Since lambda is stationary in t, its derivative in X is
<Z, dG> at fixed t.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from .sign_real import balanced

DECREASE = 0.3
"""tau goes down by this factor in a step; full steps then keep S and Z positive definite nearly always."""

GAP = 8
"""The path ends at tau = this many roundings of lambda."""

STEPS_PER_BIT = 1
"""Steps allowed for each bit of the dtype; about 30 lead to the end in float64, 12 in float32."""

FAR = 30
"""Farthest off the path, as `off_centre` says."""

LOOSE = 10
"""The equations for g and tr Z may be missed by this many tau / lambda, which rounding exceeds at last ..."""

PRECISE = 0.5
"""... or by this power of a rounding; the path ends there."""

SHORTER = 0.25
"""A step that leads too far off is tried again at this part of its length."""

SHORTEST = 1e-4
"""And the path ends where it is shorter than this."""

LONGEST = 1.0
"""Longest change of any log D in one step."""

FLAT = 64
"""A pivot this many roundings of its diagonal entry shows a direction along which nothing changes."""


class Point(NamedTuple):
    """A point of the path."""

    t: Array
    """(m,) log D."""
    size: Array
    """lambda, above the squared norm."""
    Z: Array
    """(m, m) multipliers: positive definite, trace one."""


class Surroundings(NamedTuple):
    """What belongs to a point."""

    tau: Array
    """tr(S Z) / m."""
    P: Array
    """S^-1."""
    Q: Array
    """Z^-1."""
    off_centre: Array
    """tau times the mean of the inverse eigenvalues of S Z: one on the path, infinite at the border."""


def scaled_norm(X: Array) -> Array:
    """The smallest |D^-1 X D|_2 over positive diagonal D, for X (m, m); the limit, where entries have to vanish for it.

    The value is the norm at the D that was found: above the minimum by rounding, never below. Derivatives of first and
    second order. `scaled_norm(jnp.array([[0.0, 100.0], [0.01, 0.0]]))` is 1.
    """
    X = balanced(jnp.where(_on_a_cycle(X), X, 0))
    unit = lax.stop_gradient(linalg.greatest(abs(X)))
    nothing = ~((unit > 0) & (unit < jnp.inf))
    unit = jnp.where(nothing, 1, unit)
    value = unit * _smallest_norm(jnp.where(nothing, jnp.eye(X.shape[0], dtype=X.dtype), X / unit))
    return jnp.where(nothing, jnp.sum(X), value)


def _on_a_cycle(X: Array) -> Array:
    """(m, m) bool: entry i, j leads to an index from which another path leads back. Others can be scaled away."""
    m = X.shape[0]
    reach = jnp.where(lax.stop_gradient(X) == 0, jnp.eye(m, dtype=X.dtype), 1)
    for _ in range((m - 1).bit_length()):
        reach = jnp.minimum(_product(reach, reach), 1)
    return (reach.T > 0) | jnp.isnan(X)


@jax.custom_jvp
def _smallest_norm(X: Array) -> Array:
    return linalg.singular_value_max(_scaled(X, path_end(X).t))


@_smallest_norm.defjvp
def _smallest_norm_jvp(primals, tangents):
    """d sigma = sigma <dY, Y Z> / <Y, Y Z>."""
    value = _smallest_norm(*primals)
    end = path_end(*primals)
    Y, dY = (_scaled(x, end.t) for x in (primals[0], tangents[0]))
    weights = _product(Y, end.Z)
    return value, value * jnp.sum(dY * weights) / jnp.sum(Y * weights)


@jax.custom_jvp
def path_end(X: Array) -> Point:
    """The minimum and its multipliers for X (m, m) with largest entry one."""
    return _followed(X, GAP * float(jnp.finfo(X.dtype).eps))


@path_end.defjvp
def _path_end_jvp(primals, tangents):
    """The implicit derivative of the equations of the path, taken where S still has half its digits."""
    (X,), (dX,) = primals, tangents
    point = _followed(X, float(jnp.finfo(X.dtype).eps) ** 0.5)
    Y, dY = _scaled(X, point.t), _scaled(dX, point.t)
    V = _mean(Y, point, _surroundings(Y, point))
    dG = _product(Y.T, dY)
    dG = dG + dG.T
    forced = 2 * jnp.sum(point.Z * dG, axis=0) - 4 * jnp.sum(_product(dY, point.Z) * Y, axis=1)
    return path_end(X), _solved(Y, V, point, _product(V, _product(dG, V)), forced, jnp.zeros_like(point.size))


def _followed(X: Array, gap: float) -> Point:
    """The point of the path where tau is `gap` times lambda, or the last that was reached."""
    m = X.shape[0]
    X = lax.stop_gradient(X)
    size = 2 * jnp.sum(X * X)
    Z, _ = _inverse(_slack(X, size))
    point = Point(jnp.zeros(m, X.dtype), size, Z / _trace(Z))
    most = STEPS_PER_BIT * jnp.finfo(X.dtype).bits

    def unfinished(state):
        point, around, length, step = state
        return (step < most) & (around.tau > gap * point.size) & (length > SHORTEST)

    def followed(state):
        point, around, length, step = state
        change = _newton(X, point, around)
        share = length * jnp.minimum(1, LONGEST / jnp.maximum(linalg.greatest(abs(change.t)), LONGEST))
        trial = Point(*(x + share * dx for x, dx in zip(point, change)))
        there = _surroundings(_scaled(X, trial.t), trial)
        inside = there.off_centre < FAR
        length = jnp.where(inside, jnp.minimum(length / SHORTER, 1), length * SHORTER)
        state = jax.tree.map(lambda new, old: jnp.where(inside, new, old), (trial, there), (point, around))
        return *state, length, step + 1

    start = point, _surroundings(X, point), jnp.ones_like(size), jnp.zeros((), jnp.int32)
    return lax.while_loop(unfinished, followed, start)[0]


def _surroundings(Y: Array, point: Point) -> Surroundings:
    S = _slack(Y, point.size)
    tau = jnp.sum(S * point.Z) / len(S)
    (P, first), (Q, second) = _inverse(S), _inverse(point.Z)
    missed = abs(_trace(point.Z) - 1) + linalg.greatest(abs(_against(Y, _gram(Y), point.Z))) / point.size
    near = missed < jnp.maximum(LOOSE * tau / point.size, float(jnp.finfo(Y.dtype).eps) ** PRECISE)
    off_centre = jnp.where(first & second & near, tau * jnp.sum(P * Q) / len(S), jnp.inf)
    return Surroundings(tau, P, Q, off_centre)


def _newton(X: Array, point: Point, around: Surroundings) -> Point:
    """The change to the point of the path at a lower tau."""
    Y = _scaled(X, point.t)
    slope = _against(Y, _gram(Y), point.Z)
    K = DECREASE * around.tau * around.P - point.Z
    return _solved(Y, _mean(Y, point, around), point, K, slope, _trace(point.Z) - 1)


def _mean(Y: Array, point: Point, around: Surroundings) -> Array:
    """The geometric mean of S^-1 and Z: an arithmetic-harmonic step and the middle; near the path they are alike."""
    S, tau = _slack(Y, point.size), around.tau
    arithmetic = 0.5 * (tau * around.P + point.Z)
    harmonic = 2 * _inverse(S / tau + around.Q)[0]
    return 0.5 * (arithmetic + harmonic) / jnp.sqrt(tau)


def _solved(Y: Array, V: Array, point: Point, K: Array, slope: Array, excess: Array) -> Point:
    """The change that makes g + slope + dg = 0, tr dZ = -excess, dZ = K - V dS V.

    Without dZ and d lambda it is a symmetric system in dt, singular along (1, ..., 1) where nothing changes.
    """
    G, VV = _gram(Y), _product(V, V)
    q, c = _trace(VV), _against(Y, G, VV)
    A = _curvature(Y, G, point.Z) + _response(Y, G, V) - c[:, None] * c[None, :] / q
    surplus = _trace(K) + excess
    dt = _elimination(A + _trace(A) / len(c) ** 2, c * surplus / q - slope - _against(Y, G, K))
    d_size = (jnp.sum(c * dt) + surplus) / q
    dG = dt[:, None] * G + G * dt[None, :] - 2 * _product(Y.T, dt[:, None] * Y)
    dS = d_size * jnp.eye(len(c), dtype=Y.dtype) - dG
    return Point(dt, d_size, K - _product(V, _product(dS, V)))


def _against(Y: Array, G: Array, K: Array) -> Array:
    """(m,) <K, dG/dt_i> for symmetric K."""
    return 2 * jnp.sum(K * G, axis=0) - 2 * jnp.sum(_product(Y, K) * Y, axis=1)


def _curvature(Y: Array, G: Array, Z: Array) -> Array:
    """(m, m) second derivatives in t of <Z, G> = sum of Z_kl Y_ik Y_il, whose terms go as exp(t_k + t_l - 2 t_i)."""
    YZ = Y * _product(Y, Z)
    diagonal = 2 * jnp.sum(YZ, axis=0) + 4 * jnp.sum(YZ, axis=1)
    return 2 * Z * G - 4 * (YZ + YZ.T) + jnp.eye(len(Z), dtype=Z.dtype) * diagonal[None, :]


def _response(Y: Array, G: Array, V: Array) -> Array:
    """(m, m) tr(dG/dt_i V dG/dt_j V), where dG/dt_i = e_i G_i^T + G_i e_i^T - 2 Y_i Y_i^T."""
    GV, YV = _product(G, V), _product(Y, V)
    mixed = YV * _product(YV, G)
    across = _product(YV, Y.T)
    return 2 * (GV * GV.T + _product(GV, G) * V - 2 * (mixed + mixed.T) + 2 * across * across)


def _elimination(A: Array, b: Array) -> Array:
    """x with A x = b for symmetric positive semidefinite A (m, m); nothing along directions that A does not see."""
    m = len(b)
    one = jnp.eye(m, dtype=b.dtype)
    floor = FLAT * float(jnp.finfo(b.dtype).eps) * linalg.greatest(jnp.sum(A * one, axis=0))
    inverses = []
    for k in range(m):
        seen = A[k, k] > floor
        inverses.append(linalg.shield(jnp.where(seen, 1 / jnp.where(seen, A[k, k], 1), 0)))
        column = inverses[k] * A[:, k] * (1 - one[k])
        row, right = A[k], b[k]
        A, b = A - column[:, None] * row[None, :], b - column * right
    return jnp.stack(inverses) * b


def _inverse(S: Array) -> tuple[Array, Array]:
    """(S^-1, whether S (m, m) is positive definite), the inverse meaningless if it is not: the symmetric sweep."""
    m = S.shape[0]
    definite = jnp.ones((), bool)
    for k in range(m):
        here = np.arange(m) == k
        row_k, column_k = (np.broadcast_to(x, (m, m)) for x in (here[:, None], here[None, :]))
        pivot = S[k, k]
        definite = definite & (pivot > 0)
        inverse = linalg.shield(1 / jnp.where(pivot > 0, pivot, 1))
        scaled = inverse * S[k]
        rest = S - S[k][:, None] * scaled[None, :]
        rest = jnp.where(row_k, scaled[None, :], jnp.where(column_k, scaled[:, None], rest))
        S = jnp.where(row_k & column_k, -inverse, rest)
    return -S, definite


def _slack(Y: Array, size: Array) -> Array:
    """lambda - Y^T Y."""
    return size * jnp.eye(Y.shape[0], dtype=Y.dtype) - _gram(Y)


def _scaled(X: Array, t: Array) -> Array:
    """D^-1 X D for D = exp(t)."""
    return X * jnp.exp(t[None, :] - t[:, None])


def _trace(A: Array) -> Array:
    return jnp.sum(A * jnp.eye(len(A), dtype=A.dtype))


def _gram(Y: Array) -> Array:
    return _product(Y.T, Y)


def _product(A: Array, B: Array) -> Array:
    return jnp.matmul(A, B, precision=lax.Precision.HIGHEST)
