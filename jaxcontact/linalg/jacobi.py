"""Singular values by one-sided Jacobi rotations: plane rotations of the columns until they are orthogonal.

The relative accuracy is that of the matrix with its columns scaled to unit length, however badly they are scaled
(Demmel & Veselic, SIAM J. Matrix Anal. Appl. 13 (1992) 1204), where bidiagonalisation loses the small values of graded
columns.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.linalg.extrema import greatest
from jaxcontact.linalg.unrolled import power_of_two_scale, shield

SWEEPS_IN_ROUNDS = 14
"""Sweeps over all pairs of columns; enough to 16 columns of condition 1e12, and to 32 of moderate condition."""


@jax.custom_jvp
def singular_values_jacobi(X: jax.Array) -> jax.Array:
    """All m singular values of X (n, m), n >= m, descending, each as accurate as the scaling of the columns allows.

    Where a value is zero its derivative is 0, an element of Clarke's derivative of the kink there.

    >>> singular_values_jacobi(jnp.diag(jnp.array([1e-100, 3.0])))  # [3, 1e-100]
    """
    _check(X)
    return _decompose(X)[1]


@singular_values_jacobi.defjvp
def _singular_values_jacobi_jvp(primals, tangents):
    """d sigma_k = u_k^T dX v_k, u_k = W_k / sigma_k."""
    U, s, V = _decompose(*primals)
    dX = tangents[0]
    if 0 in dX.shape:
        return s, jnp.zeros_like(s)
    return s, jnp.sum(U * jnp.matmul(dX, V, precision=lax.Precision.HIGHEST), axis=0)


def _decompose(X: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """(U, s, V) descending; the columns of U whose value is zero are zero."""
    n, m = X.shape
    if 0 in X.shape:
        return X, jnp.zeros(m, X.dtype), jnp.eye(m, dtype=X.dtype)
    scale, inverse = power_of_two_scale(greatest(lax.abs(X)))
    X = X * inverse
    order = jnp.argsort(-jnp.sum(X * X, axis=0))
    stacked = _rounds(jnp.concatenate([X, jnp.eye(m, dtype=X.dtype)])[:, order], n)
    s = lax.sqrt(jnp.sum(stacked[:n] * stacked[:n], axis=0))
    order = jnp.argsort(-s)
    s, W, V = s[order], stacked[:n, order], stacked[n:, order]
    U = W / jnp.where(s == 0, 1, s)[None, :]
    return U, s * scale, V


def _check(X: jax.Array) -> None:
    if X.ndim != 2 or X.shape[0] < X.shape[1]:
        raise ValueError(f"expected one matrix (n, m) with n >= m, got shape {X.shape}; transpose a wide one")


def _rotation(aa: jax.Array, ab: jax.Array, bb: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(cos, sin) of the smaller angle that makes (c a - s b) and (s a + c b) orthogonal; (1, 0) where they are already.

    With x = bb - aa and y = 2 ab, tan = y sign(x) / (|x| + sqrt(x^2 + y^2)). Both are taken relative to aa + bb, whose
    squares could underflow for small columns.
    """
    size = aa + bb
    inverse = shield(1 / jnp.where(size == 0, 1, size))
    x, y = (bb - aa) * inverse, 2 * ab * inverse
    bottom = lax.abs(x) + lax.sqrt(x * x + y * y)
    t = shield(jnp.where(x < 0, -y, y) / jnp.where(bottom == 0, 1, bottom))
    c = shield(lax.rsqrt(1 + t * t))
    return c, c * t


def _rounds(A: jax.Array, n: int) -> jax.Array:
    """Sweeps in the tournament order, floor(m / 2) disjoint pairs at a time; a zero column makes the number even."""
    m = A.shape[1]
    even = m + m % 2
    A = jnp.pad(A, ((0, 0), (0, even - m)))
    half = even // 2

    def turn(_, A):
        a, b = A[:, :half], A[:, half:]
        aa, ab, bb = jnp.sum(a[:n] * a[:n], 0), jnp.sum(a[:n] * b[:n], 0), jnp.sum(b[:n] * b[:n], 0)
        c, s = (r[None, :] for r in _rotation(aa, ab, bb))
        a, b = c * a - s * b, s * a + c * b
        if half == 1:
            return jnp.concatenate([a, b], axis=1)
        # The first column stays, all others move on by one place: down the left half, back along the right.
        left = jnp.concatenate([a[:, :1], b[:, :1], a[:, 1:-1]], axis=1)
        right = jnp.concatenate([b[:, 1:], a[:, -1:]], axis=1)
        return jnp.concatenate([left, right], axis=1)

    # After even - 1 turns every pair has met once and all columns are back in place.
    return lax.fori_loop(0, SWEEPS_IN_ROUNDS * (even - 1), turn, A)[:, :m]
