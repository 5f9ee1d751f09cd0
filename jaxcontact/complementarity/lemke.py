"""Lemke's complementary pivoting with lexicographic ties, in the revised form with an explicit basis inverse.

Basis equations: w - M z - d z0 = q. From the basis of all w, the artificial z0 enters, then always the complement of
what has just left, until z0 leaves (a solution) or nothing blocks (a ray). Lemke, Management Science 11 (1965);
lexicographic rule: Cottle, Pang, Stone 4.9, Murty 1988, 2.2. What makes it work in floating point are decisions, not
drift: powers-of-two scaling, ties with a two-sided tolerance, a pivot threshold relative to the column, and z0 leaving
whenever it ties.

Layout: one rank-one update of (m, m) per pivot, no scatter, so that a batch vectorises.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact import linalg
from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.pivoting import check_cap, pivot_budget, refined
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.scaling import Scaled, scaled
from jaxcontact.complementarity.status import Status

TIE = {"float64": 1e4, "float32": 8}
"""Ratios within TIE eps (absolute and relative, on scaled data) of the smallest one tie."""

PIVOT = {"float64": 1e5, "float32": 8}
"""A column entry counts as positive above PIVOT eps times the largest entry of its column."""


class Tableau(NamedTuple):
    """Where the path stands. Labels: j is w_j, m + j is z_j, 2 m is z0."""

    inverse: jax.Array
    """(m, m) basis inverse"""
    values: jax.Array
    """(m,) basic values, inverse @ q"""
    basis: jax.Array
    """(m,) int32, label of each basic variable"""
    entering: jax.Array
    """int32, label of the variable that enters next"""
    outcome: jax.Array
    """int32 `Status`; MAX_STEPS while the path goes on"""
    data: Scaled
    """the problem balanced by powers of two, constant"""

    @property
    def done(self):
        return self.outcome != int(Status.MAX_STEPS)


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

    def init(self, problem: LCP, start):
        """The basis after the first pivot, in which z0 has replaced the most violated row; `start` is not used."""
        data = scaled(problem.M, problem.q)
        q, m = data.q, data.q.shape[0]
        eye, rows = jnp.eye(m, dtype=q.dtype), jnp.arange(m, dtype=jnp.int32)
        d = self._covering(q)
        leaving = _lexicographic_minimum(q, eye, d, jnp.ones(m, bool))
        outcome = jnp.where(jnp.all(q >= 0), int(Status.SOLVED), int(Status.MAX_STEPS)).astype(jnp.int32)
        first = Tableau(eye, q, rows, jnp.int32(2 * m), outcome, data)
        pivoted = _pivot(first, -d, leaving)
        return jax.tree.map(lambda a, b: jnp.where(first.done, a, b), first, pivoted)

    def step(self, problem: LCP, state: Tableau):
        """One pivot."""
        M, q, m = state.data.M, state.data.q, state.values.shape[0]
        column = self._column(M, state)
        floor = PIVOT[q.dtype.name] * jnp.finfo(q.dtype).eps * linalg.greatest(jnp.abs(column))
        blocking = column > floor
        leaving = _lexicographic_minimum(state.values, state.inverse, column, blocking, state.basis == 2 * m)
        pivoted = _pivot(state, column, leaving)
        ray = ~jnp.any(blocking)
        return Tableau(
            *(jnp.where(ray, old, new) for old, new in zip(state[:4], pivoted[:4], strict=True)),
            outcome=jnp.where(ray, int(Status.RAY), pivoted.outcome),
            data=state.data,
        )

    def read(self, problem: LCP, state: Tableau):
        """The answer in the caller's units, corrected with the final basis; on a ray, its direction as certificate."""
        data = state.data
        z = _refined(data.M, data.q, state)
        ray = state.outcome == int(Status.RAY)
        direction = jnp.where(ray, _ray(state, self._column(data.M, state)), 0)
        # y = -u in the normal form; the size of u is free, so only the rows' units are undone
        certificate = -data._replace(size_M=data.size_q).unscale(direction)
        return Answer(data.unscale(z), state.outcome, certificate)

    def _covering(self, q):
        if self.covering is None:
            return jnp.ones_like(q)
        if len(self.covering) != q.shape[0]:
            raise ValueError(f"Lemke: covering has {len(self.covering)} entries for {q.shape[0]} contacts")
        return jnp.array(self.covering, q.dtype)

    def _column(self, M, state):
        """(m,) the entering column in the current basis: inverse @ (e_j, -M_j or -d)."""
        m = M.shape[0]
        j = jnp.arange(m, dtype=jnp.int32)
        is_w, is_z = state.entering == j, state.entering == m + j
        original = jnp.sum(jnp.where(is_z[None, :], -M, 0), axis=1) + is_w.astype(M.dtype)
        return jnp.sum(state.inverse * original[None, :], axis=1)


def _pivot(state, column, leaving):
    """Exchange the entering variable with the one of row `leaving` (m,) one-hot; its complement enters next."""
    m = column.shape[0]
    p = jnp.sum(jnp.where(leaving, column, 0))
    p = jnp.where(p == 0, 1, p)  # only where nothing blocks, and then the result is thrown away
    left = jnp.sum(jnp.where(leaving, state.basis, 0)).astype(jnp.int32)
    row = jnp.sum(jnp.where(leaving[:, None], state.inverse, 0), axis=0) / p
    value = jnp.sum(jnp.where(leaving, state.values, 0)) / p
    return state._replace(
        inverse=jnp.where(leaving[:, None], row[None, :], state.inverse - column[:, None] * row[None, :]),
        values=jnp.where(leaving, value, state.values - column * value),
        basis=jnp.where(leaving, state.entering, state.basis),
        entering=jnp.where(left < m, left + m, left - m),
        outcome=jnp.where(left == 2 * m, int(Status.SOLVED), int(Status.MAX_STEPS)).astype(jnp.int32),
    )


def _lexicographic_minimum(values, inverse, column, candidates, preferred=None):
    """(m,) one-hot: the row with the lexicographically smallest (values, inverse) / column among the candidates.

    Ratios closer than the tie tolerance are equal, in every column alike; a preferred row wins any tie of the values.
    """
    m = values.shape[0]
    tie = TIE[values.dtype.name] * jnp.finfo(values.dtype).eps
    safe = jnp.where(candidates, column, 1)

    def keep_smallest(tied, entries):
        ratio = jnp.where(tied, entries / safe, jnp.inf)
        smallest = linalg.least(ratio)
        return tied & (ratio <= smallest + tie * (1 + jnp.abs(smallest)))

    tied = keep_smallest(candidates, values)
    if preferred is not None:
        tied = jnp.where(jnp.any(tied & preferred), tied & preferred, tied)
    if m <= UNROLLED:
        for j in range(m):
            tied = keep_smallest(tied, inverse[:, j])
    else:
        tied = lax.fori_loop(0, m, lambda j, t: keep_smallest(t, lax.dynamic_index_in_dim(inverse, j, 1, False)), tied)
    return tied & (jnp.cumsum(tied.astype(jnp.int32)) == 1)


UNROLLED = 8
"""Up to this size the lexicographic comparison is unrolled; beyond, a loop keeps compilation short."""


def _refined(M, q, state):
    """(m,) z >= 0 of the final basis after correction steps with its inverse. In the columns of basic w_i the inverse
    is a unit vector: what these equations miss changes no z."""

    def correction(miss):
        return -_z_of(jnp.sum(state.inverse * miss[None, :], axis=1), state.basis)

    return refined(M, q, _z_of(state.values, state.basis), correction)


def _z_of(values, basis):
    """(m,) z from basic values and labels."""
    m = values.shape[0]
    j = jnp.arange(m, dtype=jnp.int32)
    return jnp.sum(jnp.where(basis[:, None] == m + j[None, :], values[:, None], 0), axis=0)


def _ray(state, column):
    """(m,) the z-part of the direction in which nothing blocks: entering grows by one, the basis by -column."""
    m = column.shape[0]
    j = jnp.arange(m, dtype=jnp.int32)
    return jnp.maximum(_z_of(-column, state.basis) + (state.entering == m + j).astype(column.dtype), 0)
