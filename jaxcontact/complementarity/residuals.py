"""How far a point is from solving a problem, and which of its pairs press: from the caller's data, in their dtype.

With r_i the violation of row i,

    eta = max_i |min(z_i / |z|_max, w_i / s)|,   s = max_i (|M| |z| + |q|)_i      backward error
    rho = max_i |min(t_i z_i, w_i)| / max|q|,    t_i = M_ii (or the row's size where M_ii <= 0)

and for equations |r_i| / s and |r_i| / max|q|. Both are unchanged by M -> M 2^a, q -> q 2^b.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact import linalg
from jaxcontact.complementarity.boxed import residuals_of_box
from jaxcontact.complementarity.problems import LCP, MLCP, BoxedLCP
from jaxcontact.complementarity.scaling import exponent, power_of_two, row_exponents
from jaxcontact.complementarity.short import dot, largest, largest_of_rows, seldom, size_dot

DEGENERACY_BOUND = 64
"""z_i and w_i below DEGENERACY_BOUND eps of the largest count as zero together."""


def slack(problem, form, free, z, w):
    """(m,) w as the problem defines it: M z + q where it is defined by z, else the given one."""
    if not isinstance(problem, LCP | MLCP):
        return w
    k = form.F.shape[1]
    return dot(form.P[k:], z) + dot(form.F[k:], free) + form.q[k:]


@jax.jit  # traced once for all who ask
def residuals(problem, form, free, z, w, scales=None):
    """eta, rho (scalars) of a point of the normal form, w being recomputed where z defines it; eta is the larger one of
    the caller's and the balanced rows. scales: `pair_scales`, where they are known already."""
    scales = pair_scales(problem, form) if scales is None else scales
    w = slack(problem, form, free, z, w)
    miss = dot(form.F, free) + dot(form.P, z) - dot(form.N, w) + form.q
    terms = size_dot(form.F, free) + size_dot(form.P, z) + lax.abs(form.q)
    if isinstance(problem, LCP | MLCP):
        k = form.F.shape[1]
        return _residuals_of_slack(form, miss[:k], terms, z, w, scales)
    terms = terms + size_dot(form.N, w)
    scale_z, scale_w = scales
    size = jnp.maximum(largest(z * scale_z), largest(w * scale_w))
    pair = _ratio(largest(jnp.minimum(z * scale_z, w * scale_w)), size)
    eta, rho = jnp.maximum(_ratio(largest(miss), largest(terms)), pair), _ratio(largest(miss), largest(form.q))
    if isinstance(problem, BoxedLCP):
        return tuple(map(jnp.maximum, (eta, rho), residuals_of_box(problem, free)))
    return eta, rho


def _residuals_of_slack(form, miss, terms, z, w, scales):
    """eta, rho where w is recomputed: equations first, then complementary pairs."""
    k = form.F.shape[1]
    t = stiffness(form.P[k:])
    rho = _ratio(jnp.maximum(largest(miss), largest(jnp.minimum(t * z, w))), largest(form.q))
    plain = _backward(miss, terms[:k], terms[k:], z, w)
    scale_z, scale_w = scales
    balanced = _backward(miss, terms[:k], scale_w * terms[k:], scale_z * z, scale_w * w)
    return jnp.maximum(plain, balanced), rho


def stiffness(M):
    """(m,) M_ii, or the size of the row where that is not positive, or one."""

    def of_rows(M):
        diagonal, side = linalg.diagonal(M), largest_of_rows(M)
        return linalg.where(diagonal > 0, diagonal, linalg.where(side > 0, side, 1))

    diagonal = linalg.diagonal(M)
    return seldom(~lax.reduce_and(diagonal > 0, (0,)), of_rows, diagonal, M)


def _backward(miss, free_terms, terms, z, w):
    s = jnp.maximum(largest(terms), largest(free_terms))
    pairs = jnp.minimum(_ratio(z, largest(z)), _ratio(w, s))
    return jnp.maximum(_ratio(largest(miss), s), largest(pairs))


def pair_scales(problem, form):
    """(m,), (m,) powers of two that make all z comparable, and all w.

    Where w is a slack they undo the units of the rows, as in `scaling.row_exponents`; in horizontal form each unknown
    is multiplied by the size of its column, so that all have the unit of q.
    """
    dtype = form.q.dtype
    if isinstance(problem, LCP | MLCP):
        rows = row_exponents(form.P[form.F.shape[1] :])
        return power_of_two(-rows, dtype), power_of_two(rows, dtype)
    return tuple(power_of_two(exponent(largest_of_rows(A.T)), dtype) for A in (form.P, form.N))


@jax.jit
def classify(problem, form, z, w):
    """(active, degenerate), (m,) bool each: z_i positive beyond rounding; z_i and w_i both zero up to rounding."""
    scale_z, scale_w = pair_scales(problem, form)
    size_z, size_w = largest(z * scale_z), largest(w * scale_w)
    if isinstance(problem, LCP | MLCP):
        k = form.F.shape[1]
        terms = size_dot(form.P, z)[k:] + lax.abs(form.q[k:])
        size_w = largest(terms * scale_w)
    else:
        size_z = size_w = jnp.maximum(size_z, size_w)
    zero = DEGENERACY_BOUND * jnp.finfo(z.dtype).eps
    part_z, part_w = _ratio(z * scale_z, size_z), _ratio(w * scale_w, size_w)
    active = (part_z > zero) & ((part_w <= zero) | (part_z > part_w))
    return active, (part_z <= zero) & (part_w <= zero)


def above_zero(x):
    return linalg.where(x > 0, x, 1)


def _ratio(x, size):
    """x / size; 0 / 0 is 0, and x / 0 is x."""
    return x / above_zero(size)
