"""Contacts eliminated from the others: Schur complements, taken on the factors."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from .delassus import Delassus, select, select_columns


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BilateralSchur:
    """The unilateral contact problem once the bilateral constraints are eliminated (section 2.3.2), frictionless."""

    A_c: Array
    """(m_u, m_u) constrained Delassus matrix (33), G_u^T M_c^-1 G_u."""
    w_c: Array
    """(m_u,) its free acceleration (34), with erratum A4."""
    P: Array | None
    """(n, n) I - G_b A_nb^-1 G_b^T M^-1 (20): it takes generalised forces to those the bilateral constraints do not
    resist."""
    Mc_inverse: Array | None
    """(n, n) M_c^-1 = M^-1 P, symmetric positive semi-definite."""


def without_frictionless_bilateral(operators: Delassus) -> Delassus:
    """The Delassus operators of the contacts that remain when the frictionless bilateral ones are eliminated.

    With Q the projection that removes span(N_0), the remaining factors are Q N and Q T, whose products are the Schur
    complements of section 3.2.3: A~_nb = A_mu - A_0mu^T A_00^-1 A_0mu, A~_tb alike, and w~ (errata A8 to A10). Taken on
    the factors they lose no digits where the contacts nearly depend on each other.

    `without_frictionless_bilateral(here).contacts`
    """
    contacts = operators.contacts
    gone = [i for i, contact in enumerate(contacts) if contact.bilateral and not contact.frictional]
    kept = [i for i in range(len(contacts)) if i not in gone]
    if not gone:
        return operators
    N0, N_kept = select_columns(operators.N, gone), select_columns(operators.N, kept)
    N = linalg.project_out(N0, N_kept)
    T = linalg.project_out(N0, select_columns(operators.T, kept))
    lam0 = linalg.solve(linalg.gram(N0, N0), select(operators.w, gone))
    w = select(operators.w, kept) - linalg.gram(linalg.gram(N0, N_kept), lam0[:, None])[:, 0]
    return replace(operators, N=N, T=T, w=w, terms=None, contacts=tuple(contacts[i] for i in kept))


def bilateral_schur(operators: Delassus) -> BilateralSchur:
    """A_c, w_c, P and M_c^-1 of section 2.3.2: all bilateral constraints eliminated, friction left aside.

    w_c = w_u - A_nbnu^T A_nb^-1 w_b, which is -G_u^T M_c^-1 F - A_nbnu^T A_nb^-1 c_b + c_u (erratum A4).

    `bilateral_schur(here).A_c`. P and M_c^-1 are None for operators built from matrices alone.
    """
    b, u = operators.bilateral, operators.unilateral
    Nb, Nu = select_columns(operators.N, b), select_columns(operators.N, u)
    Nc = linalg.project_out(Nb, Nu)
    lam = linalg.solve(operators.A_nb, select(operators.w, b))
    w_c = select(operators.w, u) - linalg.gram(operators.A_nbnu, lam[:, None])[:, 0]
    P, Mc_inverse = (None, None) if operators.L is None else _projection(operators.L, Nb)
    return BilateralSchur(A_c=linalg.gram(Nc, Nc), w_c=w_c, P=P, Mc_inverse=Mc_inverse)


def _projection(L: Array, Nb: Array) -> tuple[Array, Array]:
    """P = L Q L^-1 and M_c^-1 = L^-T Q L^-1 with Q the projection that removes span(N_b)."""
    Q_whitened = linalg.project_out(Nb, linalg.solve_lower(L, jnp.eye(L.shape[0], dtype=L.dtype)))
    return jnp.matmul(L, Q_whitened, precision=jax.lax.Precision.HIGHEST), linalg.solve_lower_transposed(L, Q_whitened)
