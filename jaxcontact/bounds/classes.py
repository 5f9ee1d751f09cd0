"""Matrix classes with three-valued verdicts: does the class hold, by what margin, and which index set decides.

A margin is the spectral-norm distance to the complement of the class. For P-matrices it is min_S sigma_min(M_SS): a
smaller perturbation keeps every M_SS regular along the segment, and the worst singular triple attains it; for column-W
pairs the same with column representatives. Deciding is co-NP-complete (Coxson 1994): 2^m submatrices are looked at.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from .. import linalg

MOST_INDICES = 12
"""Largest m whose 2^m submatrices are looked at."""

ROUNDING = 8
"""A submatrix nearer to singular than this many roundings of the norm, times m, has a determinant of unknown sign."""


class Verdict(IntEnum):
    """What can be said of a statement in floating point."""

    NO = 0
    YES = 1
    UNDECIDED = 2
    """rounding, or data that are not finite, decide"""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Membership:
    """Whether a matrix belongs to a class."""

    verdict: Array
    """int32, a `Verdict`."""
    margin: Array
    """Distance to the complement of the class; if NO, minus the distance of the violating submatrix to singular."""
    members: Array
    """(m,) bool: the index set that violates the class, or comes nearest to it."""
    signs: Array
    """(m,) the signs of friction there; ones for a single matrix."""


def p_matrix(M: Array) -> Membership:
    """Is every principal minor of M (m, m) positive: has the LCP one solution for every q?

    `p_matrix(jnp.array([[1.0, -3.0], [0.0, 1.0]])).verdict` is YES. Raises ValueError beyond MOST_INDICES.
    """
    m = _size(M, "p_matrix")
    members = _subsets(m)
    return _membership(lambda member, _: _restricted(M, member), members, np.ones_like(members), _norm(M))


def column_w(A: Array, B: Array) -> Membership:
    """Have all A - B S, S a signature, determinants of one sign: has A x - B |x| + w = 0 one solution for every w?

    (Sznajder & Gowda 1995; the mean over S is det A, so the sign is that of det A.) `column_w(jnp.eye(2), 0.5 *
    jnp.eye(2))`
    """
    m = _size(A, "column_w")
    signs = np.array(list(itertools.product((1.0, -1.0), repeat=m)))
    found = _membership(lambda _, s: A - B * s[None, :], np.ones_like(signs), signs, _norm(A) + _norm(B))
    other = _membership(lambda _, s: B * s[None, :] - A, np.ones_like(signs), signs, _norm(A) + _norm(B))
    negative = jnp.linalg.slogdet(A)[0] < 0 if m % 2 else jnp.zeros((), bool)
    return jax.tree.map(lambda x, y: jnp.where(negative, y, x), found, other)


def positive_definite(M: Array) -> Membership:
    """Is x^T M x > 0 for all x: the smallest eigenvalue of the symmetric part. `positive_definite(jnp.eye(2))`"""
    m = M.shape[0]
    lowest = jnp.linalg.eigvalsh(0.5 * (M + M.T))[0]
    return _by_value(lowest, _norm(M), jnp.ones(m, bool))


def copositive(M: Array) -> Membership:
    """Is x^T M x >= 0 for all x >= 0: margin the minimum of x^T M x on the unit sphere of the orthant.

    The minimum is an eigenvalue of a principal submatrix with a positive eigenvector (Kaplan, Linear Algebra Appl. 313
    (2000) 203-206), so all are looked at. YES with margin > 0 is strict copositivity. `copositive(jnp.ones((2, 2)))`
    """
    m = _size(M, "copositive")
    sets = _subsets(m)
    S, size = 0.5 * (M + M.T), _norm(M)
    far = 2 * size + 1

    def lowest(member):
        inside = (member[:, None] * member[None, :]) > 0
        values, vectors = jnp.linalg.eigh(jnp.where(inside, S, far * jnp.eye(m, dtype=M.dtype)))
        vectors = vectors * jnp.where(jnp.sum(vectors, axis=0) < 0, -1, 1).astype(M.dtype)[None, :]
        nearly = -ROUNDING * m * float(jnp.finfo(M.dtype).eps)
        admissible = jnp.all((vectors >= nearly) | (member[:, None] == 0), axis=0) & (values <= size)
        return linalg.least(jnp.where(admissible, values, jnp.inf))

    values = jax.vmap(lowest)(jnp.asarray(sets, M.dtype))
    best = jnp.argmin(values)
    return _by_value(values[best], size, jnp.asarray(sets > 0)[best])


def beta(M: Array, p: float = 2) -> Array:
    """beta_p(M) = max_S |(M_SS)^-1|_p, p = 1, 2 or inf: the maximum of |(I - D + D M)^-1 D|_p over 0 <= D <= 1.

    It is attained at a vertex (mathematics 3(a)); beta_2 is the global Lipschitz constant of q -> z of the LCP, and 1 /
    beta_2 the distance of a P-matrix to the matrices that are not P. inf if some M_SS is singular.
    `beta(jnp.diag(jnp.array([2.0, 4.0])))` is 0.5.

    Raises:
        ValueError: for another p.
    """
    members = jnp.asarray(_subsets(_size(M, "beta")), M.dtype)
    return linalg.greatest(jax.vmap(lambda member: _inverse_norm(M, member, p))(members))


def error_constant(M: Array) -> Array:
    """The least c with |z - z*|_inf <= c |min(z, M z + q)|_inf for every z and q, M a P-matrix.

    max |(I - D + D M)^-1|_inf over 0 <= D <= 1 (Chen & Xiang, Math. Program. 106 (2006) 513-525), attained where D is 0
    or 1: every signed row sum is a ratio of functions affine in each D_i. `error_constant(jnp.eye(2))` is 1.
    """
    members = jnp.asarray(_all_subsets(_size(M, "error_constant")), M.dtype)
    one = jnp.eye(M.shape[0], dtype=M.dtype)
    return linalg.greatest(jax.vmap(lambda d: _norm_inf_of_inverse(one * (1 - d)[None, :] + d[:, None] * M))(members))


def _size(M: Array, name: str) -> int:
    m = M.shape[0]
    if M.shape != (m, m) or not 0 < m <= MOST_INDICES:
        raise ValueError(f"{name} takes one square matrix with 1 to {MOST_INDICES} rows, got shape {M.shape}")
    return m


def _all_subsets(m: int) -> np.ndarray:
    return np.array(list(itertools.product((1.0, 0.0), repeat=m)))


def _subsets(m: int) -> np.ndarray:
    """(2^m - 1, m) the non-empty subsets, as 0 and 1."""
    return _all_subsets(m)[:-1]


def _norm(M: Array) -> Array:
    return jnp.sqrt(jnp.sum(M * M))


def _restricted(M: Array, member: Array, outside: Array | float = 1.0) -> Array:
    """M_SS with `outside` on the diagonal of the other indices, which changes neither sign nor least value."""
    inside = (member[:, None] * member[None, :]) > 0
    return jnp.where(inside, M, jnp.eye(M.shape[0], dtype=M.dtype) * outside)


def _membership(of_vertex: Callable, members: np.ndarray, signs: np.ndarray, size: Array) -> Membership:
    """Are all determinants of `of_vertex(member, sign)` positive, beyond rounding of matrices of norm `size`?"""
    member, sign = jnp.asarray(members, size.dtype), jnp.asarray(signs, size.dtype)
    m = members.shape[1]

    def vertex(member, sign):
        X = of_vertex(member, sign)
        outside = jnp.diag(member) + size * jnp.diag(1 - member)
        X = X * jnp.diag(outside)[None, :]
        return jnp.linalg.slogdet(X)[0], jnp.linalg.svd(X, compute_uv=False)[-1]

    orientation, distance = jax.vmap(vertex)(member, sign)
    tolerance = ROUNDING * m * float(jnp.finfo(size.dtype).eps) * size
    certain = distance > tolerance
    broken = certain & (orientation < 0)
    no, yes = jnp.any(broken), jnp.all(certain & (orientation > 0))
    worst = jnp.argmax(jnp.where(broken, distance, -1.0))
    place = jnp.where(no, worst, jnp.argmin(distance))
    return Membership(
        verdict=verdict_of(yes, no),
        margin=jnp.where(no, -distance[place], distance[place]),
        members=member[place] > 0,
        signs=sign[place],
    )


def _by_value(value: Array, size: Array, members: Array) -> Membership:
    """A class that holds where `value`, right to rounding of `size`, is positive."""
    tolerance = ROUNDING * members.shape[0] * float(jnp.finfo(size.dtype).eps) * size
    verdict = verdict_of(value > tolerance, value < -tolerance)
    return Membership(verdict=verdict, margin=value, members=members, signs=jnp.ones(members.shape, size.dtype))


def verdict_of(yes: Array, no: Array) -> Array:
    known = jnp.where(yes, int(Verdict.YES), int(Verdict.UNDECIDED))
    return jnp.where(no, int(Verdict.NO), known).astype(jnp.int32)


def _inverse_norm(M: Array, member: Array, p: float) -> Array:
    """|(M_SS)^-1|_p, inf where singular."""
    if p == 2:
        return _reciprocal(jnp.linalg.svd(_restricted(M, member, _norm(M)), compute_uv=False)[-1])
    if p not in (1, np.inf):
        raise ValueError(f"beta takes p = 1, 2 or inf, got {p}")
    inverse = jnp.linalg.inv(_restricted(M, member)) * member[:, None] * member[None, :]
    sums = jnp.sum(abs(inverse), axis=0 if p == 1 else 1)
    return jnp.where(jnp.all(jnp.isfinite(sums)), linalg.greatest(sums), jnp.inf)


def _norm_inf_of_inverse(X: Array) -> Array:
    sums = jnp.sum(abs(jnp.linalg.inv(X)), axis=1)
    return jnp.where(jnp.all(jnp.isfinite(sums)), linalg.greatest(sums), jnp.inf)


def _reciprocal(x: Array) -> Array:
    return jnp.where(x > 0, 1 / jnp.where(x > 0, x, 1), jnp.inf)
