"""What a solve returns."""

import jax

from jaxcontact.complementarity.records import record
from jaxcontact.complementarity.status import Status


@record
class Solution:
    """The judged answer of one problem; under vmap every field carries the batch axes in front.

    Where the status is neither SOLVED nor REDUNDANT, `free`, `z` and `w` are NaN and have zero derivative; `attempt`
    keeps what the method proposed.

    >>> solution = solve(LCP(M, q), Lemke()); Status(int(solution.status)).sentence
    """

    z: jax.Array
    """(m,) complementary unknown, >= 0: z of an LCP, v of a mixed problem, the positive part of x."""
    w: jax.Array
    """(m,) its partner: M z + q as recomputed from the caller's data, or the negative part of x."""
    free: jax.Array
    """(k,) unknowns without a sign: u of a mixed problem, x of an absolute value equation; else (0,)."""
    status: jax.Array
    """int32, a `Status`."""
    residual: jax.Array
    """rho: the largest violation relative to max|q|; honest about the answer."""
    backward_error: jax.Array
    """eta: the largest violation relative to the sizes that enter it; honest about rounding."""
    steps: jax.Array
    """int32: pivots, sweeps or iterations."""
    active: jax.Array
    """(m,) bool: z_i is positive beyond rounding."""
    degenerate: jax.Array
    """int32: how many i have z_i = w_i = 0 up to rounding; there the answer has a kink."""
    redundant: jax.Array
    """bool: the rows of the active and degenerate contacts depend on one another, so z is one of several."""
    condition: jax.Array
    """condition number of the active and degenerate equations, balanced, largest-row-sum norm; inf if dependent."""
    attempt: jax.Array
    """(m,) the proposed z, whatever the status."""
    start_used: jax.Array
    """bool: a warm start was given, finite and non-negative, and the method used it."""

    @property
    def answered(self):
        """bool: SOLVED or REDUNDANT."""
        return (self.status == int(Status.SOLVED)) | (self.status == int(Status.REDUNDANT))
