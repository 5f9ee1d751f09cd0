"""The derivative of a solution, attached to the problem and the answer and not to the method that found it.

On one mode the solution x = z - w of the normal form F u + P z - N w + q = 0 solves K (u, x) + q = 0, hence

    d(u, x) = -K^-1 (dF u + dP z - dN w + dq),   dz_i = d_i dx_i,   dw_i = (d_i - 1) dx_i,

with K = [F, P diag(d) + N diag(1 - d)] and d_i = 1 on active pairs, 0 on open ones. For an LCP this is
dz = -(I - D + D M)^-1 D (dM z + dq) (Chen and Xiang, Math. Program. 106, 2006).

- Degenerate pairs, z_i = w_i = 0, take d_i = 1/2: an element of Clarke's generalised derivative, the one JAX also
  takes for jnp.minimum at a tie. K is regular for every d in [0, 1]^m if M is a P-matrix.
- Dependent equations (`redundant`): K^-1 is the inverse of a largest regular block, so what is determined (slacks,
  products with the matrix) has its derivative and the multipliers have that of one basic choice.
- A point that is not finite has no derivative here: zero, so that it spoils neither the batch nor shared parameters.
"""

from functools import singledispatch

import jax
import jax.numpy as jnp
from jax import lax

from jaxcontact.complementarity.boxed import pairs_of_box
from jaxcontact.complementarity.forms import NormalForm, mode_matrix, normal_form
from jaxcontact.complementarity.inverse import inverse
from jaxcontact.complementarity.problems import LCP, MLCP, AbsoluteValueEquation, BoxedLCP, HorizontalLCP
from jaxcontact.complementarity.residuals import classify
from jaxcontact.complementarity.short import dot
from jaxcontact.linalg import all_finite, where

AT_A_KINK = 0.5
"""d_i at a degenerate pair: halfway between contact held and contact open."""


@singledispatch
def implicit(problem, unknown):
    """`unknown`, unchanged, as a differentiable function of the problem's data.

    unknown: z (m,) for an LCP; (u, v) for an MLCP; (z, w) for a HorizontalLCP; x (m,) for an AbsoluteValueEquation
    or a BoxedLCP. It must be a solution: nothing is checked here. Forward, reverse, second order and vmap all work.
    Raises TypeError for other records.

    >>> jax.jacfwd(lambda q: implicit(LCP(M, q), z))(q)     # -(M_SS)^-1 on the active set S
    """
    raise TypeError(
        f"expected LCP, MLCP, HorizontalLCP, AbsoluteValueEquation or BoxedLCP, got {type(problem).__name__}"
    )


@implicit.register
def _(problem: LCP, unknown):
    z = lax.stop_gradient(unknown)
    w = lax.stop_gradient(dot(problem.M, z) + problem.q)
    return attach(problem, z[:0], z, w)[1]


@implicit.register
def _(problem: MLCP, unknown):
    u, v = lax.stop_gradient(unknown)
    w = lax.stop_gradient(dot(problem.D, u) + dot(problem.B, v) + problem.b)
    return attach(problem, u, v, w)[:2]


@implicit.register
def _(problem: HorizontalLCP, unknown):
    z, w = lax.stop_gradient(unknown)
    return attach(problem, z[:0], z, w)[1:]


@implicit.register
def _(problem: AbsoluteValueEquation, unknown):
    x = lax.stop_gradient(unknown)
    _, z, w = attach(problem, x[:0], jnp.maximum(x, 0), jnp.maximum(-x, 0))
    return z - w


@implicit.register
def _(problem: BoxedLCP, unknown):
    x = lax.stop_gradient(unknown)
    return attach(problem, x, *lax.stop_gradient(pairs_of_box(problem, x)))[0]


@jax.custom_jvp
def attach(problem, free, z, w, weight=None, finite=None):
    """(free, z, w) unchanged, with the derivative above; zero derivative where a number is not finite. What only the
    derivative needs is computed where one is taken.

    weight: (m,) d, and finite: bool, whether all numbers are finite, where they are known already."""
    return free, z, w


def weights(active, degenerate, dtype):
    """(m,) d: 1 where a pair is active, 0 where it is open, AT_A_KINK where it is degenerate."""
    return where(degenerate, AT_A_KINK, active.astype(dtype)).astype(dtype)


def _harmless(form):
    """A form of the same shapes with K = I for every mode."""
    rows, k = form.F.shape
    eye = jnp.eye(rows, dtype=form.q.dtype)
    return NormalForm(eye[:, :k], eye[:, k:], eye[:, k:], jnp.zeros_like(form.q))


@attach.defjvp
def _(primals, tangents):
    problem, *_, weight, finite = primals
    point = attach(*primals)
    form, dform = jax.jvp(normal_form, (problem,), tangents[:1])
    if finite is None:
        finite = all_finite(*form, *point)
    form = jax.tree.map(lambda part, safe: where(finite, part, safe), form, _harmless(form))
    dform = jax.tree.map(lambda part: where(finite, part, 0), dform)
    free, z, w = (where(finite, part, 0) for part in point)
    if weight is None:
        weight = weights(*classify(*lax.stop_gradient((problem, form, z, w))), z.dtype)
    K = mode_matrix(form, weight)
    load = dot(dform.F, free) + dot(dform.P, z) - dot(dform.N, w) + dform.q
    G = inverse(K)
    step = -dot(G, load)
    step = step - dot(G, dot(K, step) + load)
    k = form.F.shape[1]
    dx = step[k:]
    return point, tuple(where(finite, part, 0) for part in (step[:k], weight * dx, (weight - 1) * dx))
