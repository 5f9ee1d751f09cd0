"""Writes critical.json: random contact systems and their exact friction threshold to 40 digits. Run by hand, a minute.

The factors N, T (m + 1, m) are standard normal numbers rounded to multiples of 1/8: exact in float32, and W = N^T N and
Wt = N^T T exact in mpmath. The threshold is 1 / the largest positive real eigenvalue of W_I^-1 Wt_I S over all
vertices: the sets I of closed contacts, every bilateral one among them, and all signatures S. NumPy looks at all
vertices in double precision; of every vertex within SCREEN of the largest mpmath computes the eigenvalues to DIGITS,
where one is real if its imaginary part is below 10^-(DIGITS / 3).
"""

import itertools
import json
from pathlib import Path

import mpmath
import numpy as np

SHAPES = ["b" * m for m in range(1, 7)] + ["u" * m for m in range(1, 7)]
SHAPES += ["bu", "bbu", "buu", "buU", "bbuB", "bbuu", "bBuU", "bbbuu", "bbbuuu", "bbBuuU"]
"""A letter for each contact: b, u frictional bilateral and unilateral, B, U frictionless."""

SYSTEMS = 12
SCREEN = 1e-2
DIGITS = 60


def vertices(kinds):
    """(members, signs) of every set of closed contacts with every sign at the frictional ones."""
    always = [i for i, letter in enumerate(kinds) if letter in "bB"]
    choice = [i for i, letter in enumerate(kinds) if letter in "uU"]
    for k in range(len(choice) + 1):
        for chosen in itertools.combinations(choice, k):
            members = sorted(always + list(chosen))
            sides = [(1, -1) if kinds[i] in "bu" else (0,) for i in members]
            yield from ((members, signs) for signs in itertools.product(*sides) if any(signs))


def double(W, Wt, members, signs):
    """The largest nearly real eigenvalue in double precision."""
    X = np.linalg.solve(W[np.ix_(members, members)], Wt[np.ix_(members, members)] * np.array(signs))
    values = np.linalg.eigvals(X)
    return max((x.real for x in values if abs(x.imag) <= SCREEN * abs(x)), default=0.0)


def precise(W, Wt, members, signs):
    """The largest real eigenvalue in mpmath, 0 if none is positive."""
    W = mpmath.matrix(W[np.ix_(members, members)].tolist())
    Wt = mpmath.matrix((Wt[np.ix_(members, members)] * np.array(signs)).tolist())
    values = mpmath.eig(W**-1 * Wt, left=False, right=False) if len(members) > 1 else [Wt[0, 0] / W[0, 0]]
    return max([mpmath.mpf(0)] + [mpmath.re(x) for x in values if abs(mpmath.im(x)) < mpmath.mpf(10) ** (-DIGITS // 3)])


def threshold(N, T, kinds):
    # Multiples of 1/64 below 2^20: the products are exact in double precision.
    W, Wt = N.T @ N, N.T @ T
    every = list(vertices(kinds))
    rough = [double(W, Wt, *vertex) for vertex in every]
    best, seen = mpmath.mpf(0), []
    for value, vertex in sorted(zip(rough, every), key=lambda pair: -pair[0]):
        if value < (1 - SCREEN) * best:
            break
        seen.append(precise(W, Wt, *vertex))
        best = max(best, seen[-1])
    return mpmath.nstr(1 / best, 40)


def main():
    mpmath.mp.dps = DIGITS
    rng = np.random.default_rng(20261122)
    found = {}
    for kinds in SHAPES:
        rows = []
        for _ in range(SYSTEMS):
            m = len(kinds)
            N, T = np.round(8 * rng.normal(size=(2, m + 1, m))) / 8
            T = T * np.array([letter in "bu" for letter in kinds])
            value = threshold(N, T, kinds)
            rows.append({"N": (8 * N).astype(int).tolist(), "T": (8 * T).astype(int).tolist(), "critical": value})
        found[kinds] = rows
        print(kinds, flush=True)
    text = {"about": __doc__, "unit": "N and T in eighths", "systems": found}
    Path(__file__).with_name("critical.json").write_text(json.dumps(text, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()
