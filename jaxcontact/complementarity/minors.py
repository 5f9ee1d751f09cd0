"""Three or four contacts by minors: every mode at once, without a pivot and without a loop.

With D_S the principal minor of M on the rows S, and n_{S,k} the same with column k replaced by q, Cramer's rule gives
for the mode in which exactly the contacts S press

    z_k = -n_{S,k} / D_S   (k in S),        w_k = n_{S + k, k} / D_S   (k not in S),

so that all modes of a problem share their minors (Cottle, Pang, Stone 2.3; the second is a Schur complement). One
kernel finds the mode in which the smallest of these numbers is largest, the next solve its linear system and correct
the answer; each yields one number or two per lane, so that a batch is a few vectorised loops.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.complementarity.scaling import scaled
from jaxcontact.linalg import as_one, from_one, fused, shield, walled

REGULAR = 64
"""A principal minor below REGULAR eps (of a matrix with entries up to one) makes its mode singular."""

CLEAR = 2**10
"""No mode is a solution if the best fails by more than CLEAR eps over the smallest principal minor: an upper bound of
the rounding of a minor of order four, some 24 products of entries up to one, relative to it."""


CORRECTIONS = 3
"""Each correction with the same inverse divides what is missed by about 1 / (eps times the condition)."""


class BestMode(NamedTuple):
    """The mode with the largest smallest unknown."""

    z: jax.Array
    """(m,) its solution, in the caller's units, negative entries cut to zero"""
    none: jax.Array
    """bool: no mode has a solution, beyond the doubt of rounding"""


def best_mode(M, q) -> BestMode:
    """`BestMode` of LCP(M, q), m = 3 or 4; a few hundred operations of straight code.

    >>> best_mode(jnp.eye(3), jnp.array([-1.0, 2.0, -3.0])).z     # (1, 0, 3)
    """
    m = len(q)
    code = walled(fused(_mode))(M, q)
    active = (code[None] >> jnp.arange(m, dtype=jnp.int32)) & 1

    def part(pair):
        return from_one(walled(fused(lambda *given: _solved(*given, pair)))(M, q, active))

    return BestMode(jnp.concatenate([part(pair) for pair in _pairs(m)]), code >= 2**m)


def _pairs(m):
    return [tuple(range(i, min(i + 2, m))) for i in range(0, m, 2)]


def _mode(M, q):
    """int32: bit i is set if contact i presses in the best mode; bit m if no mode is a solution."""
    m = len(q)
    data = scaled(M, q)
    M, q = data.M, data.q
    minors = _Minors([[M[i, j] for j in range(m)] + [q[i]] for i in range(m)])
    eps = float(jnp.finfo(q.dtype).eps)
    sizes = [lax.abs(minors.principal(S)) for S in _subsets(m)]
    best, code = None, jnp.int32(0)
    for S, size in zip(_subsets(m), sizes, strict=True):
        sign = jnp.where(minors.principal(S) < 0, -1, 1).astype(q.dtype)
        pressing = [-minors.replaced(S, k) for k in S]
        gaps = [minors.replaced(tuple(sorted((*S, k))), k) for k in range(m) if k not in S]
        unit = _largest([size, *map(jnp.abs, pressing)])
        margin = -_largest([-sign * x for x in (*pressing, *gaps)]) / jnp.where(unit > 0, unit, 1)
        margin = jnp.where(size > REGULAR * eps, margin, -jnp.inf)
        number = jnp.int32(sum(1 << k for k in S))
        if best is None:
            best, code = margin, number
        else:
            better = margin > best
            best, code = jnp.where(better, margin, best), jnp.where(better, number, code)
    fails = best < -CLEAR * eps / jnp.maximum(-_largest([-size for size in sizes]), eps)
    return code + jnp.where(fails, 2**m, 0).astype(jnp.int32)


def _solved(M, q, active, wanted):
    """z of the wanted contacts in the mode, in the caller's units and as one number: Cramer's rule and corrections
    with the same inverse."""
    m = len(q)
    data = scaled(M, q)
    M, q = data.M, data.q
    on = [active[i] > 0 for i in range(m)]
    K = [[jnp.where(on[i] & on[j], M[i, j], 1.0 if i == j else 0.0) for j in range(m)] for i in range(m)]
    load = [jnp.where(on[i], -q[i], 0) for i in range(m)]
    minors = _Minors(K)
    full = tuple(range(m))
    volume = minors.principal(full)
    scale = shield(1 / jnp.where(volume == 0, 1, volume))
    inverse = [[scale * minors.cofactor(full, j, i) for j in range(m)] for i in range(m)]

    def times(A, x):
        return [sum(A[i][j] * x[j] for j in range(m)) for i in full]

    z = times(inverse, load)
    for _ in range(CORRECTIONS):
        miss = [b - c for b, c in zip(load, times(K, z), strict=True)]
        z = [a + b for a, b in zip(z, times(inverse, miss), strict=True)]
    z = data.unscale(jnp.stack([jnp.maximum(part, 0) for part in z]))
    return as_one([z[i] for i in wanted])


class _Minors:
    """Minors of a matrix of scalars, each computed once, by expansion along the first row."""

    def __init__(self, rows):
        self.rows, self.known = rows, {}

    def of(self, rows, columns):
        """The minor of some rows and as many columns, in the given order."""
        if not rows:
            return jnp.ones((), self.rows[0][0].dtype)
        if (rows, columns) not in self.known:
            first, rest = rows[0], rows[1:]
            terms = [
                (-1) ** place * self.rows[first][column] * self.of(rest, columns[:place] + columns[place + 1 :])
                for place, column in enumerate(columns)
            ]
            self.known[rows, columns] = sum(terms[1:], terms[0])
        return self.known[rows, columns]

    def principal(self, S):
        return self.of(S, S)

    def replaced(self, S, k):
        """The principal minor of S with column k replaced by the last column of all."""
        place, last = S.index(k), len(self.rows[0]) - 1
        columns = S[:place] + S[place + 1 :] + (last,)
        return (-1) ** (len(S) - 1 - place) * self.of(S, columns)

    def cofactor(self, S, i, j):
        """(-1)^(i + j) times the minor without row i and column j."""
        rows, columns = (tuple(k for k in S if k != gone) for gone in (i, j))
        return (-1) ** (i + j) * self.of(rows, columns)


def _subsets(m):
    return [tuple(k for k in range(m) if number >> k & 1) for number in range(2**m)]


def _largest(scalars):
    found = scalars[0]
    for x in scalars[1:]:
        found = jnp.maximum(found, x)
    return found
