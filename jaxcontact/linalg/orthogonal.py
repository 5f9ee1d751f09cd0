"""Gram-Schmidt on a few columns of scalars, with the rounding errors of each first projection carried along."""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.compensated import two_product
from jaxcontact.linalg.unrolled import Scalar, inner, largest, shield, total

Column = list[Scalar]


def reciprocal_square(q: Column, noise: Scalar | float = 0.0) -> Scalar:
    """1 / |q|^2, or 0 where |q|^2 is not above `noise`, so that nothing is then projected on q."""
    size = inner(q, q)
    nothing = size <= noise
    return shield(jnp.where(nothing, 0, 1 / jnp.where(nothing, 1, size)))


def remove(q: Column, weight: Scalar, x: Column) -> tuple[Scalar, Column]:
    """(t, x - t q) with t = q^T x weight, weight = 1 / |q|^2.

    Any t near the quotient serves, as long as x - t q is then formed without error: the compensated product sees to that. The
    second pass removes the component along q that the rounding of t leaves.
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
        length = shield(jnp.sqrt(inner(q, q)))
        removed = [remove(q, weight, x) for x in rest]
        rest = [x for _, x in removed]
        R.append([zero] * i + [length] + [t * length for t, _ in removed])
        scale = shield(weight * length)
        E.append([q_k * scale for q_k in q])
    return E, R


def completed(E: list[Column], present: list[jax.Array]) -> list[Column]:
    """Orthonormal columns where those not `present` (zero columns on entry) are replaced by unit vectors normal to the rest."""
    E = list(E)
    for i, there in enumerate(present):
        normal = unit_normal(E[:i] + E[i + 1 :], E[i])
        E[i] = [jnp.where(there, e, x) for e, x in zip(E[i], normal, strict=True)]
    return E


def unit_normal(E: list[Column], like: Column) -> Column:
    """A unit vector normal to the columns E, fewer than their length, each of length 1 or 0; shaped `like` one column.

    It is what is left of the coordinate axis farthest from their span: at least 1 / n of its squared length.
    """
    one = jnp.ones_like(like[0])
    left = [one - total([e[k] * e[k] for e in E]) if E else one for k in range(len(like))]
    axis = _first_equal(left, largest(left))
    shares = [inner(axis, e) for e in E]
    x = [axis_k - total([s * e[k] for s, e in zip(shares, E)]) if E else axis_k for k, axis_k in enumerate(axis)]
    scale = shield(lax.rsqrt(inner(x, x)))
    return [x_k * scale for x_k in x]


def _first_equal(values: Column, value: Scalar) -> Column:
    """The unit vector of the first entry equal to `value`, by selections."""
    unit, found = [], jnp.zeros((), bool)
    for x in values:
        here = (x == value) & ~found
        unit.append(jnp.where(here, jnp.ones_like(x), jnp.zeros_like(x)))
        found = found | here
    return unit


def zeros(x: Column) -> Column:
    """A zero column like x."""
    return [jnp.zeros_like(x_i) for x_i in x]


def normalised(x: Column, otherwise: Column) -> Column:
    """x / |x|, or `otherwise` where x is zero."""
    size = inner(x, x)
    nothing = size == 0
    scale = shield(lax.rsqrt(jnp.where(nothing, 1, size)))
    return [jnp.where(nothing, y, x_i * scale) for x_i, y in zip(x, otherwise, strict=True)]
