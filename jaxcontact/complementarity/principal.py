"""Principal pivoting for P-matrices: exchange z_i with w_i where a sign is wrong, until none is.

The tableau always writes the basic variables by the others, basic = T nonbasic + values, with T = M and values = q at
the start; a principal pivot exchanges w_r and z_r and is one rank-one update. Each T is again a P-matrix, so every
diagonal entry is a pivot. The row with the most negative value is taken first (Zoutendijk; Bard 1972); that is quick
but may cycle, so after QUICK steps per row the first negative row is taken: that rule is finite for every P-matrix,
from any basis (Murty 1974). Júdice and Pires combine the two in the same way, Comput. Oper. Res. 21 (1994).
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
from jaxcontact.complementarity.short import dot, entry, greatest_numbers, least_entry, rows_of
from jaxcontact.complementarity.status import Status
from jaxcontact.linalg import walled

NEGATIVE = {"float64": 64, "float32": 16}
"""A value counts as negative below -NEGATIVE eps times the size of its kind, z or w."""

PIVOT = {"float64": 64, "float32": 8}
"""A diagonal entry is a pivot above PIVOT eps times the largest entry of its row."""

QUICK = 8
"""Steps per row, about sixteen times what is usual, after which the first negative row is taken instead of the most
negative one."""


class Basis(NamedTuple):
    """Where the pivoting stands, without the matrix."""

    exchange: Exchange
    values: jax.Array
    """(m,) basic values"""
    active: jax.Array
    """(m,) bool: z_i is basic, else w_i"""
    wanted: jax.Array | None
    """(m,) bool: rows of a warm start that are still to become active; None without one"""
    barred: jax.Array
    """(m,) bool: rows found to have no pivot in this tableau"""
    quick: jax.Array
    """int32: steps left until the first negative row is taken instead of the most negative one"""
    row: jax.Array
    """int32: the row to pivot next; where nothing can be done, a negative one"""
    outcome: jax.Array
    """int32 `Status`; MAX_STEPS while the path goes on"""

    @property
    def done(self):
        return self.outcome != int(Status.MAX_STEPS)


class Tableau(NamedTuple):
    """State of the method."""

    T: jax.Array
    """(m, m) the tableau before `basis.exchange`"""
    basis: Basis
    data: Scaled
    """the problem balanced by powers of two, constant"""

    @property
    def done(self):
        return self.basis.done


@dataclasses.dataclass(frozen=True)
class PrincipalPivoting:
    """Principal pivoting on the most negative row, Murty's rule where that makes no progress.

    Finite for P-matrices, as frictionless contacts without redundancy and sliding ones below the critical friction have
    them; for others it may stop without a pivot (INACCURATE, or INFEASIBLE with a certificate) or run out of steps,
    even where solutions exist: use Lemke there. Beyond P-matrices compiled kernels may find another solution than the
    code in JAX, or one where that finds none. A start is used for its signs: the rows with start > 0 become active
    first. max_steps: pivot cap, None for the default by size; ValueError below one.

    >>> solve(LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]), PrincipalPivoting()).z     # (4/3, 7/3)
    """

    max_steps: int | None = None
    lanes_last = True

    def __post_init__(self):
        check_cap(self)

    def budget(self, m):
        """Pivots allowed for m contacts."""
        return self.max_steps or pivot_budget(m)

    def compiled(self, problem: LCP, start, certified):
        """The same by a compiled kernel, for few contacts in another order of pivots."""
        wanted = (problem.q[:0] if start is None else start) > 0
        return native.principal(problem.M, problem.q, wanted, self.budget(problem.q.shape[0]), certified)

    def init(self, problem: LCP, start):
        """The basis of all w, and the first row."""
        data = scaled(problem.M, problem.q)
        m = data.q.shape[0]
        none = jnp.zeros(m, bool)
        wanted = None if start is None else start > 0
        fresh = jnp.int32(QUICK * m), jnp.int32(0), jnp.int32(Status.MAX_STEPS)
        basis = Basis(no_exchange(data.M), data.q, none, wanted, none, *fresh)
        return Tableau(data.M, _choice(basis, _urgency(basis)), data)

    def step(self, problem: LCP, state: Tableau):
        """One pivot, if the row has one, and the choice of the next row; nothing where the path has ended.

        In three parts behind walls: XLA runs few short operations in a row quicker than many."""
        T = exchanged(state.T, state.basis.exchange)
        basis, urgency = walled(_pivoted)(state.basis, *walled(_cross)(T, state.basis.row))
        return Tableau(T, walled(_choice)(basis, urgency), state.data)

    def read(self, problem: LCP, state: Tableau):
        """The answer in the caller's units, corrected with the final inverse; a row without positive entries and with a
        negative value is a certificate that nothing is feasible."""
        basis, data = state.basis, state.data
        T, active = exchanged(state.T, basis.exchange), basis.active

        def correction(w):
            return jnp.where(active, dot(T, jnp.where(active, w, 0)), 0)

        z = refined(data.M, data.q, jnp.where(active, basis.values, 0), correction)
        stuck = basis.outcome == int(Status.INACCURATE)
        proof = jnp.where(stuck, -_multipliers(T, basis.row, active), 0)
        # the size of a certificate is free, so only the rows' units are undone
        return Answer(data.unscale(z), basis.outcome, data._replace(size_M=data.size_q).unscale(proof))


def _cross(T, r):
    """Row and column r of T (m,), (m,)."""
    return entry(T, r), entry(T, r, 1)


def _pivoted(basis, across, column):
    """The basis with z_r and w_r exchanged in the chosen row r, or with the row barred if its diagonal entry is no
    pivot, and the urgency of its rows."""
    r = basis.row
    limit = PIVOT[across.dtype.name] * jnp.finfo(across.dtype).eps
    go = (entry(across, r) > limit * greatest_numbers(lax.abs(across))[0]) & ~basis.done
    exchange, values = exchange_of(go, r, r, across, column, basis.values)
    here = rows_of(column) == r[None]
    basis = basis._replace(
        exchange=exchange,
        values=values,
        active=basis.active ^ (here & go[None]),
        wanted=None if basis.wanted is None else basis.wanted & ~here,
        barred=~go[None] & (basis.barred | here),
        quick=basis.quick - 1,
    )
    return basis, _urgency(basis)


def _urgency(basis):
    """(m,) below zero where a row may be pivoted, lower where it should be first; zero where a row is negative but
    barred, one where nothing is to be done."""
    values = basis.values
    negative = values < -NEGATIVE[values.dtype.name] * jnp.finfo(values.dtype).eps * _sizes(basis)
    depth = jnp.where(basis.quick[None] > 0, values, -1)
    urgency = jnp.where(negative, jnp.where(basis.barred, 0, depth), 1)
    if basis.wanted is None:
        return urgency
    warm = jnp.any(basis.wanted, axis=0)[None]
    return jnp.where(warm, jnp.where(basis.wanted, -1.0, 1.0), urgency)


def _choice(basis, urgency):
    """The basis with its next row and its outcome: SOLVED without negative value, INACCURATE without pivot."""
    urgent, row = least_entry(urgency)
    ended = jnp.where(urgent == 0, int(Status.INACCURATE), int(Status.SOLVED))
    outcome = jnp.where(urgent < 0, int(Status.MAX_STEPS), ended)
    return basis._replace(row=row, outcome=jnp.where(basis.done, basis.outcome, outcome).astype(jnp.int32))


def _sizes(basis):
    """(m,) the size of the values of its kind, for each row; w are of size one at least, as the load is."""
    size = lax.abs(basis.values)
    size_z, size_w = greatest_numbers(jnp.where(basis.active, size, 0), size)
    return jnp.where(basis.active, size_z[None], jnp.maximum(size_w, 1)[None])


def _multipliers(T, row, active):
    """(m,) y >= 0 with y'M <= 0 and y'q < 0, if the chosen row has no positive entry: the row is y'(w - M z) = y'q."""
    across = entry(T, row)
    here = rows_of(across) == row[None]
    return jnp.maximum((here & ~active).astype(T.dtype) - jnp.where(active, across, 0), 0)
