"""Up to four contacts in closed form: every mode is tried, so that nothing is missed.

For one or two contacts also where modes are singular: the solutions in one mode form a polyhedron without lines, hence
with a vertex, and each vertex has at most two unknowns from two equations. Six candidates cover m = 2: z = 0; z_1 from
either row; z_2 from either row; both.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact import native
from jaxcontact.complementarity.gauss_seidel import hopeless_row
from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.minors import best_mode
from jaxcontact.complementarity.pairs import Pairs, best_of_pairs
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.scaling import exponent, power_of_two, scaled
from jaxcontact.complementarity.status import Status
from jaxcontact.linalg import as_one, from_one, fused, walled, where

LARGEST = 4
"""More contacts have more modes than straight code should list."""

EVERY_VERTEX = 2
"""Up to this many contacts every vertex of a mode is tried, so that dependent equations hide no solution."""


CORRECTIONS = 2
"""Each correction divides what a solution misses by about 1 / (eps times the condition): two serve a condition of
1e10 in float64."""


class Best(NamedTuple):
    """The candidate with the least violation."""

    z: jax.Array
    """(m,) in the caller's units"""
    none: jax.Array | bool
    """bool: if this candidate is no solution there is none"""
    done: jax.Array
    """bool, always true: nothing is iterated"""


@dataclasses.dataclass(frozen=True)
class Direct:
    """Closed form for m <= 4.

    Where every candidate fails the status is NO_SOLUTION, or INFEASIBLE if that is proved; for three or four contacts
    INACCURATE where a singular or nearly singular mode leaves room for a solution. Problems of one or two pairs without
    free unknowns are solved as they are, others as LCPs. Raises ValueError for more contacts.

    >>> solve(LCP([[-1.0]], [-1.0]), Direct()).status     # NO_SOLUTION or INFEASIBLE: M < 0 and q < 0
    """

    pairs = EVERY_VERTEX
    """Largest number of pairs for `of_pairs`."""

    def budget(self, m):
        """No step is needed."""
        return 0

    def compiled(self, problem: LCP, start, certified):
        """The same candidates by a compiled kernel."""
        _check_size(problem.q.shape[0])
        return native.direct(problem.M, problem.q, certified)

    def init(self, problem: LCP, start):
        """All candidates, the best of them."""
        m = problem.q.shape[0]
        _check_size(m)
        if m > EVERY_VERTEX:
            return Best(*best_mode(problem.M, problem.q), jnp.ones((), bool))
        return Best(from_one(walled(fused(_best))(problem.M, problem.q)), True, jnp.ones((), bool))

    def step(self, problem: LCP, state: Best):
        """Nothing to do."""
        return state

    def read(self, problem: LCP, state: Best):
        """The best candidate; if it does not solve the problem, none does."""
        outcome = where(state.none, int(Status.NO_SOLUTION), int(Status.INACCURATE)).astype(jnp.int32)
        return Answer(state.z, outcome, hopeless_row(problem))

    def of_pairs(self, P, N, q) -> Pairs:
        """The best candidate of P z - N w + q = 0 for one or two pairs, without going through an LCP."""
        return best_of_pairs(P, N, q)

    def compiled_pairs(self, P, N, q):
        """The same by a compiled kernel."""
        return native.pairs(P, N, q)


def _check_size(m):
    if m > LARGEST:
        raise ValueError(f"Direct: got {m} contacts, takes at most {LARGEST}; write Lemke()")


def _best(M, q):
    """The candidate with the least violation, in the caller's units, as one number."""
    m = len(q)
    data = scaled(M, q)
    M, q = data.M, data.q
    best = [jnp.zeros((), q.dtype)] * m
    least = _violation(M, q, best)
    for candidate in _vertices(M, q):
        violation = _violation(M, q, candidate)
        better = violation < least
        best = [where(better, new, old) for new, old in zip(candidate, best, strict=True)]
        least = where(better, violation, least)
    return as_one(list(data.unscale(jnp.stack(best))))


def _vertices(M, q):
    """Candidates (z_1, ..., z_m) besides zero, negative entries cut to zero; they are judged as cut."""
    if q.shape[0] == 1:
        return [(_held(_quotient(-q[0], M[0, 0])),)]
    zero = jnp.zeros((), q.dtype)
    first = [(_held(_quotient(-q[i], M[i, 0])), zero) for i in range(2)]
    second = [(zero, _held(_quotient(-q[i], M[i, 1]))) for i in range(2)]
    determinant = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    z = [
        _quotient(M[0, 1] * q[1] - M[1, 1] * q[0], determinant),
        _quotient(M[1, 0] * q[0] - M[0, 0] * q[1], determinant),
    ]
    for _ in range(CORRECTIONS):
        miss = [M[i, 0] * z[0] + M[i, 1] * z[1] + q[i] for i in range(2)]
        z = [
            z[0] + _quotient(M[0, 1] * miss[1] - M[1, 1] * miss[0], determinant),
            z[1] + _quotient(M[1, 0] * miss[0] - M[0, 0] * miss[1], determinant),
        ]
    return [*first, *second, tuple(_held(part) for part in z)]


def _violation(M, q, z):
    """What candidates are compared by: eta of z in balanced units, powers of two standing for the largest z and w."""
    m = len(z)
    w = [sum((M[i, j] * z[j] for j in range(m)), q[i]) for i in range(m)]
    terms = [sum((lax.abs(M[i, j]) * z[j] for j in range(m)), lax.abs(q[i])) for i in range(m)]
    per_z, per_w = (power_of_two(-exponent(_largest(parts)), terms[0].dtype) for parts in (z, terms))
    return _largest([lax.abs(jnp.minimum(z[i] * per_z, w[i] * per_w)) for i in range(m)])


def _largest(scalars):
    return scalars[0] if len(scalars) == 1 else jnp.maximum(*scalars)


def _held(x):
    return jnp.maximum(x, 0)


def _quotient(a, b):
    """a / b, and zero where b is zero: z = 0 is a candidate anyway."""
    return where(b == 0, 0, a / where(b == 0, 1, b))
