"""Exact answers of linear complementarity problems with a P-matrix, in integers, written apart from the library.

Floats are taken as the rationals they are. Principal pivoting in floating point proposes which z_i are positive; the
proposal is solved and every sign checked without rounding, and where one is wrong Murty's rule goes on from there.
"""

import numpy as np

STEPS_PER_ROW = 8
"""Pivots per row before a lane is given up, in floating point and again in integers."""


def reference(M, q):
    """z, w (count, m), exact up to the last rounding to float64; NaN in a lane where M turns out to be no P-matrix."""
    z, w = np.full((2, *q.shape), np.nan)
    for lane, active in enumerate(proposed(M, q)):
        found = exact(M[lane], q[lane], active)
        if found is not None:
            z[lane], w[lane] = found
    return z, w


def proposed(M, q):
    """(count, m) bool, z_i > 0: the row with the most negative entry changes sides, in all lanes together."""
    count, m = q.shape
    active, identity = np.zeros((count, m), bool), np.eye(m)
    for _ in range(STEPS_PER_ROW * m):
        K = np.where(active[:, None, :], -M, identity)
        regular = np.linalg.cond(K) < 1 / np.finfo(float).eps
        y = np.linalg.solve(np.where(regular[:, None, None], K, identity), q[:, :, None])[:, :, 0]
        worst = y.argmin(axis=1)
        wrong = regular & (y.min(axis=1) < 0)
        if not wrong.any():
            break
        active[wrong, worst[wrong]] ^= True
    return active


def exact(M, q, active):
    """(z, w) as lists of floats, or None; `active` is where the pivoting begins (Murty 1974: from any basis)."""
    m, active = len(q), list(active)
    M, q, unit = whole(M, q)
    for _ in range(STEPS_PER_ROW * m):
        members = [i for i in range(m) if active[i]]
        found = eliminated([[M[i][j] for j in members] + [-q[i]] for i in members])
        if found is None:
            return None
        numerators, det = found
        z = dict(zip(members, numerators, strict=True))
        w = {i: sum((M[i][j] * z[j] for j in members), q[i] * det) for i in range(m) if not active[i]}
        wrong = next((i for i, entry in sorted((z | w).items()) if entry < 0), None)
        if wrong is None:
            return [z.get(i, 0) / det for i in range(m)], [w.get(i, 0) / (det * unit) for i in range(m)]
        active[wrong] = not active[wrong]
    return None


def whole(M, q):
    """M and q as nested lists of integers, and the power of two they were multiplied with."""
    ratios = [[float(x).as_integer_ratio() for x in row] for row in (*M, q)]
    unit = max(below for row in ratios for _, below in row)
    *M, q = [[above * (unit // below) for above, below in row] for row in ratios]
    return M, q, unit


def eliminated(rows):
    """(numerators, determinant) of the solution of [K | b], K with positive leading minors; None if one is not.

    Elimination without fractions: each division is exact (Bareiss, Math. Comp. 22 (1968) 565-578).
    """
    before = 1
    for k, pivot_row in enumerate(rows):
        pivot = pivot_row[k]
        if pivot <= 0:
            return None
        for i, row in enumerate(rows):
            if i != k:
                factor = row[k]
                rows[i] = [(pivot * a - factor * b) // before for a, b in zip(row, pivot_row, strict=True)]
        before = pivot
    return [row[-1] for row in rows], before
