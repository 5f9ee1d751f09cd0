"""Extreme eigenvalues of one symmetric matrix."""

import jax
import jax.numpy as jnp
from jax import lax


def symmetric_eigenvalue_max(S: jax.Array) -> jax.Array:
    """The largest eigenvalue of the symmetric matrix S (m, m), -inf for m = 0.

    >>> symmetric_eigenvalue_max(jnp.array([[0.0, 1.0], [1.0, 0.0]]))  # 1
    """
    if S.shape[0] == 0:
        return jnp.full((), -jnp.inf, S.dtype)
    return _largest(S)


def symmetric_eigenvalue_min(S: jax.Array) -> jax.Array:
    """The smallest eigenvalue of the symmetric matrix S (m, m), inf for m = 0."""
    return -symmetric_eigenvalue_max(-S)


@jax.custom_jvp
def _largest(S: jax.Array) -> jax.Array:
    return jnp.linalg.eigvalsh(S)[-1]


@_largest.defjvp
def _largest_jvp(primals, tangents):
    """d lambda = x^T dS x."""
    (S,), (dS,) = primals, tangents
    x = jnp.linalg.eigh(S)[1][:, -1]
    return _largest(S), jnp.einsum("i,ij,j->", x, dS, x, precision=lax.Precision.HIGHEST)
