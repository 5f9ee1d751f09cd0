"""Exact answers of small complementarity problems in rational arithmetic, written apart from the library.

Every mode of N w - M z = q (a solution has z_i = 0 or w_i = 0 for every i) is a system of equations and sign
conditions. Regular systems are solved by elimination; singular ones by listing all basic solutions, of which a
polyhedron in the positive orthant has one whenever it is not empty. Floats are taken as the exact rationals they are.
"""

from fractions import Fraction
from itertools import combinations, product
from typing import NamedTuple


class Truth(NamedTuple):
    """verdict: none, unique, finite or infinite; points: the solutions (z, w), of families their vertices."""

    verdict: str
    points: list


def lcp(M, q):
    """The truth about 0 <= z ⟂ w = M z + q >= 0."""
    m = len(q)
    identity = [[int(i == j) for j in range(m)] for i in range(m)]
    return horizontal(identity, M, q)


def absolute_value(A, B, w):
    """The truth about A x - B|x| + w = 0, as pairs (x+, x-)."""
    A, B = rational(A), rational(B)
    plus = [[a + b for a, b in zip(*rows)] for rows in zip(A, B)]
    minus = [[a - b for a, b in zip(*rows)] for rows in zip(A, B)]
    return horizontal(plus, minus, w)


def horizontal(N, M, q):
    """The truth about N w - M z = q, 0 <= z ⟂ w >= 0."""
    N, M, q = rational(N), rational(M), [Fraction(float(x)) for x in q]
    m = len(q)
    points, infinite = set(), False
    for mode in product((False, True), repeat=m):
        K = [[-M[i][j] if mode[j] else N[i][j] for j in range(m)] for i in range(m)]
        vertices, unbounded = _polyhedron(K, q)
        infinite |= unbounded or len(vertices) > 1
        for y in vertices:
            points.add(
                (tuple(y[j] if mode[j] else 0 for j in range(m)), tuple(0 if mode[j] else y[j] for j in range(m)))
            )
    count = len(points)
    verdict = "infinite" if infinite else "none" if count == 0 else "unique" if count == 1 else "finite"
    return Truth(verdict, sorted(points))


def rational(A):
    """Nested lists or an array of floats as fractions."""
    return [[Fraction(float(x)) if not isinstance(x, Fraction) else x for x in row] for row in A]


def solve(A, b):
    """The solution of a regular rational system, or None if it is singular."""
    columns = list(range(len(b)))
    solved = _basic(A, b, columns)
    return None if solved is None else [solved[j] for j in columns]


def _polyhedron(K, q):
    """(vertices of {y >= 0: K y = q}, whether it contains a ray)."""
    m = len(q)
    y = solve(K, q)
    if y is not None:
        return ([y] if min(y, default=0) >= 0 else []), False
    vertices = _basic_points(K, q)
    if not vertices:
        return [], False
    cone = [*K, [Fraction(1)] * m]
    return vertices, bool(_basic_points(cone, [Fraction(0)] * m + [Fraction(1)]))


def _basic_points(A, b):
    """All y >= 0 with A y = b whose positive entries belong to independent columns."""
    m, found = len(A[0]), []
    for size in range(m + 1):
        for support in combinations(range(m), size):
            y = _basic(A, b, support)
            if y is not None and min(y.values(), default=0) >= 0:
                point = [y.get(j, Fraction(0)) for j in range(m)]
                if point not in found:
                    found.append(point)
    return found


def _basic(A, b, support):
    """{j: y_j} with A_support y = b, unique; None if the columns depend on one another or the rows disagree."""
    rows = [[A[i][j] for j in support] + [b[i]] for i in range(len(b))]
    for c in range(len(support)):
        pivot = next((r for r in range(c, len(rows)) if rows[r][c] != 0), None)
        if pivot is None:
            return None
        rows[c], rows[pivot] = rows[pivot], rows[c]
        lead = rows[c][c]
        rows[c] = [x / lead for x in rows[c]]
        for r in range(len(rows)):
            factor = rows[r][c]
            if r != c and factor != 0:
                rows[r] = [x - factor * y for x, y in zip(rows[r], rows[c])]
    if any(row[-1] != 0 for row in rows[len(support) :]):
        return None
    return {j: rows[i][-1] for i, j in enumerate(support)}


def boxed(M, q, lower, upper):
    """The x with lower <= x <= upper and M x + q >= 0, = 0, <= 0 at the lower bound, between, at the upper bound: that
    of the first of 3^m modes that holds; modes with singular equations are passed over. None if no mode holds."""
    M, q = rational(M), rational([q])[0]
    m, infinite = len(q), float("inf")
    lower, upper = ([b if abs(b) == infinite else Fraction(float(b)) for b in bound] for bound in (lower, upper))
    for mode in product((-1, 0, 1), repeat=m):
        held = [(lower, None, upper)[side + 1][i] if side else None for i, side in enumerate(mode)]
        if infinite in map(abs, (h for h in held if h is not None)):
            continue
        between = [i for i in range(m) if mode[i] == 0]
        load = [q[i] + sum(M[i][j] * held[j] for j in range(m) if mode[j]) for i in range(m)]
        inner = solve([[M[i][j] for j in between] for i in between], [-load[i] for i in between])
        if inner is None:
            continue
        x = [inner[between.index(i)] if mode[i] == 0 else held[i] for i in range(m)]
        w = [sum(M[i][j] * x[j] for j in range(m)) + q[i] for i in range(m)]
        inside = all(low <= value <= high for low, value, high in zip(lower, x, upper))
        if inside and all(w[i] == 0 if mode[i] == 0 else mode[i] * w[i] <= 0 or lower[i] == upper[i] for i in range(m)):
            return x
    return None
