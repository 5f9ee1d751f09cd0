"""The one judge: residuals recomputed from the caller's data in the caller's dtype, and the status that follows.

No method is believed. Every comparison is written so that NaN fails. What is measured is in `residuals`: the backward
error eta and the residual rho. SOLVED asks for a small eta also of the problem balanced row by row, so that no row
hides behind another one's units.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxcontact import native
from jaxcontact.complementarity.bars import close, moderate, small, telling
from jaxcontact.complementarity.forms import mode_matrix, normal_form
from jaxcontact.complementarity.inverse import analysed_inverse, condition_number
from jaxcontact.complementarity.problems import LCP
from jaxcontact.complementarity.proof import infeasible_somewhere
from jaxcontact.complementarity.residuals import classify, residuals, slack
from jaxcontact.complementarity.short import SCALARS
from jaxcontact.complementarity.status import Status
from jaxcontact.linalg import all_finite, packed, walled, where, where_needed


class Claim(NamedTuple):
    """What a method proposes for the normal form, and how it says it ended."""

    free: jax.Array
    """(k,)"""
    z: jax.Array
    """(m,)"""
    w: jax.Array
    """(m,) ignored where the problem defines w by z."""
    outcome: jax.Array
    """int32 `Status`: SOLVED, or the reason to give if the residual is not small; NO_SOLUTION if `z` is the best of
    all candidates."""
    certificate: jax.Array
    """(k + m,) a row combination y said to prove that no feasible point exists; zeros if there is none."""
    dependent: jax.Array | bool = False
    """bool: no mode of the problem is regular, so that only part of a solution is determined"""
    found: native.Judged | native.Pairs | None = None
    """what a kernel says of the point, where one has looked: then the status too"""


class Verdict(NamedTuple):
    """The judge's findings; see `Solution` for the fields."""

    free: jax.Array
    z: jax.Array
    w: jax.Array
    status: jax.Array
    residual: jax.Array
    backward_error: jax.Array
    active: jax.Array
    degenerate: jax.Array
    """(m,) bool"""
    redundant: jax.Array
    condition: jax.Array


class Told(NamedTuple):
    """Truth values about what was measured."""

    finite: jax.Array
    """the data are"""
    whole: jax.Array
    """the point is finite"""
    small: jax.Array
    """eta, within BACKWARD_ERROR_BOUND"""
    telling: jax.Array
    """rho, within DIGITS_KEPT: eta says enough, whatever the condition"""
    close: jax.Array
    """eta, within DIGITS_OF_ABSENCE"""
    moderate: jax.Array | None = None
    """the condition, within CONDITION_BOUND, where eta is small and rho does not tell; None: nobody has looked at it"""
    proved: jax.Array | None = None
    """the certificate holds, where eta and rho are not small; None likewise"""


class Findings(NamedTuple):
    """What was measured, from the caller's data."""

    w: jax.Array
    eta: jax.Array
    rho: jax.Array
    active: jax.Array
    degenerate: jax.Array
    condition: jax.Array
    told: Told | None
    """None where the status is there already"""


def judge(problem, claim, kernels=False):
    """The `Verdict` on a `Claim`, from the problem's own data; kernels: measured by those of `native`, if an LCP, or if
    one has measured it already.

    >>> one = jnp.ones(1)
    >>> judge(LCP(jnp.eye(1), -one), Claim(one[:0], one, one, jnp.int32(0), 0 * one)).status
    """
    if kernels and isinstance(problem, LCP):
        found = _measured_by_kernel(problem, claim)
        status = claim.found.status if claim.found else _status(problem, claim, found)
    elif isinstance(claim.found, native.Pairs):
        found, status = _measured_with_answer(claim), claim.found.judged.status
    else:
        found = _measured(problem, claim)
        status = _status(problem, claim, found)
    return Verdict(
        free=claim.free,
        z=claim.z,
        w=found.w,
        status=status,
        residual=found.rho,
        backward_error=found.eta,
        active=found.active,
        degenerate=found.degenerate,
        redundant=~moderate(found.condition),
        condition=found.condition,
    )


def _measured(problem, claim):
    """`Findings` of a claim."""
    form = normal_form(problem)
    w = slack(problem, form, claim.free, claim.z, claim.w)
    eta, rho = _in_one(residuals, len(form.q))(problem, form, claim.free, claim.z, claim.w)
    active, degenerate = _in_one(classify, len(form.q))(problem, form, claim.z, w)
    tight = walled(analysed_inverse)(mode_matrix(form, (active | degenerate).astype(w.dtype)))
    condition = where(tight.deficiency > 0, jnp.inf, tight.condition)
    told = Told(all_finite(*form), all_finite(claim.z, w, claim.free), small(eta), telling(rho), close(eta))
    return Findings(w, eta, rho, active, degenerate, condition, told)


def _measured_by_kernel(problem, claim):
    """The same of an LCP by compiled kernels, of which only those run whose results are used."""
    M, q = problem.M, problem.q
    w, active, degenerate = native.classify(M, q, claim.z)
    condition = native.condition(M, active | degenerate)
    if claim.found:
        eta, rho, told = *claim.found[:2], None
    else:
        eta, rho, flags = native.measure(M, q, claim.z, claim.certificate)
        told = Told(*(flags & bit != 0 for bit in BITS))
    return Findings(w, eta, rho, active, degenerate, condition, told)


def _measured_with_answer(claim):
    """The same where the kernel that answered has measured everything."""
    *_, condition, active, degenerate, (eta, rho, _) = claim.found
    return Findings(claim.w, eta, rho, active, degenerate, condition, None)


BITS = Told(
    finite=native.DATA_FINITE,
    whole=native.POINT_FINITE,
    small=native.SMALL,
    telling=native.TELLING,
    close=native.CLOSE,
    moderate=native.MODERATE,
    proved=native.PROVED,
)
"""Of a kernel's flags."""


def _in_one(function, size):
    """`function`, which returns a few numbers or masks, for short arrays in few loops over a batch, each vectorised.
    Long products are loops of their own anyway."""
    return packed(function) if size <= SCALARS else function


def _status(problem, claim, found):
    """Truth table, first line that applies:

    data not finite, or a proposed point that overflowed                BAD_INPUT
    eta small, and rho small or the equations well conditioned          SOLVED (REDUNDANT if dependent)
    the method gave a certificate and it holds                          INFEASIBLE
    eta small, and the method proposed the point as solution or best    ILL_CONDITIONED
    the best of all points is nearly a solution                         INACCURATE
    the method gave a reason                                            that reason
    otherwise                                                           INACCURATE

    The condition and the certificate are looked at where they matter, so that a caller who does not need not pay.
    """
    told, false = found.told, jnp.zeros((), bool)
    claims = claim.outcome == int(Status.SOLVED)
    proposes = claims | (claim.outcome == int(Status.NO_SOLUTION))
    regular = told.moderate
    if regular is None:
        held = found.active | found.degenerate
        regular = where_needed(told.small & ~told.telling, _moderate_at, false, problem, held)
    solved = told.small & (told.telling | regular)
    proved = told.proved
    if proved is None:
        doubtful = told.finite & ~solved
        proved = where_needed(doubtful, infeasible_somewhere, false, doubtful, problem, claim.certificate)
    shaky = where(told.small, int(Status.ILL_CONDITIONED), int(Status.INACCURATE))
    good = where(claim.dependent, int(Status.REDUNDANT), int(Status.SOLVED))
    reason = where(claims | (proposes & told.close), shaky, claim.outcome)
    failed = where(proved, int(Status.INFEASIBLE), reason)
    status = where(solved, good, failed)
    return where(told.finite & (told.whole | ~proposes), status, int(Status.BAD_INPUT)).astype(jnp.int32)


def _moderate_at(problem, held):
    """bool: whether the condition number of the mode in which the pairs `held` press is moderate."""
    form = normal_form(problem)
    return moderate(condition_number(mode_matrix(form, held.astype(form.q.dtype))))
