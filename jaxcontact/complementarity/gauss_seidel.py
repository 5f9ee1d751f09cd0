"""Projected Gauss-Seidel: row after row, z_i <- max(0, z_i - relaxation w_i / M_ii).

Converges for symmetric positive semidefinite M (Luo and Tseng 1989) and for H-matrices with positive diagonal (Pang;
Cottle, Pang, Stone ch. 5); for other P-matrices it may cycle or overflow. In a stack of boxes with mass ratio r it
takes about 39 r sweeps for six digits. Rows with M_ii <= 0 cannot be updated: their z_i stays where it started.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact import native
from jaxcontact.complementarity.forms import normal_form
from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.residuals import residuals
from jaxcontact.complementarity.short import dot, first_index, rows_of
from jaxcontact.complementarity.status import Status

STOP_AT = 4
"""Without a tolerance, the iteration stops at a backward error of STOP_AT eps, well inside what the judge accepts."""

UNROLLED_ROWS = 8
"""Up to this size one sweep is unrolled over its rows."""


class Iterate(NamedTuple):
    """Where an iteration stands."""

    z: jax.Array
    """(m,) >= 0"""
    error: jax.Array
    """backward error eta of z, as the judge measures it"""
    done: jax.Array
    """bool"""


@dataclasses.dataclass(frozen=True)
class ProjectedGaussSeidel:
    """Projected Gauss-Seidel with relaxation and a budget of sweeps.

    sweeps: the budget; when it runs out first the status is MAX_STEPS and the iterate is in `Solution.attempt`.
    relaxation: in (0, 2); below one damps, above one extrapolates.
    tolerance: stop at this backward error. None: stop at what the judge accepts. Larger ones give INACCURATE and the
    iterate in `attempt`: a loose answer is not called solved. Raises ValueError for values outside these ranges.

    >>> solve(LCP(M, q), ProjectedGaussSeidel(sweeps=200), start=z_before)
    """

    sweeps: int = 1000
    relaxation: float = 1.0
    tolerance: float | None = None

    def __post_init__(self):
        if self.sweeps < 1:
            raise ValueError(f"ProjectedGaussSeidel: sweeps must be at least 1, got {self.sweeps}")
        if not 0 < self.relaxation < 2:
            raise ValueError(f"ProjectedGaussSeidel: relaxation must be in (0, 2), got {self.relaxation}")
        if self.tolerance is not None and not 0 < self.tolerance < 1:
            raise ValueError(f"ProjectedGaussSeidel: tolerance must be in (0, 1) or None, got {self.tolerance}")

    def budget(self, m):
        """Sweeps allowed."""
        return self.sweeps

    def compiled(self, problem: LCP, start, certified):
        """The same sweeps by a compiled kernel."""
        start = problem.q[:0] if start is None else start.astype(problem.q.dtype)
        target = self._target(start.dtype)
        return native.gauss_seidel(problem.M, problem.q, start, self.sweeps, self.relaxation, target, certified)

    def init(self, problem: LCP, start):
        """The start, or zero."""
        z = jnp.zeros_like(problem.q) if start is None else start.astype(problem.q.dtype)
        return self._measured(problem, z)

    def step(self, problem: LCP, state: Iterate):
        """One sweep over all rows."""
        m = problem.q.shape[0]
        diagonal = jnp.diagonal(problem.M)
        step = jnp.where(diagonal > 0, self.relaxation / jnp.where(diagonal > 0, diagonal, 1), 0)

        def row(i, z):
            w = dot(problem.M[i], z) + problem.q[i]
            moved = jnp.maximum(z[i] - step[i] * w, 0)
            return jnp.where(jnp.arange(m) == i, moved, z)

        z = state.z
        if m <= UNROLLED_ROWS:
            for i in range(m):
                z = row(i, z)
        else:
            z = lax.fori_loop(0, m, row, z)
        return self._measured(problem, z)

    def read(self, problem: LCP, state: Iterate):
        """The iterate; a violated row without positive entries is a certificate that nothing is feasible."""
        outcome = jnp.where(state.done, int(Status.SOLVED), int(Status.MAX_STEPS)).astype(jnp.int32)
        return Answer(state.z, outcome, hopeless_row(problem))

    def _measured(self, problem, z):
        error = residuals(problem, normal_form(problem), z[:0], z, z)[0]
        return Iterate(z, error, (error <= self._target(z.dtype)) | ~lax.is_finite(error))

    def _target(self, dtype):
        return float(STOP_AT * jnp.finfo(dtype).eps) if self.tolerance is None else self.tolerance


def hopeless_row(problem: LCP):
    """(m,) certificate -e_i for the first row with q_i < 0 and no positive entry, as of two immovable bodies; or 0."""
    hopeless = (problem.q < 0) & jnp.all(problem.M <= 0, axis=1)
    return -(hopeless & (rows_of(hopeless) == first_index(hopeless))).astype(problem.q.dtype)
