"""Every solution of a small problem: all 2^m modes are tried.

On each mode the problem is a linear system with sign conditions. A regular mode holds at most one point; a mode of
rank one less holds a segment or ray, or one point of the line, or nothing, which is decided by the signs along the
line; modes of lower rank are sampled at one point, and `undecided` says if that left a doubt. Solutions on the border
of several modes are merged.
"""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact import linalg
from jaxcontact.complementarity.bars import acceptable
from jaxcontact.complementarity.derivative import attach
from jaxcontact.complementarity.forms import mode_matrix, normal_form, sizes
from jaxcontact.complementarity.inverse import analysed_inverse
from jaxcontact.complementarity.records import record
from jaxcontact.complementarity.residuals import pair_scales, residuals, slack
from jaxcontact.complementarity.short import dot, first

LARGEST = 10
"""More contacts than this have more than a thousand modes; the count doubles with each."""

MERGE_BOUND = 64
"""Points nearer than MERGE_BOUND eps condition |point| are the same solution; so are line parameters."""

NEGLIGIBLE = 64
"""Entries of a null vector below NEGLIGIBLE n eps of its largest one are zero."""

FURTHEST = 0.25
"""Points may merge up to this power of eps relative to their size, however ill-conditioned they are."""


@record
class AllSolutions:
    """All solutions of one problem, one row for each of the 2^m modes; rows that hold none are NaN and not valid.

    >>> every = all_solutions(LCP([[-1.0]], [1.0])); every.count, every.z[every.valid]     # 2: z = 0 and z = 1
    """

    free: jax.Array
    """(2^m, k) free unknowns"""
    z: jax.Array
    """(2^m, m)"""
    w: jax.Array
    """(2^m, m)"""
    valid: jax.Array
    """(2^m,) bool: the row holds a solution that no earlier row holds"""
    count: jax.Array
    """int32: number of valid rows; with `infinite`, of the listed points of the families and of isolated solutions"""
    infinite: jax.Array
    """bool: some mode holds a segment or a ray of solutions"""
    undecided: jax.Array
    """bool: a mode of low rank could not be excluded, or the data are not finite; the list may miss solutions"""

    @property
    def none(self):
        """bool: no solution exists."""
        return (self.count == 0) & ~self.undecided

    @property
    def unique(self):
        """bool: exactly one solution exists."""
        return (self.count == 1) & ~self.infinite & ~self.undecided

    @property
    def several(self):
        """bool: more than one, but finitely many."""
        return (self.count > 1) & ~self.infinite & ~self.undecided


def all_solutions(problem):
    """`AllSolutions` of an LCP, MLCP, HorizontalLCP or AbsoluteValueEquation with at most LARGEST pairs, in 2^m work.

    The mixed sliding problem is a HorizontalLCP whose bilateral pairs are the signs of the forces (tutorial (61)).
    Each row is differentiable as its own branch. Raises ValueError beyond LARGEST pairs or for batched arrays.

    >>> all_solutions(AbsoluteValueEquation(A, B, w)).count
    """
    _check_size(problem)
    return _enumerated(problem)


@jax.jit
def _enumerated(problem):
    fixed = lax.stop_gradient(problem)
    form = normal_form(fixed)
    m = form.P.shape[1]
    modes = jnp.array(list(product((False, True), repeat=m)), bool).reshape(2**m, m)
    scales = pair_scales(fixed, form)
    free, z, w, holds, family, doubt, radius = _solved_modes(fixed, form, scales, modes)
    valid = holds & ~_repeats(z * scales[0][None, :], w * scales[1][None, :], holds, radius)
    point = [linalg.where(valid[:, None], part, jnp.nan) for part in (free, z, w)]
    free, z, w = jax.vmap(lambda *part: attach(problem, *part))(*point)
    return AllSolutions(
        free=free,
        z=z,
        w=w,
        valid=valid,
        count=jnp.sum(valid).astype(jnp.int32),
        infinite=jnp.any(family & holds),
        undecided=jnp.any(doubt) | ~linalg.all_finite(*form),
    )


def _solved_modes(problem, form, scales, modes):
    """`_solved_mode` of each mode, one after the other: traced once, and a batch of problems stays in the cache. (A
    single problem of many modes would be quicker with all at once.)"""
    solved = linalg.packed(_solved_mode)
    return lax.map(lambda mode: solved(problem, form, scales, mode), modes)


def _solved_mode(problem, form, scales, mode):
    """(free, z, w, holds, family, doubt, radius) of one mode: a point, whether it solves, whether the mode holds more
    than one, whether that is unsure, and how far rounding may have moved the point (relative to its size)."""
    k, m = form.F.shape[1], form.P.shape[1]
    K = mode_matrix(form, mode.astype(form.q.dtype))
    found = analysed_inverse(K)
    x = -dot(found.matrix, form.q)
    x = x - dot(found.matrix, dot(K, x) + form.q)
    sign = lax.concatenate([np.zeros(k, x.dtype), linalg.where(mode, x.dtype.type(1), -1)], 0)
    kernel = _kernel(K, found)
    heights = linalg.greatest(lax.abs(kernel), axis=0, initial=0)
    highest = first(heights == linalg.greatest(heights, initial=0))
    line = lax.reduce_sum(linalg.where(highest[None, :], kernel, 0), (1,))
    shift, _ = _stretch(sign * x, sign * line)
    x = linalg.where(found.deficiency == 1, x + shift * line, x)
    size = jnp.maximum(sign * x, 0)[k:]
    free, z, w = x[:k], linalg.where(mode, size, 0), linalg.where(mode, 0, size)
    eps = jnp.finfo(x.dtype).eps
    terms = linalg.greatest(dot(lax.abs(K), lax.abs(x)) + lax.abs(form.q), initial=0)
    inside = _miss(K, jnp.concatenate([free, z - w]), form.q) <= MERGE_BOUND * (k + m) * eps * terms
    holds = inside & acceptable(*residuals(problem, form, free, z, w, scales))
    consistent = ~(_miss(K, x, form.q) > MERGE_BOUND * (k + m) * eps * terms)
    _, stretches = _stretch((sign * x)[:, None], sign[:, None] * kernel)
    family = lax.reduce_or((stretches > MERGE_BOUND * (k + m) * eps) & (heights > 0), (0,))
    signed = K * sign[None, :]
    one_signed = lax.reduce_or(lax.reduce_and(signed > 0, (1,)) | lax.reduce_and(signed < 0, (1,)), (0,))
    lone = holds & one_signed & (linalg.greatest(size, initial=0) == 0)
    doubt = (found.deficiency > 1) & consistent & ~(holds & family) & ~lone
    radius = MERGE_BOUND * eps * found.condition
    return free, z, slack(problem, form, free, z, w), holds, family, doubt, radius


def _miss(K, x, q):
    return linalg.greatest(lax.abs(dot(K, x) + q), initial=0)


def _kernel(K, found):
    """(n, n) I - G K: its columns span the kernel of K, entries at rounding level removed; zero for a regular K. The
    diagonal is one where G leaves an unknown out; elsewhere it is zero, and its whole column rounding."""
    n = K.shape[0]
    kernel = jnp.eye(n, dtype=K.dtype) - dot(found.matrix, K)
    kernel = linalg.where(linalg.diagonal(kernel)[None, :] > 0.5, kernel, 0)
    floor = NEGLIGIBLE * n * jnp.finfo(K.dtype).eps * linalg.greatest(lax.abs(kernel), axis=0, initial=0)
    kernel = linalg.where(lax.abs(kernel) > floor[None, :], kernel, 0)
    return linalg.where(found.deficiency > 0, kernel, 0)


def _stretch(y, line):
    """(t, length): y + t line >= 0 at an end of the stretch of the line where it can be, and that stretch's length
    relative to the numbers that enter it, negative if there is none. Entries where line is zero play no part. Along the
    first axis; further axes of `line` hold other lines."""
    rising, falling = line > 0, line < 0
    at = -y / linalg.where(line == 0, 1, line)
    low = linalg.greatest(linalg.where(rising, at, -jnp.inf), 0, initial=-jnp.inf)
    high = linalg.least(linalg.where(falling, at, jnp.inf), 0, initial=jnp.inf)
    t = linalg.where(lax.is_finite(low), low, linalg.where(lax.is_finite(high), high, 0))
    steepest = linalg.greatest(lax.abs(line), 0, initial=0)
    size = linalg.greatest(linalg.where(line == 0, 0, lax.abs(at)), 0, initial=0)
    size = jnp.maximum(size, linalg.greatest(lax.abs(y), 0, initial=0) / linalg.where(steepest > 0, steepest, 1))
    return t, linalg.where(high - low > 0, (high - low) / linalg.where(size > 0, size, 1), -1)


def _repeats(z, w, holds, radius):
    """(2^m,) bool: an earlier solving row holds the same point, up to rounding; z and w are scaled to be comparable."""
    rows = jnp.concatenate([z, w], axis=1)
    order = jnp.arange(rows.shape[0])
    size = linalg.greatest(lax.abs(linalg.where(holds[:, None], rows, 0)), axis=1, initial=0)
    cap = jnp.finfo(rows.dtype).eps ** FURTHEST

    def repeated(i):
        apart = linalg.greatest(lax.abs(rows - rows[i][None, :]), axis=1, initial=0)
        near = apart <= jnp.minimum(jnp.maximum(radius, radius[i]), cap) * jnp.maximum(size, size[i])
        return jnp.any(near & holds & (order < i))

    return lax.map(repeated, order)


def _check_size(problem):
    m = sizes(problem)[1]
    if normal_form(problem).q.ndim != 1:
        raise ValueError("all_solutions: takes one problem; write jax.vmap(all_solutions)")
    if m > LARGEST:
        raise ValueError(f"all_solutions: {m} pairs mean 2^{m} modes, at most {LARGEST} pairs are listed; use solve")
