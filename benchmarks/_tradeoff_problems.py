"""Families of complementarity problems that are hard in one way each, with their exact answers."""

from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from benchmarks._tradeoff_reference import reference

MODERATE = 0.5
"""Friction of the well-conditioned family, as a share of where the symmetric part stops being positive definite."""

MOST = 2.0
"""And never more than this, where that is far away or nowhere."""

ROWS_PER_CONTACT = 4
"""Degrees of freedom per contact of the well-conditioned family: W is then of condition about nine."""

LARGEST_EXACT = 8
"""Up to this many contacts all 2^m sets of them are looked at for the critical friction; beyond, couplings are
symmetric, and then the first determinant to vanish is that of all contacts together."""

SPARE = 4
"""So many times more systems are drawn than needed: some never lose uniqueness."""

SIXTEENTHS = 16
"""Redundant problems are made of multiples of 1/16, so that M z + w = q holds without rounding, in float32 too."""


class Problems(NamedTuple):
    """A family at one size, in float64."""

    M: np.ndarray
    """(count, m, m)"""
    q: np.ndarray
    """(count, m)"""
    z: np.ndarray
    """(count, m) exact, rounded to float64; NaN where it is one of several"""
    w: np.ndarray
    """(count, m) exact, rounded to float64"""
    origin: str
    """how the exact answer is known"""


def families(m, count):
    """{name: Problems}"""
    made = {"well conditioned": settled(*well_conditioned(m, count))}
    for digits in (2, 6, 10):
        made[f"critical 1e-{digits}"] = settled(*near_critical(m, count, 10.0**-digits))
    made["stacks"] = settled(*stacks(m, count, 1.0))
    for ratio in (1e4, 1e8):
        made[f"mass ratio {ratio:.0e}".replace("e+0", "e")] = settled(*stacks(m, count, ratio))
    made["redundant"] = redundant(m, count)
    return made


def settled(M, q):
    """The problems whose exact answer is found: all of them, unless rounding M has cost it uniqueness."""
    z, w = reference(M, q)
    known = np.isfinite(z).all(axis=1)
    return Problems(M[known], q[known], z[known], w[known], "integers")


def well_conditioned(m, count):
    """M, q of sliding contacts at moderate friction, any load."""
    rng = np.random.default_rng(m)
    N, T = rng.normal(size=(2, count, ROWS_PER_CONTACT * m, m))
    W, Y = product(N, N), product(N, T)
    mu = np.minimum(MODERATE * definite_until(W, Y), MOST)
    return W - mu[:, None, None] * Y, rng.normal(size=(count, m))


def near_critical(m, count, distance):
    """M, q at the share 1 - distance of the critical friction. In every other lane the load presses on the contacts
    whose determinant is about to vanish, and lifts the others; in the rest it is any."""
    W, Y, threshold, critical = critical_systems(m, count)
    M = W - (threshold * (1 - distance))[:, None, None] * Y
    rng = np.random.default_rng(m)
    size = rng.uniform(0.5, 2, (len(M), m))
    q = np.where(critical, 0, size) - (M @ np.where(critical, size, 0)[:, :, None])[:, :, 0]
    q[::2] = rng.normal(size=(len(M), m))[::2]
    return M, q


@cache
def critical_systems(m, count):
    """W, Y (count, m, m), the least r (count,) at which det (W - r Y) vanishes for some set of contacts, the set."""
    rng = np.random.default_rng(m)
    N, T = rng.normal(size=(2, SPARE * count, m + 1, m))
    if m > LARGEST_EXACT:
        C = rng.normal(size=(SPARE * count, m + 1, m + 1))
        T = (C + C.swapaxes(1, 2)) @ N
    W, Y = product(N, N), product(N, T)
    if m > LARGEST_EXACT:
        threshold, critical = definite_until(W, Y), np.ones((len(W), m), bool)
    else:
        threshold, critical = regular_until(W, Y)
    kept = np.flatnonzero(np.isfinite(threshold))[:count]
    return W[kept], Y[kept], threshold[kept], critical[kept]


def regular_until(W, Y):
    """(count,) the least r > 0 with det (W - r Y) = 0 for some set of contacts, or inf; (count, m) bool, the set."""
    count, m = W.shape[:2]
    radius, critical = np.zeros(count), np.zeros((count, m), bool)
    for size in range(1, m + 1):
        for members in map(list, combinations(range(m), size)):
            part = np.ix_(range(count), members, members)
            values = np.linalg.eigvals(np.linalg.solve(W[part], Y[part]))
            greatest = np.where(values.imag == 0, values.real, 0).max(axis=1)
            better = greatest > radius
            radius[better] = greatest[better]
            critical[better] = np.isin(np.arange(m), members)
    return np.where(radius > 0, 1 / np.where(radius > 0, radius, 1), np.inf), critical


def definite_until(W, Y):
    """(count,) the r > 0 at which the symmetric part of W - r Y becomes singular; inf if it never does."""
    inverse = np.linalg.inv(np.linalg.cholesky(W))
    largest = np.linalg.eigvalsh(inverse @ (Y + Y.swapaxes(1, 2)) @ inverse.swapaxes(1, 2) / 2)[:, -1]
    return np.where(largest > 0, 1 / np.where(largest > 0, largest, 1), np.inf)


def stacks(m, count, ratio):
    """M, q of towers of boxes with masses from 1 to `ratio` in random order, each box accelerated at random."""
    rng = np.random.default_rng(m)
    exponents = rng.uniform(size=(count, m))
    exponents[:, 0], exponents[:, -1] = 0, 1
    mass = ratio ** rng.permuted(exponents, axis=1)
    G = np.eye(m) - np.eye(m, k=1)
    return G.T @ (G / mass[:, :, None]), rng.normal(size=(count, m)) @ G


def redundant(m, count):
    """Twice as many contacts as degrees of freedom, under loads that have an answer; w is unique, z is not."""
    rng = np.random.default_rng(m)
    J = rng.integers(-2, 3, (count, max(m // 2, 1), m)).astype(float)
    J[:, 0] = rng.choice([-2.0, -1.0, 1.0, 2.0], (count, m))  # no contact without effect
    M = product(J, J)
    closed = rng.random((count, m)) < 0.5
    z, w = rng.integers(1, 4 * SIXTEENTHS, (2, count, m)) / SIXTEENTHS
    z, w = np.where(closed, z, 0), np.where(closed, 0, w)
    q = w - (M @ z[:, :, None])[:, :, 0]
    return Problems(M, q, np.full_like(z, np.nan), w, "by construction")


def product(N, T):
    """N' T, in each lane."""
    return N.swapaxes(1, 2) @ T
