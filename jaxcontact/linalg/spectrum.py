"""The largest positive real eigenvalue of one general matrix.

Derivative: d lambda = y^T dX x / (y^T x) with the left and right eigenvectors. Where the eigenvalue is defective, y^T
x = 0, it has none (it moves like a square root) and 0 is returned; where it is semisimple and repeated, the value for
one pair of vectors.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.compensated import det2
from jaxcontact.linalg.extrema import greatest
from jaxcontact.linalg.singular import singular_pair_min
from jaxcontact.linalg.tracing import where
from jaxcontact.linalg.unrolled import inner, largest, power_of_two_scale, shield

REAL = 64
"""For m >= 3 an eigenvalue counts as real when its imaginary part is within this many roundings of the norm."""


def real_eigenvalue_max(X: jax.Array) -> jax.Array:
    """The largest positive real eigenvalue of X (m, m), 0 if there is none.

    For m <= 2 in closed form: the eigenvalues are real when the discriminant, in compensated arithmetic, is not
    negative. For m >= 3 by `jnp.linalg.eigvals`, which JAX has on CPU, and on GPU only in some builds: eigenvalues
    that LAPACK returns as a complex pair with an imaginary part of rounding size count as real.

    >>> real_eigenvalue_max(jnp.array([[0.0, 2.0], [2.0, 0.0]]))  # 2
    """
    if X.ndim != 2 or X.shape[0] != X.shape[1]:
        raise ValueError(f"expected one square matrix (m, m), got shape {X.shape}; map a batch with jax.vmap")
    if X.shape[0] == 0:
        return jnp.zeros((), X.dtype)
    return _largest(X)


@jax.custom_jvp
def _largest(X: jax.Array) -> jax.Array:
    if X.shape[0] == 1:
        return lax.max(X[0, 0], jnp.zeros_like(X[0, 0]))
    return _largest_of_two(X) if X.shape[0] == 2 else _largest_of_many(X)


def _largest_of_two(X: jax.Array) -> jax.Array:
    """The larger root of lambda^2 - (a + d) lambda + det, by whichever of its two forms does not cancel."""
    a, b, c, d = X[0, 0], X[0, 1], X[1, 0], X[1, 1]
    scale, inverse = power_of_two_scale(largest([lax.abs(x) for x in (a, b, c, d)]))
    a, b, c, d = (x * inverse for x in (a, b, c, d))
    mean, half = 0.5 * (a + d), 0.5 * (a - d)
    discriminant = det2(half, -b, c, half)
    real = ~(discriminant < 0)
    root = shield(lax.sqrt(where(real, discriminant, 0)))
    rising = ~(mean < 0)
    below = where(rising, -1, mean - root)
    value = where(rising, mean + root, det2(a, b, c, d) / below)
    return scale * lax.max(where(real, value, 0), jnp.zeros_like(value))


def _largest_of_many(X: jax.Array) -> jax.Array:
    values = jnp.linalg.eigvals(X)
    size = REAL * float(jnp.finfo(X.dtype).eps) * jnp.linalg.norm(X)
    positive = (lax.abs(values.imag) <= size) & (values.real > 0)
    largest_value = greatest(where(positive, values.real, 0))
    return where(jnp.any(jnp.isnan(X)), jnp.nan, largest_value)


@_largest.defjvp
def _largest_jvp(primals, tangents):
    (X,), (dX,) = primals, tangents
    value = _largest(X)
    if X.shape[0] <= 2:
        return value, _change_small(X, value, dX)
    y, _, x = singular_pair_min(X - value * jnp.eye(X.shape[0], dtype=X.dtype))
    overlap = jnp.dot(y, x, precision=lax.Precision.HIGHEST)
    change = jnp.einsum("i,ij,j->", y, dX, x, precision=lax.Precision.HIGHEST)
    regular = (value > 0) & (overlap != 0)
    return value, where(regular, change / where(regular, overlap, 1), 0)


def _change_small(X: jax.Array, value: jax.Array, dX: jax.Array) -> jax.Array:
    """The same by cofactors: x y^T / (y^T x) = adj(lambda - X) / trace; half the trace of dX at a double eigenvalue."""
    if X.shape[0] == 1:
        return where(value > 0, dX[0, 0], 0)
    adjugate = [value - X[1, 1], X[0, 1], X[1, 0], value - X[0, 0]]
    trace = adjugate[0] + adjugate[3]
    change = inner(adjugate, [dX[0, 0], dX[1, 0], dX[0, 1], dX[1, 1]])
    simple = trace > 0
    change = where(simple, change / where(simple, trace, 1), 0.5 * (dX[0, 0] + dX[1, 1]))
    return where(value > 0, change, 0)
