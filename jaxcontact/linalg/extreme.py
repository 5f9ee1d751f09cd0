"""Extreme singular values and vectors of one matrix by the way that fits its size; no derivatives yet.

Up to three columns closed forms; at four unrolled rotations; beyond, the library's decomposition. More rows than are
worth unrolling are first made triangular by the library. All matrices here have n >= m >= 1.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg import closed, rotations
from jaxcontact.linalg.unrolled import UNROLL_LIMIT, columns, largest, power_of_two_scale

Triple = tuple[jax.Array, jax.Array, jax.Array]


def value_max(X: jax.Array) -> jax.Array:
    """sigma_max of X (n, m)."""
    if not _unrolls(X):
        return jnp.linalg.svd(X, compute_uv=False)[0]
    X = X if X.shape[0] <= UNROLL_LIMIT else jnp.linalg.qr(X, mode="r")
    cols, scale = _scaled_columns(X)
    return scale * _method(X).max_value(cols)


def value_min(X: jax.Array) -> jax.Array:
    """sigma_min of X (n, m)."""
    if not _unrolls(X):
        return jnp.linalg.svd(X, compute_uv=False)[-1]
    X = X if X.shape[0] <= UNROLL_LIMIT else jnp.linalg.qr(X, mode="r")
    cols, scale = _scaled_columns(X)
    return scale * _method(X).min_value(cols)


def triple_max(X: jax.Array) -> Triple:
    """(u (n,), sigma, v (m,)) of the largest singular value."""
    return _triple(X, "max_triple", 0)


def triple_min(X: jax.Array) -> Triple:
    """(u (n,), sigma, v (m,)) of the smallest singular value."""
    return _triple(X, "min_triple", -1)


def _triple(X: jax.Array, name: str, place: int) -> Triple:
    if not _unrolls(X):
        U, s, Vt = jnp.linalg.svd(X, full_matrices=False)
        return U[:, place], s[place], Vt[place]
    if X.shape[0] > UNROLL_LIMIT:
        Q, R = jnp.linalg.qr(X)
        u, sigma, v = _triple(R, name, place)
        return jnp.dot(Q, u, precision=lax.Precision.HIGHEST), sigma, v
    cols, scale = _scaled_columns(X)
    u, sigma, v = getattr(_method(X), name)(cols)
    return jnp.stack(u), scale * sigma, jnp.stack(v)


def _unrolls(X: jax.Array) -> bool:
    return X.shape[1] <= rotations.COLUMNS


def _method(X: jax.Array):
    """The module whose values and triples treat this number of columns."""
    return closed if X.shape[1] <= closed.CLOSED_LIMIT else rotations


def _scaled_columns(X: jax.Array) -> tuple[list[list[jax.Array]], jax.Array]:
    """(columns of X / scale, scale), the scale a power of two near the largest entry, so that squares stay in range."""
    cols = columns(X)
    scale, inverse = power_of_two_scale(largest([lax.abs(x) for col in cols for x in col]))
    return [[lax.mul(x, inverse) for x in col] for col in cols], scale
