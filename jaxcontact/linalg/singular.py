"""Largest and smallest singular value of one matrix, with their vectors.

Derivatives: d sigma = u^T dX v with the unit vectors of the value. Where the value is repeated any pair of its
subspace is a generalised derivative of Clarke's, and one is returned; at sigma_min = 0, a kink, u^T dX v for null
vectors is one as well. None is NaN. The vectors have derivatives themselves, so second derivatives are right where the
value is simple.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg import extreme
from jaxcontact.linalg.decomposition import decomposition, perturbed_pair
from jaxcontact.linalg.unrolled import UNROLL_LIMIT, entries, inner

Triple = tuple[jax.Array, jax.Array, jax.Array]


def singular_value_max(X: jax.Array) -> jax.Array:
    """The largest singular value of X (n, m); 0 if X is empty.

    >>> singular_value_max(jnp.diag(jnp.array([1.0, 3.0])))  # 3
    """
    _check(X)
    if 0 in X.shape:
        return jnp.zeros((), X.dtype)
    return _value_max(_tall(X))


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


def singular_pair_max(X: jax.Array) -> Triple:
    """(u (n,), sigma, v (m,)), unit vectors with X v = sigma u for the largest singular value; n, m >= 1."""
    _check(X)
    if X.shape[0] < X.shape[1]:
        v, sigma, u = _triple_max(X.T)
        return u, sigma, v
    return _triple_max(X)


def singular_pair_min(X: jax.Array) -> Triple:
    """(u (n,), sigma, v (m,)), unit vectors with X v = sigma u for the smallest singular value, m >= 1.

    If n < m, sigma is 0 whatever X: then u is zero, so that u^T dX v is its derivative, and v a unit null vector.
    """
    _check(X)
    n, m = X.shape
    if n < m:
        v = _triple_min(jnp.concatenate([X, jnp.zeros((m - n, m), X.dtype)]))[2]
        return jnp.zeros(n, X.dtype), 0 * jnp.sum(X), v
    return _triple_min(X)


def _check(X: jax.Array) -> None:
    if X.ndim != 2:
        raise ValueError(f"expected one matrix of shape (n, m), got shape {X.shape}; map a batch with jax.vmap")


def _tall(X: jax.Array) -> jax.Array:
    return X if X.shape[0] >= X.shape[1] else X.T


_value_max = jax.custom_jvp(extreme.value_max)
_value_min = jax.custom_jvp(extreme.value_min)
_triple_max = jax.custom_jvp(extreme.triple_max)
_triple_min = jax.custom_jvp(extreme.triple_min)


@_value_max.defjvp
def _value_max_jvp(primals, tangents):
    u, value, v = _triple_max(*primals)
    return value, _bilinear(u, tangents[0], v)


@_value_min.defjvp
def _value_min_jvp(primals, tangents):
    u, value, v = _triple_min(*primals)
    return value, _bilinear(u, tangents[0], v)


@_triple_max.defjvp
def _triple_max_jvp(primals, tangents):
    triple = _triple_max(*primals)
    return triple, perturbed_pair(decomposition(*primals), triple, 0, tangents[0])


@_triple_min.defjvp
def _triple_min_jvp(primals, tangents):
    triple = _triple_min(*primals)
    return triple, perturbed_pair(decomposition(*primals), triple, primals[0].shape[1] - 1, tangents[0])


def _bilinear(u: jax.Array, D: jax.Array, v: jax.Array) -> jax.Array:
    """u^T D v, on scalars while small."""
    if max(D.shape) > UNROLL_LIMIT:
        return jnp.dot(u, jnp.dot(D, v, precision=lax.Precision.HIGHEST), precision=lax.Precision.HIGHEST)
    v_entries = list(v)
    return inner(list(u), [inner(row, v_entries) for row in entries(D)])
