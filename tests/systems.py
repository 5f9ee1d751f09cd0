"""Random contact systems as factors, and what an independent program in NumPy, mpmath or fractions says of them."""

import itertools
from fractions import Fraction

import jax.numpy as jnp
import mpmath
import numpy as np

import jaxcontact as jc

KINDS = {"b": ("bilateral", True), "u": ("unilateral", True), "B": ("bilateral", False), "U": ("unilateral", False)}


def contacts_of(kinds):
    """Contacts from letters: b, u frictional, B, U frictionless."""
    return tuple(jc.Contact(f"{letter}{i}", *KINDS[letter]) for i, letter in enumerate(kinds))


def operators_of(N, T, kinds, w=None):
    """Delassus operators from their factors."""
    w = jnp.zeros(N.shape[1], N.dtype) if w is None else w
    return jc.Delassus(N=N, T=T, w=w, L=None, terms=None, contacts=contacts_of(kinds))


def random_factors(kinds, count, seed=0, extra=1):
    """(N, T), each (count, m + extra, m), standard normal; zero tangential columns where frictionless."""
    rng = np.random.default_rng(seed)
    m = len(kinds)
    N, T = rng.normal(size=(2, count, m + extra, m))
    return N, T * np.array([letter in "bu" for letter in kinds])


def dyadic_factors(kinds, count, seed=0, extra=1):
    """The same with entries that are multiples of 1/8, exact in float32."""
    N, T = random_factors(kinds, count, seed, extra)
    return np.round(8 * N) / 8, np.round(8 * T) / 8


def vertices(kinds):
    """Every set of closed contacts with every sign at the frictional ones: [(members, signs)]."""
    bilateral = [i for i, letter in enumerate(kinds) if letter in "bB"]
    unilateral = [i for i, letter in enumerate(kinds) if letter in "uU"]
    chosen = [c for k in range(len(unilateral) + 1) for c in itertools.combinations(unilateral, k)]
    sets = [sorted(bilateral + list(c)) for c in chosen]
    return [
        (members, signs)
        for members in sets
        if members
        for signs in itertools.product(*[(1, -1) if kinds[i] in "bu" else (0,) for i in members])
    ]


def critical_reference(N, T, kinds, digits=40):
    """1 / the largest positive real eigenvalue of W_I^-1 Wt_I S over all vertices, in mpmath from exact W and Wt."""
    with mpmath.workdps(digits):
        N, T = mpmath.matrix(N.tolist()), mpmath.matrix(T.tolist())
        W, Wt = N.T * N, N.T * T
        best = mpmath.mpf(0)
        for members, signs in vertices(kinds):
            k = len(members)
            A = mpmath.matrix(k, k)
            B = mpmath.matrix(k, k)
            for i, j in itertools.product(range(k), repeat=2):
                A[i, j], B[i, j] = W[members[i], members[j]], Wt[members[i], members[j]] * signs[j]
            values = mpmath.eig(mpmath.lu_solve(A, B) if k == 1 else A**-1 * B, left=False, right=False)
            real = [mpmath.re(x) for x in values if abs(mpmath.im(x)) < mpmath.mpf(10) ** (-digits // 3)]
            best = max([best, *real])
        return float(1 / best) if best > mpmath.mpf(10) ** (-digits // 3) else np.inf


def binding_vertex(N, T, kinds):
    """(members, signs) of the vertex with the largest real eigenvalue, in NumPy."""

    def largest(vertex):
        members, signs = vertex
        X = np.linalg.lstsq(N[:, members], T[:, members] * np.array(signs), rcond=None)[0]
        return max((x.real for x in np.linalg.eigvals(X) if abs(x.imag) <= 1e-9 * abs(x)), default=0.0)

    return max(vertices(kinds), key=largest)


def exact(matrix):
    """Nested lists of Fractions from floats."""
    return [[Fraction(float(x)) for x in row] for row in np.asarray(matrix)]


def exact_det(A):
    """Determinant of nested lists of Fractions by elimination."""
    A, det = [list(row) for row in A], Fraction(1)
    for j in range(len(A)):
        pivot = next((i for i in range(j, len(A)) if A[i][j] != 0), None)
        if pivot is None:
            return Fraction(0)
        if pivot != j:
            A[j], A[pivot], det = A[pivot], A[j], -det
        det *= A[j][j]
        for i in range(j + 1, len(A)):
            factor = A[i][j] / A[j][j]
            A[i] = [x - factor * y for x, y in zip(A[i], A[j])]
    return det


def solutions_of(W, Wt, w, pull, kinds):
    """All solutions of the sliding problem by enumeration: A lambda - At [pull] |lambda| + w, pull = mu xi."""
    bilateral = [letter in "bB" for letter in kinds]
    found = []
    for mode in itertools.product(*[(1, -1) if b else (1, 0) for b in bilateral]):
        s = np.array(mode, float)
        K = (W - Wt * (pull * s)) * (s != 0) - np.diag((s == 0).astype(float))
        if abs(np.linalg.det(K)) < 1e-13:
            continue
        x = np.linalg.solve(K, -w)
        good = all((s[i] * x[i] >= 0) if s[i] else (x[i] >= 0) for i in range(len(w)))
        if good:
            lam = np.where(s != 0, x, 0)
            if not any(np.allclose(lam, other, atol=1e-9) for other in found):
                found.append(lam)
    return found
