"""Principal pivoting for P-matrices: exchange z_i with w_i where a sign is wrong, until none is.

The tableau always writes the basic variables by the others, basic = T nonbasic + values, with T = M and values = q at
the start; a principal pivot exchanges w_r and z_r and is one rank-one update. Each T is again a P-matrix, so every
diagonal entry is a pivot. The row with the most negative value is taken first (Zoutendijk; Bard 1972); that is quick
but may cycle, so after PATIENCE steps without fewer negative values than ever before, the first negative row is taken
until there are: that rule alone is finite for every P-matrix (Murty 1974). The combination is Júdice and Pires', Linear
Complementarity and block pivoting, Comput. Oper. Res. 21 (1994).
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.pivoting import check_cap, pivot_budget, refined
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.scaling import Scaled, scaled
from jaxcontact.complementarity.short import diagonal_of, dot, first, greatest, largest, largest_of_rows
from jaxcontact.complementarity.status import Status

NEGATIVE = {"float64": 64, "float32": 16}
"""A value counts as negative below -NEGATIVE eps times the size of its kind, z or w."""

PIVOT = {"float64": 64, "float32": 8}
"""A diagonal entry is a pivot above PIVOT eps times the largest entry of its row."""

PATIENCE = 10
"""Steps granted to the most negative row without a new least count of negative values."""


class Tableau(NamedTuple):
    """Where the pivoting stands."""

    tableau: jax.Array
    """(m, m) T"""
    values: jax.Array
    """(m,) basic values"""
    active: jax.Array
    """(m,) bool: z_i is basic, else w_i"""
    wanted: jax.Array
    """(m,) bool: rows of a warm start that are still to become active"""
    row: jax.Array
    """(m,) bool: the row to pivot next, alone; where nothing can be done, the most negative one"""
    least: jax.Array
    """int32: fewest negative values met so far"""
    patience: jax.Array
    """int32: steps left before the first negative row is taken instead of the most negative one"""
    outcome: jax.Array
    """int32 `Status`; MAX_STEPS while the path goes on"""
    data: Scaled
    """the problem balanced by powers of two, constant"""

    @property
    def done(self):
        return self.outcome != int(Status.MAX_STEPS)


@dataclasses.dataclass(frozen=True)
class PrincipalPivoting:
    """Principal pivoting on the most negative row, Murty's rule where that makes no progress.

    Finite for P-matrices, as frictionless contacts without redundancy and sliding ones below the critical friction have
    them; for others it may stop without a pivot (INACCURATE, or INFEASIBLE with a certificate) or run out of steps,
    even where solutions exist: use Lemke there. A start is used for its signs: the rows with start > 0 become active
    first. max_steps: pivot cap, None for the default by size; ValueError below one.

    >>> solve(LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]), PrincipalPivoting()).z     # (4/3, 7/3)
    """

    max_steps: int | None = None

    def __post_init__(self):
        check_cap(self)

    def budget(self, m):
        """Pivots allowed for m contacts."""
        return self.max_steps or pivot_budget(m)

    def init(self, problem: LCP, start):
        """The basis of all w, and the first row."""
        data = scaled(problem.M, problem.q)
        m = data.q.shape[0]
        none = jnp.zeros(m, bool)
        wanted = none if start is None else start > 0
        fresh = jnp.int32(m + 1), jnp.int32(PATIENCE), jnp.int32(Status.MAX_STEPS)
        return _choose(Tableau(data.M, data.q, none, wanted, none, *fresh, data))

    def step(self, problem: LCP, state: Tableau):
        """One pivot and the choice of the next row."""
        return _choose(_pivot(state))

    def read(self, problem: LCP, state: Tableau):
        """The answer in the caller's units, corrected with the final inverse; a row without positive entries and with a
        negative value is a certificate that nothing is feasible."""
        active, data = state.active, state.data

        def correction(w):
            return jnp.where(active, dot(state.tableau, jnp.where(active, w, 0)), 0)

        z = refined(data.M, data.q, jnp.where(active, state.values, 0), correction)
        stuck = state.outcome == int(Status.INACCURATE)
        proof = jnp.where(stuck, -_multipliers(state), 0)
        # the size of a certificate is free, so only the rows' units are undone
        return Answer(data.unscale(z), state.outcome, data._replace(size_M=data.size_q).unscale(proof))


def _pivot(state):
    """Exchange z_r and w_r in the chosen row r."""
    row, T = state.row, state.tableau
    across, down = row[:, None], row[None, :]
    pivot_row = jnp.sum(jnp.where(across, T, 0), axis=0)
    column = jnp.sum(jnp.where(down, T, 0), axis=1)
    p = jnp.sum(jnp.where(row, pivot_row, 0))
    p = jnp.where(p == 0, 1, p)  # only where nothing is to be done, and then the result is thrown away
    pivot_row = pivot_row / p
    value = jnp.sum(jnp.where(row, state.values, 0)) / p
    exchanged = T - column[:, None] * pivot_row[None, :]
    exchanged = jnp.where(down, (column / p)[:, None], exchanged)
    return state._replace(
        tableau=jnp.where(across, jnp.where(down, 1 / p, -pivot_row[None, :]), exchanged),
        values=jnp.where(row, -value, state.values - column * value),
        active=state.active ^ row,
        wanted=state.wanted & ~row,
        patience=state.patience - 1,
    )


def _choose(state):
    """The state with its next row and its outcome: SOLVED without negative value, INACCURATE without pivot."""
    T, values = state.tableau, state.values
    eps = jnp.finfo(values.dtype).eps
    usable = diagonal_of(T) > PIVOT[values.dtype.name] * eps * largest_of_rows(T)
    wanted = state.wanted & usable
    size_z = largest(jnp.where(state.active, values, 0))
    size = jnp.where(state.active, size_z, jnp.maximum(jnp.maximum(size_z, largest(values)), 1))
    negative = values < -NEGATIVE[values.dtype.name] * eps * size
    count = jnp.sum(negative).astype(jnp.int32)
    fewer = count < state.least
    patience = jnp.where(fewer, PATIENCE, state.patience)
    can = negative & usable
    worst = jnp.where(jnp.any(can), can, negative)
    worst = worst & ((values == -greatest(jnp.where(worst, -values, -jnp.inf), -jnp.inf)) | (patience <= 0))
    warm = jnp.any(wanted)
    outcome = jnp.where(count == 0, int(Status.SOLVED), int(Status.INACCURATE))
    outcome = jnp.where(warm | jnp.any(can), int(Status.MAX_STEPS), outcome)
    return state._replace(
        wanted=wanted,
        row=first(jnp.where(warm, wanted, worst)),
        least=jnp.where(warm, state.least, jnp.minimum(count, state.least)),
        patience=jnp.where(warm, PATIENCE, patience),
        outcome=outcome.astype(jnp.int32),
    )


def _multipliers(state):
    """(m,) y >= 0 with y'M <= 0 and y'q < 0, if the chosen row has no positive entry: the row is y'(w - M z) = y'q."""
    row = jnp.sum(jnp.where(state.row[:, None], state.tableau, 0), axis=0)
    return jnp.maximum((state.row & ~state.active).astype(row.dtype) - jnp.where(state.active, row, 0), 0)
