"""The one judge: residuals recomputed from the caller's data in the caller's dtype, and the status that follows.

No method is believed. Every comparison is written so that NaN fails. The residuals are those of numerics of
complementarity: with r_i the violation of row i,

    eta = max_i |min(z_i / |z|_max, w_i / s)|,   s = max_i (|M| |z| + |q|)_i      backward error
    rho = max_i |min(t_i z_i, w_i)| / max|q|,    t_i = M_ii (or the row's size where M_ii <= 0)

and for equations |r_i| / s and |r_i| / max|q|. Both are unchanged by M -> M 2^a, q -> q 2^b. SOLVED asks for a small
eta also of the problem balanced row by row, so that no row hides behind another one's units.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxcontact.complementarity.forms import mode_matrix, normal_form
from jaxcontact.complementarity.inverse import analysed_inverse, dot
from jaxcontact.complementarity.problems import LCP, MLCP
from jaxcontact.complementarity.scaling import power_of_two, row_exponents
from jaxcontact.complementarity.status import Status

BACKWARD_ERROR_BOUND = 16
"""SOLVED requires eta <= BACKWARD_ERROR_BOUND eps: 3.6e-15 in float64, 1.9e-6 in float32."""

DIGITS_KEPT = 0.25
"""SOLVED requires rho <= eps^DIGITS_KEPT, since rho is about eps times the condition of the active equations:
a quarter of the digits must remain."""

DEGENERACY_BOUND = 64
"""z_i and w_i below DEGENERACY_BOUND eps of the largest count as zero together."""

CERTIFICATE_BOUND = 4
"""Signs of y'F, y'P, y'N are read up to CERTIFICATE_BOUND n eps |y|'|F|..., the rounding of the products themselves."""

CONDITION_BOUND = 1 / 64
"""A condition number above CONDITION_BOUND / eps makes the active equations dependent up to rounding."""


class Claim(NamedTuple):
    """What a method proposes for the normal form, and how it says it ended."""

    free: jax.Array
    """(k,)"""
    z: jax.Array
    """(m,)"""
    w: jax.Array
    """(m,) ignored where the problem defines w by z."""
    outcome: jax.Array
    """int32 `Status`: SOLVED, or the reason to give if the residual is not small."""
    certificate: jax.Array
    """(k + m,) a row combination y said to prove that no feasible point exists; zeros if there is none."""


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
    redundant: jax.Array
    condition: jax.Array


def judge(problem, claim):
    """The `Verdict` on a `Claim`, from the problem's own data.

    >>> one = jnp.ones(1)
    >>> judge(LCP(jnp.eye(1), -one), Claim(jnp.zeros(0), one, one, jnp.int32(Status.SOLVED), 0 * one)).status
    """
    form = normal_form(problem)
    w = slack(problem, form, claim)
    eta, rho = residuals(problem, form, claim.free, claim.z, w)
    active, degenerate = classify(problem, form, claim.z, w)
    tight = analysed_inverse(mode_matrix(form, (active | degenerate).astype(form.q.dtype)))
    condition = analysed_inverse(mode_matrix(form, active.astype(form.q.dtype))).condition
    eps = jnp.finfo(form.q.dtype).eps
    dependent = (tight.deficiency > 0) | ~(tight.condition <= CONDITION_BOUND / eps)
    return Verdict(
        free=claim.free,
        z=claim.z,
        w=w,
        status=_status(form, claim, w, eta, rho),
        residual=rho,
        backward_error=eta,
        active=active,
        degenerate=jnp.sum(degenerate).astype(jnp.int32),
        redundant=dependent,
        condition=condition,
    )


def _status(form, claim, w, eta, rho):
    """Truth table, first line that applies:

    data not finite, or a claim of success that overflowed     BAD_INPUT
    eta and rho small                                          SOLVED (REDUNDANT if the method says so)
    the method gave a reason                                   that reason; a ray with a valid certificate INFEASIBLE
    eta small                                                  ILL_CONDITIONED
    otherwise                                                  INACCURATE
    """
    eps = jnp.finfo(form.q.dtype).eps
    finite = jnp.array([jnp.all(jnp.isfinite(part)) for part in form]).all()
    whole = jnp.all(jnp.isfinite(claim.z)) & jnp.all(jnp.isfinite(w)) & jnp.all(jnp.isfinite(claim.free))
    claims = (claim.outcome == int(Status.SOLVED)) | (claim.outcome == int(Status.REDUNDANT))
    small = eta <= BACKWARD_ERROR_BOUND * eps
    solved = small & (rho <= eps**DIGITS_KEPT)
    proved = (claim.outcome == int(Status.RAY)) & infeasible(form, claim.certificate)
    reason = jnp.where(proved, int(Status.INFEASIBLE), claim.outcome)
    shaky = jnp.where(small, int(Status.ILL_CONDITIONED), int(Status.INACCURATE))
    redundant = claim.outcome == int(Status.REDUNDANT)
    good = jnp.where(redundant, int(Status.REDUNDANT), int(Status.SOLVED))
    status = jnp.where(solved, good, jnp.where(claims, shaky, reason))
    return jnp.where(finite & (whole | ~claims), status, int(Status.BAD_INPUT)).astype(jnp.int32)


def infeasible(form, y):
    """bool: y'F = 0, y'P >= 0, y'N <= 0 and y'q > 0 up to the rounding of these products, so that no u and no
    z, w >= 0 satisfy F u + P z - N w + q = 0 (Farkas): the left side times y would be positive. Because signs are read
    up to rounding, what is excluded are points smaller than about |q| / eps."""
    slop = CERTIFICATE_BOUND * y.shape[0] * jnp.finfo(y.dtype).eps

    def product(A):
        return dot(y, A), slop * dot(jnp.abs(y), jnp.abs(A))

    (free, free_slop), (z, z_slop), (w, w_slop), (load, load_slop) = map(product, form)
    signs = jnp.all(jnp.abs(free) <= free_slop) & jnp.all(z >= -z_slop) & jnp.all(w <= w_slop)
    return signs & (load > load_slop)


def slack(problem, form, claim):
    """(m,) w as the problem defines it: M z + q where it is defined by z, else the claimed one."""
    if not isinstance(problem, LCP | MLCP):
        return claim.w
    k = form.F.shape[1]
    return dot(form.P[k:], claim.z) + dot(form.F[k:], claim.free) + form.q[k:]


def residuals(problem, form, free, z, w):
    """eta, rho (scalars) of a point of the normal form; eta is the larger one of the caller's and the balanced rows."""
    if form.q.shape[0] == 0:
        return jnp.zeros((), form.q.dtype), jnp.zeros((), form.q.dtype)
    miss = dot(form.F, free) + dot(form.P, z) - dot(form.N, w) + form.q
    terms = dot(jnp.abs(form.F), jnp.abs(free)) + dot(jnp.abs(form.P), jnp.abs(z)) + jnp.abs(form.q)
    if isinstance(problem, LCP | MLCP):
        k = form.F.shape[1]
        return _residuals_of_slack(problem, form, miss[:k], terms, z, w)
    terms = terms + dot(jnp.abs(form.N), jnp.abs(w))
    size = jnp.maximum(_largest(z), _largest(w))
    equation, pair = _largest(miss), _largest(jnp.minimum(z, w))
    eta = jnp.maximum(_ratio(equation, _largest(terms)), _ratio(pair, size))
    return eta, _ratio(equation, _largest(form.q))


def _residuals_of_slack(problem, form, miss, terms, z, w):
    """eta, rho where w is recomputed: equations first, then complementary pairs."""
    k = form.F.shape[1]
    diagonal, side = jnp.diagonal(form.P[k:]), _largest_of_rows(form.P[k:])
    t = jnp.where(diagonal > 0, diagonal, jnp.where(side > 0, side, 1))
    rho = _ratio(jnp.maximum(_largest(miss), _largest(jnp.minimum(t * z, w))), _largest(form.q))
    plain = _backward(miss, terms[:k], terms[k:], z, w)
    balance = power_of_two(pair_exponents(problem, form), z.dtype)
    balanced = _backward(miss, terms[:k], balance * terms[k:], z / balance, balance * w)
    return jnp.maximum(plain, balanced), rho


def _backward(miss, free_terms, terms, z, w):
    s = jnp.maximum(_largest(terms), _largest(free_terms))
    pairs = jnp.minimum(_ratio(z, _largest(z)), _ratio(w, s))
    return jnp.maximum(_ratio(_largest(miss), s), _largest(pairs))


def pair_exponents(problem, form):
    """(m,) int: z 2^-e and w 2^e of all pairs are comparable. Zero where z and w share a unit anyway."""
    m = form.P.shape[1]
    if m == 0 or not isinstance(problem, LCP | MLCP):
        return jnp.zeros(m, jnp.int32)
    return row_exponents(form.P[form.F.shape[1] :])


def classify(problem, form, z, w):
    """(active, degenerate), (m,) bool each: z_i positive beyond rounding; z_i and w_i both zero up to rounding."""
    e = pair_exponents(problem, form)
    z, w = z * power_of_two(-e, z.dtype), w * power_of_two(e, w.dtype)
    if isinstance(problem, LCP | MLCP):
        k = form.F.shape[1]
        terms = dot(jnp.abs(form.P[k:]), jnp.abs(z * power_of_two(e, z.dtype))) + jnp.abs(form.q[k:])
        size_z, size_w = _largest(z), _largest(terms * power_of_two(e, w.dtype))
    else:
        size_z = size_w = jnp.maximum(_largest(z), _largest(w))
    zero = DEGENERACY_BOUND * jnp.finfo(z.dtype).eps
    z_is_zero, w_is_zero = z <= zero * size_z, w <= zero * size_w
    return ~z_is_zero & (w_is_zero | (z / _above_zero(size_z) > w / _above_zero(size_w))), z_is_zero & w_is_zero


def _largest(x):
    return jnp.max(jnp.abs(x), initial=0)


def _largest_of_rows(A):
    return jnp.max(jnp.abs(A), axis=1, initial=0)


def _above_zero(x):
    return jnp.where(x > 0, x, 1)


def _ratio(x, size):
    """x / size; 0 / 0 is 0, and x / 0 is x."""
    return x / _above_zero(size)
