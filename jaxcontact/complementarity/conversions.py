"""One problem as another, with the theorem that makes them equivalent and the way back.

Each `x_as_y(problem)` returns (the other problem, back), where `back(z, w)` maps a complementary pair of the other
problem to (free, z, w) of this one. All rest on two facts:

- x = x+ - x- with 0 <= x+ ⟂ x- >= 0 is one-to-one, and |x| = x+ + x- (tutorial (44)).
- In F u + P z - N w + q = 0 take one of P_j, N_j for every pair so that the square matrix K of these and of F is
  regular (an LCP has N = I; the column W-property makes every choice regular). Solving for u and the chosen variables
  leaves an LCP in the others, one-to-one: the principal pivot transform (Cottle, Pang, Stone 2.3); with P, N of the
  mixed sliding problem it is tutorial (62), errata A13 and A14 included.
"""

import jax.numpy as jnp

from jaxcontact.complementarity.forms import normal_form
from jaxcontact.complementarity.problems import LCP, MLCP, AbsoluteValueEquation, BoxedLCP, HorizontalLCP
from jaxcontact.complementarity.records import unchecked
from jaxcontact.complementarity.reduction import reduce_to_lcp


def lcp_as_horizontal(problem: LCP):
    """w = M z + q is I w - M z = q.

    >>> horizontal, back = lcp_as_horizontal(LCP(M, q))
    """
    identity = jnp.eye(problem.q.shape[0], dtype=problem.q.dtype)
    return unchecked(HorizontalLCP, N=identity, M=problem.M, q=problem.q), _same


def ave_as_horizontal(problem: AbsoluteValueEquation):
    """A x - B|x| + w = 0 is (A + B) x- - (A - B) x+ = w, 0 <= x+ ⟂ x- >= 0 (tutorial (44)): z = x+, w = x-.

    >>> horizontal, back = ave_as_horizontal(AbsoluteValueEquation(A, B, w)); x = back(z, w)[0]
    """
    other = unchecked(HorizontalLCP, N=problem.A + problem.B, M=problem.A - problem.B, q=problem.w)
    return other, lambda z, w: (z - w, z, w)


def horizontal_as_ave(problem: HorizontalLCP):
    """With x = z - w: z = (|x| + x)/2, w = (|x| - x)/2, hence (M + N)/2 x - (N - M)/2 |x| + q = 0.

    >>> ave, back = horizontal_as_ave(HorizontalLCP(N, M, q))
    """
    N, M = problem.N, problem.M
    return unchecked(AbsoluteValueEquation, A=(M + N) / 2, B=(N - M) / 2, w=problem.q), _same


def lcp_as_ave(problem: LCP):
    """(I + M)/2 x - (I - M)/2 |x| + q = 0 with x = z - w (Mangasarian and Meyer 2006).

    >>> ave, back = lcp_as_ave(LCP(M, q))
    """
    return horizontal_as_ave(lcp_as_horizontal(problem)[0])


def horizontal_as_lcp(problem: HorizontalLCP):
    """The complementary unknowns that some regular choice of columns leaves (the second fact above); N = I leaves z.

    If every choice is singular, the LCP is one of a largest regular block and its answers need checking.

    >>> lcp, back = horizontal_as_lcp(HorizontalLCP(N, M, q)); z, w = back(y, lcp.M @ y + lcp.q)[1:]
    """
    reduction = reduce_to_lcp(normal_form(problem))
    return reduction.lcp, lambda z, w: reduction.back(z)


def ave_as_lcp(problem: AbsoluteValueEquation):
    """Through (44); where A + B is regular it is the LCP of (A + B)^-1 (A - B), unique for all w iff that is P
    (Mangasarian and Meyer 2006; tutorial, Proposition 11).

    >>> lcp, back = ave_as_lcp(AbsoluteValueEquation(A, B, w)); x = back(y, None)[0]
    """
    reduction = reduce_to_lcp(normal_form(problem))

    def back(z, w):
        _, plus, minus = reduction.back(z)
        return plus - minus, plus, minus

    return reduction.lcp, back


def mlcp_as_lcp(problem: MLCP):
    """u is eliminated: where A is regular, M = B - D A^-1 C and q = b - D A^-1 a (Schur complement; tutorial (62)).

    >>> lcp, back = mlcp_as_lcp(MLCP(A, C, a, D, B, b)); u, v, w = back(y, None)
    """
    reduction = reduce_to_lcp(normal_form(problem))
    return reduction.lcp, lambda z, w: reduction.back(z)


def lcp_as_boxed(problem: LCP):
    """0 <= x, without upper bounds.

    >>> boxed, back = lcp_as_boxed(LCP(M, q)); z, w = back(solution.z, solution.w)[1:]
    """
    m, zero = problem.q.shape[0], jnp.zeros_like(problem.q)
    other = unchecked(BoxedLCP, M=problem.M, q=problem.q, lower=zero, upper=zero + jnp.inf)
    return other, lambda z, w: (z[:0], z[:m], w[:m])


def boxed_as_lcp(problem: BoxedLCP):
    """Of twice the size: [[M, I], [-I, 0]] in x - lower and b >= 0 where the lower bounds are finite, with x eliminated
    by its row of M where not (module `boxed`; solvable for all bounds if M is a P-matrix).

    >>> lcp, back = boxed_as_lcp(BoxedLCP(M, q, lower, upper)); x, z, w = back(y, None)
    """
    reduction = reduce_to_lcp(normal_form(problem))
    return reduction.lcp, lambda z, w: reduction.back(z)


def boxed_as_mlcp(problem: BoxedLCP):
    """u = x is free, and z, w of the boxed problem are v, w of the mixed one; an infinite
    bound gives 0 <= v ⟂ v - idle. The way back needs x too: `back(u, v, w)` is (x, z, w).

    >>> mixed, back = boxed_as_mlcp(BoxedLCP(M, q, lower, upper))
    """
    form, m = normal_form(problem), problem.q.shape[0]
    weight = jnp.diagonal(form.N[m:])
    weight = jnp.where(weight == 0, 1, weight)  # powers of two: no digit changes
    other = unchecked(
        MLCP,
        A=form.F[:m],
        C=form.P[:m],
        a=form.q[:m],
        D=form.F[m:] / weight[:, None],
        B=form.P[m:] / weight[:, None],
        b=form.q[m:] / weight,
    )
    return other, lambda u, v, w: (u, v, w)


def _same(z, w):
    return z[:0], z, w
