"""Whether a certificate proves that a problem has no feasible point."""

import jax.numpy as jnp
from jax import lax

from jaxcontact.complementarity.forms import normal_form
from jaxcontact.complementarity.residuals import above_zero, pair_scales
from jaxcontact.complementarity.short import counted, dot, largest
from jaxcontact.linalg import in_chunks, two_product, two_sum, where_needed

CERTIFICATE_BOUND = 64
"""Sign errors of a certificate, relative to its load, may be CERTIFICATE_BOUND times the rounding of the products."""

PROOF_LANES = 64
"""Certificates of a batch are checked by so many at a time: failures are rare, and the products of a check are long."""


def infeasible(problem, form, y):
    """bool: y proves that no u and no z, w >= 0 satisfy F u + P z - N w + q = 0.

    Farkas: y'F = 0, y'P >= 0, y'N <= 0, y'q > 0 contradict the equations times y. The products are accumulated in twice
    the working precision, and signs are read up to the error e of that: a feasible point would need
    sum_j e_j z_j >= y'q, so be larger than about 1 / eps^2. Dependent equations are never consistent to that degree, so
    with free unknowns e is the rounding of the data, and what is excluded are points larger than about 1 / eps.
    """
    n, eps = y.shape[0], jnp.finfo(y.dtype).eps
    rounding = n * eps if form.F.shape[1] else (n * eps) ** 2
    scale_z, scale_w = pair_scales(problem, form)

    def error(A, scale, sign):
        product, terms = accurate_product(y, A), dot(lax.abs(y), lax.abs(A))
        wrong = lax.abs(product) if sign == 0 else jnp.maximum(-sign * product, 0)
        return largest((wrong + rounding * terms) / scale) / above_zero(largest(lax.abs(A) / scale[None, :]))

    free = error(form.F, jnp.ones(form.F.shape[1], y.dtype), 0)
    signs = jnp.maximum(error(form.P, scale_z, 1), error(form.N, scale_w, -1))
    load = dot(y, form.q) - n * eps * dot(lax.abs(y), lax.abs(form.q))
    allowed = CERTIFICATE_BOUND * rounding * load / above_zero(largest(form.q))
    return (load > 0) & (free <= allowed) & (signs <= allowed)


def infeasible_somewhere(asked, problem, y):
    """`infeasible`, chunk by chunk in a batch, and only in chunks with a lane that asks."""

    def alone(asked, problem, y):
        asked = asked & jnp.any(y != 0)
        return where_needed(asked, infeasible, jnp.zeros((), bool), problem, normal_form(problem), y)

    return in_chunks(alone, PROOF_LANES)(asked, problem, y)


def accurate_product(y, A):
    """y'A with the error of twice the working precision (Ogita, Rump and Oishi 2005, Dot2); (n,), (n, k) -> (k,)."""
    product, lost = two_product(*jnp.broadcast_arrays(y[:, None], A))

    def add(i, carry):
        total, error = carry
        total, missed = two_sum(total, product[i])
        return total, error + (lost[i] + missed)

    zero = jnp.zeros(A.shape[1], A.dtype)
    return sum(counted(y.shape[0], add, (zero, zero)))
