"""Largest and smallest singular value of one matrix, with their vectors."""

import jax
import jax.numpy as jnp

from jaxcontact.linalg.decomposition import decomposition
from jaxcontact.linalg.unrolled import columns, entries, inner

Pair = tuple[jax.Array, jax.Array, jax.Array]


def _check(X: jax.Array) -> None:
    if X.ndim != 2:
        raise ValueError(f"expected one matrix of shape (n, m), got shape {X.shape}; map a batch with jax.vmap")


def singular_value_max(X: jax.Array) -> jax.Array:
    """The largest singular value of X (n, m); 0 if X is empty.

    >>> singular_value_max(jnp.diag(jnp.array([1.0, 3.0])))  # 3
    """
    _check(X)
    if 0 in X.shape:
        return jnp.zeros((), X.dtype)
    return _value_max(X)


def singular_value_min(X: jax.Array) -> jax.Array:
    """The smallest of the m singular values of X (n, m): 0 if n < m (dependent columns), inf if m = 0.

    >>> singular_value_min(jnp.diag(jnp.array([1.0, 3.0])))  # 1
    """
    _check(X)
    n, m = X.shape
    if m == 0:
        return jnp.full((), jnp.inf, X.dtype)
    if n < m:
        return 0 * jnp.sum(X)
    return _value_min(X)


def singular_pair_max(X: jax.Array) -> Pair:
    """(u (n,), sigma, v (m,)), unit vectors with X v = sigma u for the largest singular value; n, m >= 1."""
    _check(X)
    if X.shape[0] < X.shape[1]:
        v, sigma, u = singular_pair_max(X.T)
        return u, sigma, v
    U, s, V = decomposition(X)
    return U[:, 0], s[0], V[:, 0]


def singular_pair_min(X: jax.Array) -> Pair:
    """(u (n,), sigma, v (m,)), unit vectors with X v = sigma u for the smallest singular value, m >= 1.

    If n < m, sigma is 0 whatever X: then u is zero, so that u^T dX v is its derivative, and v a unit null vector.
    """
    _check(X)
    n, m = X.shape
    if n < m:
        V = decomposition(jnp.concatenate([X, jnp.zeros((m - n, m), X.dtype)]))[2]
        return jnp.zeros(n, X.dtype), 0 * jnp.sum(X), V[:, -1]
    U, s, V = decomposition(X)
    return U[:, -1], s[-1], V[:, -1]


def _bilinear(u: jax.Array, D: jax.Array, v: jax.Array) -> jax.Array:
    """u^T D v, on scalars."""
    v_entries = list(v)
    return inner(list(u), [inner(row, v_entries) for row in entries(D)])


@jax.custom_jvp
def _value_max(X: jax.Array) -> jax.Array:
    return jnp.linalg.svd(X, compute_uv=False)[0]


@_value_max.defjvp
def _value_max_jvp(primals, tangents):
    """d sigma = u^T dX v; at a repeated value any pair of the subspace gives a Clarke generalised derivative."""
    u, _, v = singular_pair_max(primals[0])
    return _value_max(primals[0]), _bilinear(u, tangents[0], v)


@jax.custom_jvp
def _value_min(X: jax.Array) -> jax.Array:
    return jnp.linalg.svd(X, compute_uv=False)[-1]


@_value_min.defjvp
def _value_min_jvp(primals, tangents):
    """As for the largest; at sigma = 0, where sigma has a kink, u^T dX v is one of the derivatives +-|u^T dX v| around it."""
    u, _, v = singular_pair_min(primals[0])
    return _value_min(primals[0]), _bilinear(u, tangents[0], v)


def singular_values_jacobi(X: jax.Array) -> jax.Array:
    """All m singular values of X (n, m), n >= m, descending."""
    return decomposition(X)[1]
