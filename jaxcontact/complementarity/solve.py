"""The one loop: a problem and a method in, a judged and differentiable solution out."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxcontact import native
from jaxcontact.complementarity.conversions import horizontal_as_ave
from jaxcontact.complementarity.derivative import attach, weights
from jaxcontact.complementarity.forms import mode_matrix, normal_form, sizes
from jaxcontact.complementarity.inverse import PIVOT_FLOOR, analysed_inverse
from jaxcontact.complementarity.judge import Claim, judge
from jaxcontact.complementarity.method import Answer
from jaxcontact.complementarity.problems import (
    LCP,
    MLCP,
    AbsoluteValueEquation,
    BoxedLCP,
    HorizontalLCP,
    Problem,
    check_values,
)
from jaxcontact.complementarity.records import unchecked
from jaxcontact.complementarity.reduction import reduce_to_lcp
from jaxcontact.complementarity.residuals import pair_scales, residuals
from jaxcontact.complementarity.short import dot
from jaxcontact.complementarity.solution import Solution
from jaxcontact.complementarity.status import Status
from jaxcontact.linalg import in_chunks, walled, where


def solve(problem, method, start=None):
    """The `Solution` of one problem by one method; `jax.vmap` for batches.

    start: (m,) a guess of z, used by iterations and ignored by pivoting; a guess with NaN or negative entries is
    ignored too (`Solution.start_used`).
    Raises ValueError or TypeError for shapes, dtypes and eager values that cannot be meant; traced data that are not
    finite give BAD_INPUT and NaN. The solution is differentiable in the problem's data, whichever method found it.

    >>> solve(LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]), Lemke()).z     # (4/3, 7/3)
    """
    _check_door(problem, method, start)
    return _solved(problem, method, start, native.serve(jax.tree.leaves(problem)[0].dtype))


@partial(jax.jit, static_argnames=("method", "kernels"))
def _solved(problem, method, start, kernels):
    fixed = lax.stop_gradient(problem)
    start, start_used = _usable(lax.stop_gradient(start), sizes(problem)[1])
    verdict, steps = _answer(problem, method, kernels)(fixed, start)
    answered = (verdict.status == int(Status.SOLVED)) | (verdict.status == int(Status.REDUNDANT))
    point = [where(answered, part, jnp.nan) for part in (verdict.free, verdict.z, verdict.w)]
    weight = weights(verdict.active, verdict.degenerate, verdict.z.dtype)
    free, z, w = attach(problem, *point, weight, finite=answered)
    return Solution(
        z=z,
        w=w,
        free=z - w if isinstance(problem, AbsoluteValueEquation) else free,
        status=verdict.status,
        residual=verdict.residual,
        backward_error=verdict.backward_error,
        steps=steps,
        active=verdict.active & answered,
        degenerate=where(answered, jnp.sum(verdict.degenerate), 0).astype(jnp.int32),
        redundant=verdict.redundant & answered,
        condition=verdict.condition,
        attempt=verdict.z,
        start_used=start_used,
    )


CHUNK_ENTRIES = 2**14
"""Numbers in the (lanes, m, m) array of a chunk: 128 kB in float64, so that an iteration stays in the cache; four times
as many beyond LANES_LAST contacts, where few lanes would leave short operations to be counted rather than numbers."""

CHUNK_LANES = 2**12
"""Largest number of problems in a chunk."""

LANES_LAST = 32
"""Up to this many contacts the lanes of a chunk are the last axis of an iteration's arrays, and there are at least as
many of them, or inner loops would be too short; with more contacts the rows of a matrix are long enough."""


def chunk_lanes(m):
    """How many problems a chunk holds."""
    if m > LANES_LAST:
        return max(4 * CHUNK_ENTRIES // m**2, 1)
    return min(CHUNK_LANES, max(CHUNK_ENTRIES // m**2, LANES_LAST))


def _answer(problem, method, kernels):
    """A function from problem and start to verdict and steps; methods that iterate in JAX run chunk by chunk in a
    batch. kernels: whether those of `native` are at hand."""
    m = sizes(problem)[1]
    kernels = kernels and m > 0

    def answer(problem, start):
        claim, steps = _claimed(problem, method, start, kernels and hasattr(method, "compiled"))
        return judge(problem, claim, kernels), steps

    if m == 0 or method.budget(m) == 0 or (kernels and isinstance(problem, LCP) and hasattr(method, "compiled")):
        return answer
    return in_chunks(answer, chunk_lanes(m))


def _claimed(problem, method, start, kernels):
    """The method's `Claim` on the normal form of the problem, and its steps."""
    if _sees_ave(method):
        return _claimed_as_ave(problem, method, start)
    if isinstance(problem, LCP) and kernels:
        z, certificate, steps, judged = method.compiled(problem, start, certified=False)
        return Claim(problem.q[:0], z, z, judged.status, certificate, found=judged), steps
    if isinstance(problem, LCP):
        answer, steps = iterate(problem, method, start)
        return Claim(problem.q[:0], *answer[:1], *answer), steps
    form = normal_form(problem)
    if form.F.shape[1] == 0 and 0 < len(form.q) <= getattr(method, "pairs", 0):
        return _claimed_as_pairs(form, method, kernels), jnp.int32(0)
    reduction = walled(reduce_to_lcp)(form)
    inner = None if start is None else where(reduction.eliminated, 0, start)
    answer, steps = iterate(reduction.lcp, method, inner, kernels)
    point = walled(_polished)(problem, form, reduction.back(answer.z))
    certificate = dot(answer.certificate, reduction.transform)
    silent = reduction.dependent & jnp.all(answer.certificate == 0)
    certificate = where(silent, reduction.contradiction, certificate)
    free = _least_norm(form.F, point[0], reduction.dependent)
    return Claim(free, *point[1:], answer.outcome, certificate, reduction.dependent), steps


def _claimed_as_pairs(form, method, kernels):
    """The `Claim` of a method that takes one or two pairs as they are: the best of all candidates."""
    outcome, free = jnp.int32(Status.NO_SOLUTION), form.q[:0]
    if kernels:
        found = method.compiled_pairs(form.P, form.N, form.q)
        return Claim(free, found.z, found.w, outcome, free, found=found)
    best = method.of_pairs(form.P, form.N, form.q)
    return Claim(free, best.z, best.w, outcome, best.certificate, best.dependent)


def _sees_ave(method):
    """bool: the method is one for absolute value equations."""
    return getattr(method, "kind", LCP) is AbsoluteValueEquation


def _claimed_as_ave(problem, method, start):
    """Methods for absolute value equations see every problem without free unknowns as one; x = z - w throughout."""
    form = normal_form(problem)
    ave = horizontal_as_ave(unchecked(HorizontalLCP, N=form.N, M=form.P, q=form.q))[0]
    answer, steps = iterate(ave, method, start)
    z, w = jnp.maximum(answer.z, 0), jnp.maximum(-answer.z, 0)
    free, z, w = walled(_polished)(problem, form, (form.q[:0], z, w))
    return Claim(free, z, w, answer.outcome, answer.certificate), steps


def _polished(problem, form, point):
    """The point, or the solution of the linear system of its own mode, whichever has the smaller backward error."""
    free, z, w = (jnp.maximum(part, 0) if i else part for i, part in enumerate(point))
    scale_z, scale_w = pair_scales(problem, form)
    K = mode_matrix(form, (z * scale_z > w * scale_w).astype(z.dtype))
    G = analysed_inverse(K).matrix
    x = -dot(G, form.q)
    x = x - dot(G, dot(K, x) + form.q)
    k = free.shape[0]
    fresh = x[:k], jnp.maximum(x[k:], 0), jnp.maximum(-x[k:], 0)
    better = residuals(problem, form, *fresh)[0] < residuals(problem, form, free, z, w)[0]
    return tuple(where(better, new, old) for new, old in zip(fresh, (free, z, w), strict=True))


def _least_norm(F, free, dependent):
    """The u of least norm with the same F u, where equations are dependent."""
    if free.shape[0] == 0:
        return free
    rank_tolerance = PIVOT_FLOOR * F.shape[0] * float(jnp.finfo(F.dtype).eps)
    sane = where(dependent, F, jnp.eye(*F.shape, dtype=F.dtype))
    return where(dependent, dot(jnp.linalg.pinv(sane, rtol=rank_tolerance), dot(F, free)), free)


def iterate(problem, method, start, kernels=False):
    """Run the method's steps on a problem of its kind until it is done or its budget is spent: (answer, steps)."""
    q = problem.w if isinstance(problem, AbsoluteValueEquation) else problem.q
    m = q.shape[0]
    if m == 0:
        return Answer(q, jnp.int32(Status.SOLVED), q), jnp.int32(0)
    if kernels:
        z, certificate, steps, judged = method.compiled(problem, start, certified=True)
        return Answer(z, judged.status, certificate), steps
    budget = method.budget(m)
    if budget == 0:
        return method.read(problem, method.init(problem, start)), jnp.int32(0)

    state, steps = _run(method, budget, m)(problem, method.init(problem, start))
    return method.read(problem, state), steps


def _run(method, budget, m):
    """A function from problem and state to the state in which the method ends, and its steps."""

    def unfinished(carry):
        state, steps = carry
        return ~state.done & (steps < budget)

    def run(problem, state):
        def advance(carry):
            state, steps = carry
            return method.step(problem, state), steps + 1

        return lax.while_loop(unfinished, advance, (state, jnp.int32(0)))

    if not getattr(method, "lanes_last", False):
        return run
    together = custom_vmap(run)

    @together.def_vmap
    def _(size, batched, problem, state):
        """One loop for all lanes; those that are done rest by themselves, so that nothing has to be put back."""
        state = jax.tree.map(lambda x, b: x if b else jnp.broadcast_to(x, (size, *x.shape)), state, batched[1])
        last = m <= LANES_LAST
        there, back = (0, -1) if last else (0, 0)
        step = partial(method.step, problem) if last else jax.vmap(partial(method.step, problem))

        def advance(carry):
            state, steps, count = carry
            return step(state), steps + (~state.done).astype(jnp.int32), count + 1

        start = jax.tree.map(lambda x: jnp.moveaxis(x, there, back), state), jnp.zeros(size, jnp.int32), jnp.int32(0)
        state, steps, _ = lax.while_loop(lambda c: jnp.any(~c[0].done) & (c[2] < budget), advance, start)
        state = jax.tree.map(lambda x: jnp.moveaxis(x, back, there), state)
        return (state, steps), jax.tree.map(lambda _: True, (state, steps))

    return together


def _usable(start, m):
    """The start with bad values replaced by zero, and whether it was good; None stays None."""
    if start is None:
        return None, jnp.zeros((), bool)
    good = jnp.all(lax.is_finite(start)) & jnp.all(start >= 0)
    return where(good, start, 0), good


def _check_door(problem, method, start):
    if not isinstance(problem, Problem):
        raise TypeError(f"solve: expected a problem such as LCP(M, q), got {type(problem).__name__}")
    if isinstance(method, type) or not all(hasattr(method, verb) for verb in ("init", "step", "read", "budget")):
        raise TypeError(f"solve: expected a method such as Lemke(), got {method!r}")
    if _sees_ave(method) and isinstance(problem, MLCP | BoxedLCP):
        kind = type(problem).__name__
        raise TypeError(f"solve: {method!r} takes problems without free unknowns, got {kind}; Lemke() will do")
    vector = {"MLCP": "b", "AbsoluteValueEquation": "w"}.get(type(problem).__name__, "q")
    values = getattr(problem, vector)
    if values.ndim != 1:
        raise ValueError(f"solve: takes one problem, got {vector} {values.shape}; write jax.vmap(solve, (0, None))")
    check_values(problem)
    if start is not None and jnp.shape(start) != (pairs := sizes(problem)[1:]):
        raise ValueError(f"solve: start has shape {jnp.shape(start)}, the problem needs {pairs}")
