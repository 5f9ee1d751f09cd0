"""Extreme eigenvalues of one symmetric matrix.

Derivatives as for singular values: x^T dS x with a unit eigenvector x, any of the eigenspace where the value is
repeated, and x differentiable in turn where it is simple.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg import symmetric_small
from jaxcontact.linalg.extrema import greatest
from jaxcontact.linalg.unrolled import entries, inner, largest, power_of_two_scale, total

CLOSED_LIMIT = 3
"""Largest size in closed form; the library's eigenvalues beyond."""

REPEATED = 16
"""Eigenvalues closer than this many roundings of the largest in magnitude count as repeated."""


def symmetric_eigenvalue_max(S: jax.Array) -> jax.Array:
    """The largest eigenvalue of the symmetric part of S (m, m), -inf for m = 0.

    >>> symmetric_eigenvalue_max(jnp.array([[0.0, 1.0], [1.0, 0.0]]))  # 1
    """
    if S.ndim != 2 or S.shape[0] != S.shape[1]:
        raise ValueError(f"expected one square matrix (m, m), got shape {S.shape}; map a batch with jax.vmap")
    if S.shape[0] == 0:
        return jnp.full((), -jnp.inf, S.dtype)
    return _top(0.5 * (S + S.T))


def symmetric_eigenvalue_min(S: jax.Array) -> jax.Array:
    """The smallest eigenvalue of the symmetric part of S (m, m), inf for m = 0."""
    return -symmetric_eigenvalue_max(-S)


@jax.custom_jvp
def _top(S: jax.Array) -> jax.Array:
    if S.shape[0] > CLOSED_LIMIT:
        return jnp.linalg.eigvalsh(S)[-1]
    rows, scale = _scaled_rows(S)
    return scale * symmetric_small.top_value(rows)


@jax.custom_jvp
def _top_vector(S: jax.Array) -> jax.Array:
    if S.shape[0] > CLOSED_LIMIT:
        return jnp.linalg.eigh(S)[1][:, -1]
    return jnp.stack(symmetric_small.top_vector(_scaled_rows(S)[0]))


@_top.defjvp
def _top_jvp(primals, tangents):
    x = list(_top_vector(*primals))
    return _top(*primals), total([x_i * inner(row, x) for x_i, row in zip(x, entries(tangents[0]))])


@_top_vector.defjvp
def _top_vector_jvp(primals, tangents):
    """dx = sum over j of x_j (x_j^T dS x) / (lambda - lambda_j), without the terms whose eigenvalue is that of x."""
    (S,), (dS,) = primals, tangents
    x = _top_vector(S)
    values, X = jnp.linalg.eigh(S)
    gap = values[-1] - values
    separated = gap > REPEATED * float(jnp.finfo(S.dtype).eps) * greatest(lax.abs(values))
    share = jnp.einsum("ij,ik,k->j", X, dS, x, precision=lax.Precision.HIGHEST)
    share = jnp.where(separated, share / jnp.where(separated, gap, 1), 0)
    return x, jnp.dot(X, share, precision=lax.Precision.HIGHEST)


def _scaled_rows(S: jax.Array) -> tuple[list[list[jax.Array]], jax.Array]:
    rows = entries(S)
    scale, inverse = power_of_two_scale(largest([lax.abs(x) for row in rows for x in row]))
    return [[x * inverse for x in row] for row in rows], scale
