"""One normal form for every problem: F u + P z - N w + q = 0 with 0 <= z ⟂ w >= 0 and u free.

With x = z - w (so z = max(x, 0), w = max(-x, 0)) a *mode* says which x_i are positive; on one mode the problem is the
linear system K (u, x) + q = 0 whose column for pair i is P_i where the mode is true and N_i where it is false. A
complementarity problem is thus a piecewise linear equation, and its solutions, derivatives and rank are read off the
matrices K (Cottle, Pang, Stone 1.3: complementary matrices; Robinson's normal map).
"""

from functools import singledispatch
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxcontact.complementarity.problems import LCP, MLCP, AbsoluteValueEquation, HorizontalLCP


class NormalForm(NamedTuple):
    """F u + P z - N w + q = 0."""

    F: jax.Array
    """(k + m, k)"""
    P: jax.Array
    """(k + m, m)"""
    N: jax.Array
    """(k + m, m)"""
    q: jax.Array
    """(k + m,)"""


@singledispatch
def normal_form(problem) -> NormalForm:
    """The normal form of a problem record: no digit changes, except the sums A + B and A - B of an absolute value
    equation. Raises TypeError for anything else.

    >>> normal_form(LCP(jnp.eye(2), jnp.ones(2))).N     # the identity
    """
    raise TypeError(
        f"expected LCP, MLCP, HorizontalLCP, AbsoluteValueEquation or BoxedLCP, got {type(problem).__name__}"
    )


@normal_form.register
def _(problem: LCP):
    M, q = problem.M, problem.q
    return NormalForm(M[:, :0], M, jnp.eye(q.shape[0], dtype=q.dtype), q)


@normal_form.register
def _(problem: MLCP):
    slack = jnp.eye(problem.b.shape[0], dtype=problem.b.dtype)
    return NormalForm(
        jnp.concatenate([problem.A, problem.D]),
        jnp.concatenate([problem.C, problem.B]),
        jnp.concatenate([jnp.zeros_like(problem.C), slack]),
        jnp.concatenate([problem.a, problem.b]),
    )


@normal_form.register
def _(problem: HorizontalLCP):
    return NormalForm(problem.M[:, :0], problem.M, problem.N, problem.q)


@normal_form.register
def _(problem: AbsoluteValueEquation):
    return NormalForm(problem.A[:, :0], problem.A - problem.B, problem.A + problem.B, problem.w)


def sizes(problem):
    """(k, m): how many free and how many complementary unknowns."""
    form = normal_form(problem)
    return form.F.shape[1], form.P.shape[1]


def mode_matrix(form, weight):
    """(k + m, k + m) K = [F, weight P + (1 - weight) N]; weight (m,) is 1 on active pairs, 0 on open ones, and any
    number between at a degenerate pair, where both ends are limits."""
    return jnp.concatenate([form.F, form.P * weight[None, :] + form.N * (1 - weight)[None, :]], axis=1)
