"""The thin singular value decomposition of one matrix, with a derivative that stays finite at repeated values."""

import jax
import jax.numpy as jnp
from jax import lax

REPEATED = 16
"""Singular values closer than this many roundings of the largest count as repeated: their vectors are any orthonormal pair."""


def _matmul(A: jax.Array, B: jax.Array) -> jax.Array:
    return jnp.matmul(A, B, precision=lax.Precision.HIGHEST)


@jax.custom_jvp
def decomposition(X: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """(U (n, m), s (m,), V (m, m)) with X = U diag(s) V^T, n >= m, s descending, by LAPACK's or the device's routine.

    >>> decomposition(jnp.diag(jnp.array([1.0, 3.0])))[1]  # [3, 1]
    """
    U, s, Vt = jnp.linalg.svd(X, full_matrices=False)
    return U, s, Vt.T


@decomposition.defjvp
def _decomposition_jvp(primals, tangents):
    """First-order perturbation, in the basis of the factors: with P = U^T dX V,

        ds_k      = P_kk
        (V^T dV)_jk = (s_j P_jk + s_k P_kj) / (s_k^2 - s_j^2)
        (U^T dU)_jk = (s_k P_jk + s_j P_kj) / (s_k^2 - s_j^2)
        (I - U U^T) dU = (I - U U^T) dX V diag(1 / s).

    (Golub & Van Loan, Matrix Computations, section 8.6; the two unknowns of each pair j, k are solved together.) Where s_j = s_k,
    or s_k = 0, the vectors have no derivative: those terms are left out, which keeps one pair of the subspace.
    """
    (X,), (dX,) = primals, tangents
    U, s, V = decomposition(X)
    P = _matmul(U.T, _matmul(dX, V))
    sj, sk = s[:, None], s[None, :]
    tiny = REPEATED * float(jnp.finfo(s.dtype).eps) * s[0]
    separated = jnp.abs(sk - sj) > tiny
    gap = (sk - sj) * (sk + sj)
    inverse_gap = jnp.where(separated, 1 / jnp.where(separated, gap, 1), 0)
    dV = _matmul(V, inverse_gap * (sj * P + sk * P.T))
    dU = _matmul(U, inverse_gap * (sk * P + sj * P.T))
    if X.shape[0] > X.shape[1]:
        outside = _matmul(dX, V) - _matmul(U, P)
        inverse = jnp.where(s > tiny, 1 / jnp.where(s > tiny, s, 1), 0)
        dU = dU + outside * inverse[None, :]
    return (U, s, V), (dU, jnp.diagonal(P), dV)
