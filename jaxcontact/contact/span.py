"""Columns that may depend on one another: the space they span, and coefficients of least norm."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..linalg.orthogonal import reciprocal_square, remove, zeros
from ..linalg.unrolled import UNROLL_LIMIT, Scalar, columns, from_columns, inner, shield

DEPENDENCE = 64
"""A column depends on the earlier ones when less than DEPENDENCE n eps of its length is left."""

Column = list[Scalar]


class Span(NamedTuple):
    """The span of k columns X (n, k): the orthogonal projection on it is `basis @ onto`."""

    basis: Array
    """(n, k) columns that span it; zero columns stand for dependent ones."""
    onto: Array
    """(k, n) takes a vector to its coefficients in the basis."""
    pseudo_inverse: Array
    """(k, n) X^+: it takes a vector to the coefficients of least norm of its projection."""
    deficient: Array
    """bool: some column depends on the others."""


def span_of(X: Array) -> Span:
    """The `Span` of the columns of X (n, k), by a complete orthogonal decomposition X = E R, R^T = E_2 R_2.

    X^+ = E_2 R_2^-T E^T (Golub & Van Loan, Matrix Computations, 5.5.2). Columns are orthogonalised with compensated
    products; dependent ones are left out, so derivatives hold as long as they stay dependent.

    >>> span_of(jnp.ones((3, 2))).pseudo_inverse     # all entries 1/6
    """
    n, k = X.shape
    if k == 0:
        return Span(X, X.T, X.T, jnp.zeros((), bool))
    if max(n, k) > UNROLL_LIMIT:
        return _span_of_many(X)
    E, R, there = _triangularised(columns(X), dependence(n, X.dtype))
    E2, R2, _ = _triangularised(R, 0.0)
    inverse = [_substituted(R2, [e[i] for e in E]) for i in range(n)]
    pinv = [[inner([e[i] for e in E2], v) for i in range(k)] for v in inverse]
    basis = from_columns(E, n, X.dtype)
    return Span(basis, basis.T, from_columns(pinv, k, X.dtype), ~jnp.stack(there).all())


def off_span(span: Span, X: Array) -> Array:
    """X (n, r) minus its projection on the span, taken twice; columns that lie in it up to rounding become zero."""
    if 0 in X.shape or span.basis.shape[1] == 0:
        return X
    rest = X
    for _ in range(2):
        rest = rest - linalg.gram(span.basis.T, linalg.gram(span.onto.T, rest))
    gone = inside(rest, X)
    return linalg.where(gone[None, :], 0, rest)


def inside(rest: Array, X: Array) -> Array:
    """(r,) bool: what is left of a column, (n, r), is its rounding."""
    noise = dependence(X.shape[0], X.dtype)
    return jnp.sum(rest * rest, axis=0) <= noise**2 * jnp.sum(X * X, axis=0)


def dependence(n: int, dtype) -> float:
    """Share of a column of n entries below which what is left of it is rounding."""
    return DEPENDENCE * n * float(jnp.finfo(dtype).eps)


def _span_of_many(X: Array) -> Span:
    """The library's way for large sizes; its derivative too is that of constant rank."""
    noise = dependence(X.shape[0], X.dtype)
    pinv = jnp.linalg.pinv(X, rtol=noise)
    rank = jnp.linalg.matrix_rank(X, rtol=noise)
    return Span(X, pinv, pinv, rank < X.shape[1])


def _triangularised(cols: list[Column], noise: float) -> tuple[list[Column], list[Column], list[Scalar]]:
    """(E, R^T by columns, there): columns E R with E orthonormal, dependent columns zero in E and in R's rows."""
    limits = [inner(q, q) * (noise * noise) for q in cols]
    rest, E, rows, present = list(cols), [], [], []
    for i, limit in enumerate(limits):
        q, rest = rest[0], rest[1:]
        size = inner(q, q)
        there = size > limit
        weight = reciprocal_square(q, limit)
        length = linalg.where(there, shield(lax.sqrt(linalg.where(there, size, 1))), 0)
        removed = [remove(q, weight, x) for x in rest]
        rest = [x for _, x in removed]
        rows.append([jnp.zeros_like(size)] * i + [length] + [t * length for t, _ in removed])
        E.append([q_k * (weight * length) for q_k in q])
        present.append(there)
    return E, rows, present


def _substituted(R2: list[Column], b: Column) -> Column:
    """v with R_2^T v = b, forward; v_i = 0 where the diagonal is zero."""
    v = zeros(b)
    for i in range(len(b)):
        there = R2[i][i] > 0
        rest = b[i]
        for j in range(i):
            rest = rest - R2[j][i] * v[j]
        v[i] = linalg.where(there, rest / linalg.where(there, R2[i][i], 1), 0)
    return v
