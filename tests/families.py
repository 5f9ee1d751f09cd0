"""Families of linear complementarity problems: (M, q) as float64 arrays from a size and a random generator.

Entries are multiples of 1/16 where the family allows it, so that ties are exact and float32 holds the data.
"""

from itertools import product

import numpy as np


def _dyadic(rng, *shape, low=-4, high=4):
    return rng.integers(16 * low, 16 * high + 1, shape) / 16


def positive_definite(m, rng):
    """J J' + I/4: frictionless contacts."""
    J = _dyadic(rng, m, m, low=-1, high=1)
    return J @ J.T + np.eye(m) / 4, _dyadic(rng, m)


def nonsymmetric(m, rng):
    """Positive definite plus skew: P, not symmetric."""
    M, q = positive_definite(m, rng)
    S = _dyadic(rng, m, m, low=-2, high=2)
    return M + np.triu(S, 1) - np.triu(S, 1).T, q


def triangular(m, rng):
    """Lower triangular with positive diagonal: P, far from definite."""
    return np.tril(_dyadic(rng, m, m), -1) + np.eye(m), _dyadic(rng, m)


def hidden_scales(m, rng):
    """A diagonally dominant matrix in units that differ by powers of two: P."""
    M = _dyadic(rng, m, m, low=-1, high=1)
    M += np.diag(1 + np.abs(M).sum(axis=1))
    D = 2.0 ** rng.integers(-20, 21, m)
    return D[:, None] * M * D, D * _dyadic(rng, m)


def circulant(m, rng):
    """I + a shift with a > 1: P for odd m, where Gauss-Seidel diverges and Newton's method cycles."""
    return np.eye(m) + 2 * np.roll(np.eye(m), 1, axis=1), _dyadic(rng, m, low=-2, high=1)


def m_matrix(m, rng):
    """An obstacle problem: Z-matrix with inverse >= 0."""
    return 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1), _dyadic(rng, m)


def low_rank(m, rng):
    """Redundant contacts of one or two degrees of freedom, loads in the range: positive semidefinite, solvable."""
    J = rng.integers(-2, 3, (m, rng.integers(1, 3))).astype(float)
    return J @ J.T, J @ rng.integers(-3, 4, J.shape[1]) + rng.integers(0, 3, m)


def infeasible_semidefinite(m, rng):
    """Contacts that push against one another: semidefinite, often without solution."""
    J = rng.integers(-2, 3, (m, 1)).astype(float)
    return J @ J.T, rng.integers(-2, 3, m).astype(float)


def copositive(m, rng):
    """Nonnegative with positive diagonal: strictly copositive, always solvable, often several solutions."""
    return rng.integers(0, 5, (m, m)) + np.eye(m), rng.integers(-4, 3, m).astype(float)


def indefinite(m, rng):
    """Small integers: anything may happen."""
    return rng.integers(-2, 3, (m, m)).astype(float), rng.integers(-3, 4, m).astype(float)


def murty(m, rng):
    """Murty's cube, 2^m pivots on its worst q."""
    return np.eye(m) + 2 * np.tril(np.ones((m, m)), -1), -(2.0 ** np.arange(m, 0, -1)).cumsum()


def fathi(m, rng):
    """Fathi's symmetric positive definite cube, L L' with Murty's L."""
    L = np.eye(m) + 2 * np.tril(np.ones((m, m)), -1)
    return L @ L.T, -np.ones(m)


def ties(m, rng):
    """All violations equal, many degenerate rows."""
    M = positive_definite(m, rng)[0]
    return M, np.where(rng.random(m) < 0.5, -1.0, 0.0)


def mass_ratio(m, rng):
    """A column of boxes whose masses span up to eight decades, at rest under gravity."""
    mass = 10.0 ** rng.uniform(0, rng.choice([2, 4, 6, 8]), m)
    J = np.eye(m) - np.eye(m, k=1)
    return J.T @ np.diag(1 / mass) @ J, -J.T @ np.ones(m) * rng.uniform(0.5, 2)


def sliding(m, rng, factor=0.9):
    """W - Wt diag(mu xi): sliding contacts at a multiple of the friction where uniqueness is first lost."""
    N, T = rng.normal(size=(m + 1, m)), rng.normal(size=(m + 1, m))
    W, Wt, ratio = N.T @ N, N.T @ T, rng.uniform(0.25, 1.75, m) * rng.choice([-1, 1], m)
    mu = min(critical_friction(W, Wt * ratio), 50.0)
    return W - factor * mu * Wt * ratio, rng.normal(size=m)


def near_critical(m, rng):
    """`sliding` at mu_crit (1 ± 10^-k), k = 1 ... 12."""
    return sliding(m, rng, 1 + rng.choice([-1, 1]) * 10.0 ** -rng.integers(1, 13))


def beyond_critical(m, rng):
    """`sliding` at twice the critical friction."""
    return sliding(m, rng, 2.0)


def critical_friction(W, Y):
    """The least r > 0 with det (W - r Y)_aa = 0 for some index set a; inf if there is none."""
    least = np.inf
    for mode in product((False, True), repeat=len(W)):
        if any(mode):
            block = np.ix_(mode, mode)
            values = np.linalg.eigvals(np.linalg.solve(W[block], Y[block]))
            real = values.real[(np.abs(values.imag) < 1e-9) & (values.real > 1e-9)]
            least = min(least, 1 / real.max()) if real.size else least
    return least


def planar_friction(m, rng):
    """Coulomb's law in the plane for n = m / 3 contacts with unequal mu, normal force N and tangential force T.

    Unknowns N, R = T + mu N, B = slip-; rows 0 <= N ⟂ normal acceleration, 0 <= R ⟂ slip+ = slip + B and
    0 <= B ⟂ 2 mu N - R = mu N - T, where (normal acceleration, slip) = W (N, T) + load.
    """
    n = m // 3
    J = rng.normal(size=(2 * n + 1, 2 * n))
    W, load = J.T @ J, rng.normal(size=2 * n)
    mu = np.diag(rng.uniform(0.1, 1.0, n))
    nn, nt, tn, tt = W[:n, :n], W[:n, n:], W[n:, :n], W[n:, n:]
    zero, one = np.zeros((n, n)), np.eye(n)
    M = np.block([[nn - nt @ mu, nt, zero], [tn - tt @ mu, tt, one], [2 * mu, -one, zero]])
    return M, np.concatenate([load[:n], load[n:], np.zeros(n)])


UNIQUE = (positive_definite, nonsymmetric, triangular, hidden_scales, m_matrix, murty, fathi, ties, mass_ratio, sliding)
"""Families of P-matrices."""

FAMILIES = (
    *UNIQUE,
    circulant,
    low_rank,
    infeasible_semidefinite,
    copositive,
    indefinite,
    near_critical,
    beyond_critical,
)
