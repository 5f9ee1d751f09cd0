"""Proposition 14: mixed frictional contacts as a perturbation of the frictionless complementarity problem."""

import itertools
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .. import linalg
from ..dynamics import Delassus
from ..dynamics.delassus import select, select_columns
from .coupling import coupling
from .norm_ratio import norm_ratio_of_factors
from .propositions import _bilateral_all_frictional, proposition

SCAN_POINTS = 256
"""Points at which the first crossing is looked for before it is bisected; a dip between two of them goes unseen."""

AROUND = 1024.0
"""The scan begins this factor below the crossing of the linear part, and, without a cap, ends as far above."""


@proposition(_bilateral_all_frictional)
def prop14(operators: Delassus, ratio: Array, xi: Array | None = None) -> Array:
    """Proposition 14: the first r with |P_mu|_2 beta_2(M_ub^0) = 1 along mu = r * ratio, capped by the bilateral bound.

    Hypothesis: M and A_nb positive definite, independent gaps, frictional bilateral contacts. Guarantee: M_ub^mu of
    (62) is a P-matrix, so forces and accelerations exist and are unique, for the signs `xi` of sliding; with xi None
    the least over all signs. Load class: any. P_mu by (64) to (67) with errata A14 to A16; beta_2 at its vertices,
    which is exact. It depends on the unit of mass, since M_ub^0 mixes 1 and 1/mass: `direct` does not, and neither
    dominates the other.

    `prop14(delassus(rod, rod.state(theta=0.9)), xi=jnp.array([1.0, -1.0]))`

    Cost: 2^m_u norms for beta_2, and 2^k scans for the k frictional contacts when xi is None.
    """
    bilateral = Delassus(
        N=select_columns(operators.N, operators.bilateral),
        T=select_columns(operators.T, operators.bilateral),
        w=select(operators.w, operators.bilateral),
        L=operators.L,
        terms=None,
        contacts=tuple(operators.contacts[i] for i in operators.bilateral),
    )
    rates_b = select(ratio, operators.bilateral)
    scaled = (
        jnp.stack([bilateral.T[:, j] * rates_b[j] for j in range(len(rates_b))], axis=1)
        if len(rates_b)
        else bilateral.T
    )
    cap = norm_ratio_of_factors(bilateral.N, scaled)
    blocks = _Blocks.of(operators)
    reach = 1 / blocks.beta_2()
    if xi is not None:
        return _first_crossing(ratio * jnp.asarray(xi, ratio.dtype), blocks, reach, cap)
    signs = jnp.asarray(_sign_vectors(operators), ratio.dtype)
    return linalg.least(jax.vmap(_first_crossing, (0, None, None, None))(ratio[None, :] * signs, blocks, reach, cap))


def _sign_vectors(operators: Delassus) -> np.ndarray:
    """(2^k, m) all signs of the k frictional contacts, ones elsewhere."""
    choices = [(1, -1) if contact.frictional else (1,) for contact in operators.contacts]
    return np.array(list(itertools.product(*choices)))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Blocks:
    """What (62) is made of besides r, each vector split along the span of N_b (its coefficients) and across it."""

    Xt: Array
    Gn: Array
    Gt: Array
    N_c: Array
    Db: Array
    Du: Array
    b: tuple[int, ...] = field(metadata={"static": True})
    u: tuple[int, ...] = field(metadata={"static": True})

    @classmethod
    def of(cls, operators: Delassus) -> "_Blocks":
        b, u = operators.bilateral, operators.unilateral
        Nb, Nu = select_columns(operators.N, b), select_columns(operators.N, u)
        Tb, Tu = select_columns(operators.T, b), select_columns(operators.T, u)
        both = jnp.concatenate([Tb, Nu, Tu], axis=1)
        ends = len(b), len(b) + len(u)
        Xt, Gn, Gt = jnp.split(_on_factors(Nb, both), ends, axis=1)
        across = linalg.project_out(Nb, both) if u else both
        Tb, N_c, Tu = jnp.split(across, ends, axis=1)
        return cls(Xt, Gn, Gt, N_c, linalg.gram(N_c, Tb), linalg.gram(N_c, Tu), b, u)

    @jax.jit
    def perturbation(self, mu_xi: Array) -> Array:
        """P_mu = M_ub^mu - M_ub^0 of (64) to (67) with errata A14 to A16, K = (I - X)^-1 - I.

        The parts along N_b cancel by hand: P_21 = -2 Db [mu_b xi] (I + K) and
        P_22 = Db [mu_b xi] (I + K)(Gn - Gt [mu_u xi]) - Du [mu_u xi], with Db, Du the couplings of N_u and T_b, T_u
        across the bilateral constraints. In floating point the printed differences lose all digits where N_u comes
        close to the span of N_b.
        """
        mul = partial(jnp.matmul, precision=lax.Precision.HIGHEST)
        d_b, d_u = select(mu_xi, self.b)[None, :], select(mu_xi, self.u)[None, :]
        X = self.Xt * d_b
        one = jnp.eye(len(self.b), dtype=X.dtype)
        K = mul(X, linalg.solve(one - X, one))
        across = mul(self.Db * d_b, one + K)
        P12 = mul(one + K, self.Gt * d_u) - mul(K, self.Gn)
        P22 = mul(across, self.Gn - self.Gt * d_u) - self.Du * d_u
        return jnp.concatenate([jnp.concatenate([2 * K, P12], axis=1), jnp.concatenate([-2 * across, P22], axis=1)])

    def beta_2(self) -> Array:
        """beta_2(M_ub^0) = max over gamma in the unilateral contacts of |[[I, G A^-1], [0, A^-1]]|_2, A = A_c[gamma,
        gamma]."""
        subsets = [g for k in range(len(self.u) + 1) for g in itertools.combinations(range(len(self.u)), k)]
        return linalg.greatest(jnp.stack([self._vertex_norm(g) for g in subsets]))

    def _vertex_norm(self, gamma: tuple[int, ...]) -> Array:
        dtype = self.N_c.dtype
        one = jnp.eye(len(self.b), dtype=dtype)
        if not gamma:
            return jnp.ones((), dtype) if self.b else jnp.zeros((), dtype)
        pseudo_inverse = _on_factors(select_columns(self.N_c, gamma), jnp.eye(self.N_c.shape[0], dtype=dtype))
        inverse = linalg.gram(pseudo_inverse.T, pseudo_inverse.T)
        right = jnp.matmul(select_columns(self.Gn, gamma), inverse, precision=lax.Precision.HIGHEST)
        lower = jnp.concatenate([jnp.zeros((len(gamma), len(self.b)), dtype), inverse], axis=1)
        return linalg.singular_value_max(jnp.concatenate([jnp.concatenate([one, right], axis=1), lower]))


def _on_factors(N: Array, X: Array) -> Array:
    """(N^T N)^-1 N^T X, N^T N never formed; empty where N or X is."""
    return coupling(N, X) if N.shape[1] and X.shape[1] else jnp.zeros((N.shape[1], X.shape[1]), N.dtype)


@jax.jit
def _excess(r: Array, direction: Array, blocks: _Blocks, reach: Array) -> Array:
    """|P(r * direction)|_2 - reach."""
    return linalg.singular_value_max(blocks.perturbation(r * direction)) - reach


def _first_crossing(direction: Array, blocks: _Blocks, reach: Array, cap: Array) -> Array:
    """The least r <= cap with |P(r * direction)|_2 >= reach: a scan, then a bisection."""
    grid = lax.stop_gradient(_scan(direction, blocks, reach, cap))
    over = ~(jax.vmap(_excess, (0, None, None, None))(grid, direction, blocks, reach) < 0)
    first = jnp.argmax(over)
    low, high = jnp.where(first > 0, grid[first - 1], 0), grid[first]
    root = _crossing_between(low, high, direction, blocks, reach)
    return jnp.where(over[first], jnp.minimum(root, cap), cap)


@jax.custom_jvp
def _crossing_between(low: Array, high: Array, direction: Array, blocks: _Blocks, reach: Array) -> Array:
    """The r between low and high with |P(r * direction)|_2 = reach, by bisection."""

    def halve(_, bracket):
        low, high = bracket
        middle = low + (high - low) / 2
        above = _excess(middle, direction, blocks, reach) >= 0
        return jnp.where(above, low, middle), jnp.where(above, middle, high)

    return lax.fori_loop(0, jnp.finfo(direction.dtype).nmant + 2, halve, (low, high))[0]


@_crossing_between.defjvp
def _crossing_between_jvp(primals, tangents):
    """The implicit derivative; the bracket does not matter."""
    root = _crossing_between(*primals)
    _, slope = jax.jvp(lambda r: _excess(r, *primals[2:]), (root,), (jnp.ones_like(root),))
    _, change = jax.jvp(lambda *given: _excess(root, *given), primals[2:], tangents[2:])
    return root, -change / slope


def _scan(direction: Array, blocks: _Blocks, reach: Array, cap: Array) -> Array:
    """Points in geometric progression around the crossing of the linear part of P, up to the cap."""
    _, slope = jax.jvp(blocks.perturbation, (0 * direction,), (direction,))
    linear = reach / linalg.singular_value_max(slope)
    end = jnp.where(jnp.isfinite(cap), cap, AROUND * linear)
    start = jnp.minimum(linear, end) / AROUND
    return start * (end / start) ** (jnp.arange(1, SCAN_POINTS + 1, dtype=direction.dtype) / SCAN_POINTS)
