"""The largest positive real eigenvalue of one general matrix."""

import jax
import jax.numpy as jnp
from jax import lax

REAL = 64
"""An eigenvalue counts as real when its imaginary part is below this many roundings of the matrix, times sqrt of it for pairs."""


def real_eigenvalue_max(X: jax.Array) -> jax.Array:
    """The largest positive real eigenvalue of X (m, m), 0 if there is none.

    >>> real_eigenvalue_max(jnp.array([[0.0, 2.0], [2.0, 0.0]]))  # 2
    """
    if X.shape[0] == 0:
        return jnp.zeros((), X.dtype)
    return _largest_real(X)


@jax.custom_jvp
def _largest_real(X: jax.Array) -> jax.Array:
    values = jnp.linalg.eigvals(X)
    size = REAL * float(jnp.finfo(X.dtype).eps) * jnp.linalg.norm(X)
    real = jnp.where(jnp.abs(values.imag) <= size, values.real, 0)
    return jnp.where(jnp.any(jnp.isnan(values.real)), jnp.nan, jnp.maximum(jnp.max(real), 0))


@_largest_real.defjvp
def _largest_real_jvp(primals, tangents):
    """d lambda = y^T dX x / (y^T x) with the null vectors x and y of X - lambda and its transpose."""
    (X,), (dX,) = primals, tangents
    value = _largest_real(X)
    U, _, Vt = jnp.linalg.svd(X - value * jnp.eye(X.shape[0], dtype=X.dtype))
    y, x = U[:, -1], Vt[-1]
    overlap = jnp.dot(y, x, precision=lax.Precision.HIGHEST)
    change = jnp.einsum("i,ij,j->", y, dX, x, precision=lax.Precision.HIGHEST)
    regular = (value > 0) & (overlap != 0)
    return value, jnp.where(regular, change / jnp.where(regular, overlap, 1), 0)
