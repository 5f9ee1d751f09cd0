"""Orthonormal bases of a few columns of scalars: Gram-Schmidt with compensated projections, and reflections."""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.compensated import two_product
from jaxcontact.linalg.tracing import where
from jaxcontact.linalg.unrolled import Scalar, inner, shield

Column = list[Scalar]


def reciprocal_square(q: Column, noise: Scalar | float = 0.0) -> Scalar:
    """1 / |q|^2, or 0 where |q|^2 is not above `noise`, so that nothing is then projected on q."""
    size = inner(q, q)
    nothing = size <= noise
    return shield(where(nothing, 0, 1 / where(nothing, 1, size)))


def remove(q: Column, weight: Scalar, x: Column) -> tuple[Scalar, Column]:
    """(t, x - t q) with t = q^T x weight, weight = 1 / |q|^2.

    Any t near the quotient serves, as long as x - t q is then formed without error: the compensated product sees to
    that. The second pass removes the component along q that the rounding of t leaves.
    """
    first = shield(inner(q, x) * weight)
    products = [two_product(first, q_i) for q_i in q]
    r = [(x_i - p) - e for x_i, (p, e) in zip(x, products, strict=True)]
    second = shield(inner(q, r) * weight)
    return first + second, [r_i - second * q_i for r_i, q_i in zip(r, q, strict=True)]


def triangularise(cols: list[Column]) -> tuple[list[Column], list[Column]]:
    """(E, R): m columns as E R, with E of orthonormal columns and R (m, m) upper triangular, as a list of rows.

    A column that depends on the earlier ones leaves a zero in the diagonal of R and a zero column in E.
    """
    zero = jnp.zeros_like(cols[0][0])
    m = len(cols)
    rest, E, R = list(cols), [], []
    for i in range(m):
        q, rest = rest[0], rest[1:]
        weight = reciprocal_square(q)
        length = shield(lax.sqrt(inner(q, q)))
        removed = [remove(q, weight, x) for x in rest]
        rest = [x for _, x in removed]
        R.append([zero] * i + [length] + [t * length for t, _ in removed])
        scale = shield(weight * length)
        E.append([q_k * scale for q_k in q])
    return E, R


def completed(E: list[Column], present: list[jax.Array]) -> list[Column]:
    """The orthonormal columns E with those not `present`, zero on entry, replaced by unit normals to the rest."""
    if len(E) == 2:
        known = [where(present[0], x, y) for x, y in zip(*E, strict=True)]
        normal = unit_normal([known], known)
        return [[where(there, e, x) for e, x in zip(E[i], normal)] for i, there in enumerate(present)]
    E = list(E)
    for i, there in enumerate(present):
        normal = unit_normal(E[:i] + E[i + 1 :], E[i])
        E[i] = [where(there, e, x) for e, x in zip(E[i], normal, strict=True)]
    return E


def unit_normal(E: list[Column], like: Column) -> Column:
    """A unit vector normal to the orthonormal or zero columns E, fewer than their length; shaped `like` a column.

    Reflections H_1 ... H_k turn the columns one by one into the first k coordinate axes (Householder), so that what
    they turn into the next axis, H_1 ... H_k axis, is normal to all: no selection, no division by anything small.
    """
    reflections: list[tuple[Column, Scalar]] = []
    for i, e in enumerate(E):
        for w, weight in reflections:
            e = _reflected(w, weight, e)
        away = where(e[i] >= 0, 1, -1).astype(e[i].dtype)
        w = [*zeros(e[:i]), e[i] + away, *e[i + 1 :]]
        reflections.append((w, shield(2 / inner(w[i:], w[i:]))))
    axis = zeros(like)
    axis[len(E)] = jnp.ones_like(like[0])
    for w, weight in reversed(reflections):
        axis = _reflected(w, weight, axis)
    return axis


Reflection = tuple[Column, Scalar]
"""(w, weight): x - w (w^T x) weight, for w with zeros in front left out."""


def triangular(cols: list[Column]) -> tuple[list[Column], list[Reflection]]:
    """(R (m, m) upper triangular, by rows, the reflections) of m columns of n >= m (Householder).

    The reflections are orthogonal to rounding whatever the columns; a column that depends on the earlier ones leaves a
    zero, or what is rounded, in the diagonal of R.
    """
    rest, R, reflections = [list(col) for col in cols], [], []
    zero = jnp.zeros_like(cols[0][0])
    for i in range(len(cols)):
        q, rest = rest[0], rest[1:]
        length = shield(lax.sqrt(inner(q, q)))
        turned = where(q[0] >= 0, -length, length)
        w = [q[0] - turned, *q[1:]]
        half_square = length * (length + lax.abs(q[0]))
        nothing = half_square == 0
        weight = shield(where(nothing, 0, 1 / where(nothing, 1, half_square)))
        rest = [_reflected(w, weight, x) for x in rest]
        reflections.append((w, weight))
        R.append([zero] * i + [turned] + [x[0] for x in rest])
        rest = [x[1:] for x in rest]
    return R, reflections


def turned_back(reflections: list[Reflection], x: Column) -> Column:
    """The vector that the reflections of `triangular`, in their order, turn into x."""
    for i, (w, weight) in reversed(list(enumerate(reflections))):
        x = x[:i] + _reflected(w, weight, x[i:])
    return x


def _reflected(w: Column, weight: Scalar, x: Column) -> Column:
    """x - w (w^T x) weight, weight = 2 / |w|^2."""
    along = inner(w, x) * weight
    return [x_i - along * w_i for x_i, w_i in zip(x, w, strict=True)]


def zeros(x: Column) -> Column:
    """A zero column like x."""
    return [jnp.zeros_like(x_i) for x_i in x]


def normalised(x: Column, otherwise: Column) -> Column:
    """x / |x|, or `otherwise` where x is zero."""
    size = inner(x, x)
    nothing = size == 0
    scale = shield(lax.rsqrt(where(nothing, 1, size)))
    return [where(nothing, y, x_i * scale) for x_i, y in zip(x, otherwise, strict=True)]
