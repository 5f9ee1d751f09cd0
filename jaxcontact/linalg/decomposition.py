"""The thin singular value decomposition of one matrix, with a derivative that stays finite at repeated values."""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg import extreme

REPEATED = 16
"""Singular values closer than this many roundings of the largest count as repeated, or as zero."""

Triple = tuple[jax.Array, jax.Array, jax.Array]


def _matmul(A: jax.Array, B: jax.Array) -> jax.Array:
    return jnp.matmul(A, B, precision=lax.Precision.HIGHEST)


@jax.custom_jvp
def decomposition(X: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """(U (n, m), s (m,), V (m, m)) with X = U diag(s) V^T, n >= m, s descending; in closed form for m <= 2.

    >>> decomposition(jnp.diag(jnp.array([1.0, 3.0])))[1]  # [3, 1]
    """
    if X.shape[1] not in (1, 2):
        U, s, Vt = jnp.linalg.svd(X, full_matrices=False)
        return U, s, Vt.T
    triples = [extreme.triple_max(X), extreme.triple_min(X)][: X.shape[1]]
    U, s, V = (jnp.stack(parts, axis=-1) for parts in zip(*triples, strict=True))
    return U, s, V


@decomposition.defjvp
def _decomposition_jvp(primals, tangents):
    """Every pair of vectors as in `perturbed_pair`; d sigma_k = u_k^T dX v_k."""
    U, s, V = svd = decomposition(*primals)
    moved = [perturbed_pair(svd, (U[:, k], s[k], V[:, k]), k, tangents[0]) for k in range(V.shape[0])]
    if not moved:
        return svd, (jnp.zeros_like(U), jnp.zeros_like(s), jnp.zeros_like(V))
    dU, ds, dV = (jnp.stack(parts, axis=-1) for parts in zip(*moved, strict=True))
    return svd, (dU, ds, dV)


def perturbed_pair(svd: Triple, triple: Triple, k: int, dX: jax.Array) -> Triple:
    """Derivatives (du, d sigma, dv) of the k-th singular triple (u, sigma, v) of X = U diag(s) V^T in the direction dX.

    From X v = sigma u and X^T u = sigma v, with a = dX v and b = dX^T u, for j other than k,

        u_j^T du (sigma^2 - s_j^2) = sigma u_j^T a + s_j v_j^T b
        v_j^T dv (sigma^2 - s_j^2) = s_j u_j^T a + sigma v_j^T b
        sigma (1 - U U^T) du = (1 - U U^T) a

    and d sigma = u^T a; u^T du = v^T dv = 0. The signs of u_j and v_j do not matter. Where s_j = sigma, or sigma = 0,
    the vectors have no derivative: the term is left out.
    """
    U, s, V = svd
    u, sigma, v = triple
    a, b = _matmul(dX, v), _matmul(dX.T, u)
    Ua, Vb = _matmul(U.T, a), _matmul(V.T, b)
    tiny = REPEATED * float(jnp.finfo(s.dtype).eps) * s[0]
    separated = (lax.abs(sigma - s) > tiny) & (jnp.arange(s.size) != k)
    inverse_gap = _reciprocal_where(separated, (sigma - s) * (sigma + s))
    du = _matmul(U, inverse_gap * (sigma * Ua + s * Vb))
    dv = _matmul(V, inverse_gap * (s * Ua + sigma * Vb))
    if U.shape[0] > U.shape[1]:
        du = du + (a - _matmul(U, Ua)) * _reciprocal_where(sigma > tiny, sigma)
    return du, jnp.dot(u, a, precision=lax.Precision.HIGHEST), dv


def _reciprocal_where(defined: jax.Array, x: jax.Array) -> jax.Array:
    """1 / x where defined, else 0."""
    return jnp.where(defined, 1 / jnp.where(defined, x, 1), 0)
