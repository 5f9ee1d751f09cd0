"""Lemke's complementary pivoting with lexicographic ties.

Equations: w = q + M z + d z0. From the basis of all w, the artificial z0 enters, then always the complement of what has
just left, until z0 leaves (a solution) or nothing blocks (a ray). Lemke, Management Science 11 (1965); lexicographic
rule: Cottle, Pang, Stone 4.9, Murty 1988, 2.2. What makes it work in floating point are decisions, not drift:
powers-of-two scaling, ties with a two-sided tolerance, a pivot threshold relative to the column, z0 leaving whenever
it ties. Ties are rare: only a batch with one looks at the inverse of the basis.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact import native
from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.pivoting import (
    Exchange,
    check_cap,
    exchange_of,
    exchanged,
    no_exchange,
    pivot_budget,
    refined,
)
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.scaling import Scaled, scaled
from jaxcontact.complementarity.short import dot, entry, first_index, greatest_numbers, least_entry, rows_of
from jaxcontact.complementarity.status import Status
from jaxcontact.linalg import walled, where_needed

TIE = {"float64": 1e4, "float32": 8}
"""Ratios within TIE eps (absolute and relative, on scaled data) of the smallest one tie."""

PIVOT = {"float64": 1e5, "float32": 8}
"""A column entry counts as positive above PIVOT eps times the largest entry of its column."""


class Basis(NamedTuple):
    """Where the path stands, without the matrix. Labels: j is w_j, m + j is z_j, 2 m is z0."""

    exchange: Exchange
    values: jax.Array
    """(m,) basic values"""
    basic: jax.Array
    """(m,) int32, label of the basic variable of each row"""
    nonbasic: jax.Array
    """(m + 1,) int32, label of the variable of each column"""
    entering: jax.Array
    """int32, column of the variable that enters next"""
    outcome: jax.Array
    """int32 `Status`; MAX_STEPS while the path goes on"""

    @property
    def done(self):
        return self.outcome != int(Status.MAX_STEPS)


class Tableau(NamedTuple):
    """State of the method."""

    T: jax.Array
    """(m, m + 1) the tableau before `basis.exchange`"""
    basis: Basis
    data: Scaled
    """the problem balanced by powers of two, constant"""

    @property
    def done(self):
        return self.basis.done


@dataclasses.dataclass(frozen=True)
class Lemke:
    """Lexicographic Lemke.

    covering: the vector d > 0, one number per contact, None for ones. It is a choice: another d may reach another
    solution, or one where the first ends on a ray. It refers to the problem balanced by powers of two.
    max_steps: pivot cap; None for `pivoting.pivot_budget`.
    Raises ValueError for a covering vector that is not positive and finite, or a cap below one.

    >>> solve(LCP(M, q), Lemke(covering=(1.0, 2.0)))
    """

    covering: tuple[float, ...] | None = None
    max_steps: int | None = None
    lanes_last = True

    def __post_init__(self):
        if self.covering is not None:
            covering = tuple(float(d) for d in self.covering)
            if not all(0 < d < float("inf") for d in covering):
                raise ValueError(f"Lemke: covering must be positive and finite, got {covering}; ones will do")
            object.__setattr__(self, "covering", covering)
        check_cap(self)

    def budget(self, m):
        """Pivots allowed for m contacts."""
        return self.max_steps or pivot_budget(m)

    def compiled(self, problem: LCP, start, certified):
        """The same pivots by a compiled kernel; `start` is not used."""
        q = problem.q
        covering = q[:0] if self.covering is None else self._covering(q)
        return native.lemke(problem.M, q, covering, self.budget(q.shape[0]), certified)

    def init(self, problem: LCP, start):
        """The basis after the first pivot, in which z0 has replaced the most violated row; `start` is not used."""
        data = scaled(problem.M, problem.q)
        q, m = data.q, data.q.shape[0]
        d = self._covering(q)
        T = jnp.concatenate([data.M, d[:, None]], axis=1)
        labels = jnp.arange(2 * m + 1, dtype=jnp.int32)
        outcome = jnp.where(jnp.all(q >= 0), int(Status.SOLVED), int(Status.MAX_STEPS)).astype(jnp.int32)
        basis = Basis(no_exchange(T), q, labels[:m], labels[m:], jnp.int32(m), outcome)
        leaving, _ = _leaving(basis, T, d, jnp.ones(m, bool))
        return Tableau(T, _entered(basis, leaving, ~basis.done, d, entry(T, leaving)), data)

    def step(self, problem: LCP, state: Tableau):
        """One pivot; nothing where the path has ended. In parts behind walls: XLA runs few short operations in a row
        quicker than many."""
        T = exchanged(state.T, state.basis.exchange)
        leaving, column, blocked = walled(_blocking)(state.basis, T)
        basis = walled(_pivoted)(state.basis, leaving, column, blocked, entry(T, leaving))
        return Tableau(T, basis, state.data)

    def read(self, problem: LCP, state: Tableau):
        """The answer in the caller's units, corrected with the final basis; on a ray, its direction as certificate."""
        basis, data = state.basis, state.data
        T, m = exchanged(state.T, basis.exchange), len(basis.values)

        def correction(miss):
            """What w_j nonbasic, raised by miss_j, does to z; basic w_j take it without touching z."""
            of_columns = jnp.where(basis.nonbasic < m, miss[jnp.clip(basis.nonbasic, 0, m - 1)], 0)
            return _z_of(dot(T, of_columns), basis.basic)

        z = refined(data.M, data.q, _z_of(basis.values, basis.basic), correction)
        ray = basis.outcome == int(Status.RAY)
        direction = jnp.where(ray, _ray(T, basis), 0)
        # y = -u in the normal form; the size of u is free, so only the rows' units are undone
        certificate = -data._replace(size_M=data.size_q).unscale(direction)
        return Answer(data.unscale(z), basis.outcome, certificate)

    def _covering(self, q):
        if self.covering is None:
            return jnp.ones_like(q)
        if len(self.covering) != q.shape[0]:
            raise ValueError(f"Lemke: covering has {len(self.covering)} entries for {q.shape[0]} contacts")
        return jnp.array(self.covering, q.dtype)


def _blocking(basis, T):
    """(row that leaves, the entering column as it falls, whether anything blocks)."""
    column = -entry(T, basis.entering, 1)
    floor = PIVOT[T.dtype.name] * jnp.finfo(T.dtype).eps * greatest_numbers(lax.abs(column))[0]
    leaving, blocked = _leaving(basis, T, column, column > floor[None])
    return leaving, column, blocked


def _leaving(basis, T, column, candidates):
    """(row, whether there is one): the lexicographically smallest (values, inverse of the basis) / column among the
    candidates. z0 wins any tie of the values."""
    ratio = jnp.where(candidates, basis.values / jnp.where(candidates, column, 1), jnp.inf)
    tied = candidates & _smallest(ratio)
    first = tied & (basis.basic == 2 * len(column))
    key = jnp.where(first, -1.0, jnp.where(tied, 0.0, 1.0)).astype(column.dtype)
    best, row = least_entry(key)
    open_tie = (jnp.sum(tied, axis=0, dtype=jnp.int32) > 1) & (best == 0) & ~basis.done
    decided = where_needed(jnp.any(open_tie), _lexicographic, row, basis, T, column, tied)
    return jnp.where(open_tie, decided, row), best <= 0  # another lane's tie is none of this one's


def _lexicographic(basis, T, column, tied):
    """The one of the tied rows with the lexicographically smallest row of (inverse of the basis) / column."""
    m = len(column)

    def narrowed(j, tied):
        """Column j of the inverse is the fall of the basis as w_j rises, or a unit vector where w_j is basic."""
        place, unit = basis.nonbasic == j, (basis.basic == j).astype(T.dtype)
        of_w = jnp.where(jnp.any(place, axis=0)[None], -entry(T, first_index(place), 1), unit)
        return tied & _smallest(jnp.where(tied, of_w / jnp.where(tied, column, 1), jnp.inf))

    tied = lax.fori_loop(0, m, narrowed, tied)
    return first_index(tied)


def _smallest(ratio):
    """bool: entries equal to the smallest one up to the tolerance of ties."""
    tie = TIE[ratio.dtype.name] * jnp.finfo(ratio.dtype).eps
    least = least_entry(ratio)[0][None]
    return ratio <= least + tie * (1 + lax.abs(least))


def _pivoted(basis, leaving, column, blocked, across):
    """The basis after the pivot, or at the end of a ray."""
    entered = _entered(basis, leaving, blocked & ~basis.done, -column, across)
    ray = jnp.where(blocked | basis.done, entered.outcome, int(Status.RAY))
    return entered._replace(outcome=ray.astype(jnp.int32))


def _entered(basis, leaving, go, down, across):
    """The entering variable exchanged with the basic one of row `leaving`, where `go`; its complement enters next."""
    m, here = len(basis.values), basis.entering
    exchange, values = exchange_of(go, leaving, here, across, down, basis.values)
    new, left = entry(basis.nonbasic, here), entry(basis.basic, leaving)
    nonbasic = jnp.where(rows_of(basis.nonbasic) == exchange.column[None], left[None], basis.nonbasic)
    complement = jnp.where(left < m, left + m, left - m)
    outcome = jnp.where(left == 2 * m, int(Status.SOLVED), int(Status.MAX_STEPS))
    return Basis(
        exchange=exchange,
        values=values,
        basic=jnp.where(rows_of(values) == exchange.row[None], new[None], basis.basic),
        nonbasic=nonbasic,
        entering=jnp.where(go, first_index(nonbasic == complement[None]), here),
        outcome=jnp.where(go, outcome, basis.outcome).astype(jnp.int32),
    )


def _z_of(values, basic):
    """(m,) z from basic values and labels."""
    m = values.shape[0]
    j = jnp.arange(m, dtype=jnp.int32)
    return jnp.sum(jnp.where(basic[:, None] == m + j[None, :], values[:, None], 0), axis=0)


def _ray(T, basis):
    """(m,) the z-part of the direction in which nothing blocks: entering grows by one, the basis by its column."""
    m = len(basis.values)
    label = entry(basis.nonbasic, basis.entering)
    entering = (label == m + jnp.arange(m, dtype=jnp.int32)).astype(T.dtype)
    return jnp.maximum(_z_of(entry(T, basis.entering, 1), basis.basic) + entering, 0)
