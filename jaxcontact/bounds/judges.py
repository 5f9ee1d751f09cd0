"""How a statement of a certificate is judged: (operators, mu, xi) -> (hypotheses met, holds, margin)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from ..dynamics import Delassus
from ..dynamics.delassus import select, select_columns
from .classes import Verdict, verdict_of
from .coupling import DEPENDENT
from .redundancy import missed

CLOSE = 64
"""A bound is compared with friction up to this many roundings, times the condition of the gaps."""


def independence(operators: Delassus, rows: tuple[int, ...]) -> tuple[Array, Array]:
    """(verdict, smallest singular value of the gap gradients at unit length)."""
    N = select_columns(operators.N, rows)
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    least = linalg.singular_value_min(N / jnp.where(length > 0, length, 1)[None, :])
    limit = DEPENDENT * float(jnp.finfo(N.dtype).eps)
    # At rounding level dependence cannot be told from near dependence: NO is said of what is equal up to rounding.
    return verdict_of(least > limit, least <= limit), least


def rank_of(kind: str) -> Callable:
    def judge(operators, mu, xi):
        known = jnp.int32(Verdict.YES)
        return known, *independence(operators, getattr(operators, kind))

    return judge


def below(bound: Callable) -> Callable:
    """mu below the bound along its own direction: the bound with ratio mu exceeds one."""

    def judge(operators, mu, xi):
        regular, least = independence(operators, tuple(range(len(operators.contacts))))
        value = bound(operators, mu)
        limit = CLOSE * float(jnp.finfo(mu.dtype).eps) * (1 + 1 / jnp.where(least > 0, least, 1))
        clear = verdict_of(value - 1 > limit, value - 1 < -limit)
        return regular, both(regular, clear), value - 1

    return judge


def of_bilateral(judge: Callable) -> Callable:
    """The same question about the bilateral contacts alone."""

    def of_part(operators, mu, xi):
        b = operators.bilateral
        part = Delassus(
            N=select_columns(operators.N, b),
            T=select_columns(operators.T, b),
            w=select(operators.w, b),
            L=operators.L,
            terms=None,
            contacts=tuple(operators.contacts[i] for i in b),
        )
        return judge(part, select(mu, b), xi)

    return of_part


def sure(operators, mu, xi):
    """True of every mechanism whose M is positive definite, as it is where there are operators."""
    known = jnp.int32(Verdict.YES)
    return known, known, jnp.full((), jnp.inf, mu.dtype)


def full_rank(operators, mu, xi):
    """Appendix E(v): F = G_b, P = H_b D, and N = -F + P has full rank for |D| <= [mu] if
    |F^T P + P^T F - P^T P| <= 2 |F^T P| + |P|^2 is below sigma_min(F)^2."""
    b = operators.bilateral
    regular, _ = independence(operators, b)
    F = select_columns(operators.terms.G, b)
    P = select_columns(operators.terms.H, b) * select(mu, b)[None, :]
    size = 2 * linalg.singular_value_max(linalg.gram(F, P)) + linalg.singular_value_max(P) ** 2
    least = linalg.singular_value_min(F) ** 2
    margin = jnp.where(size > 0, least / jnp.where(size > 0, size, 1), jnp.inf) - 1
    condition = linalg.singular_value_max(F) ** 2 / jnp.where(least > 0, least, 1)
    limit = CLOSE * float(jnp.finfo(mu.dtype).eps) * (1 + condition)
    return regular, both(regular, verdict_of(margin > limit, margin < -limit)), margin


def feasible(operators, mu, xi):
    """K and K_b meet; M is positive definite, since the operators exist."""
    miss, rounding = missed(operators)
    known = jnp.int32(Verdict.YES)
    # Whatever is missed within rounding is not told from a border.
    return known, verdict_of(miss <= rounding, miss > rounding), 0 - miss


def feasible_where(hypothesis: Callable) -> Callable:
    def judge(operators, mu, xi):
        met = hypothesis(operators)
        _, meet, margin = feasible(operators, mu, xi)
        return met, both(met, meet), margin

    return judge


def regular_bilateral(operators: Delassus) -> Array:
    return independence(operators, operators.bilateral)[0]


def consistent_bilateral(operators: Delassus) -> Array:
    return consistent(operators, None, None)[1]


def consistent(operators, mu, xi):
    """c_b in the range of G_b^T: the same question for the bilateral contacts alone."""
    b = operators.bilateral
    if operators.terms is None:
        return feasible(operators, mu, xi)
    N, c = select_columns(operators.N, b), select(operators.terms.c, b)
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    N, c = N / length[None, :], c / length
    rtol = DEPENDENT * float(jnp.finfo(N.dtype).eps)
    a = jnp.matmul(jnp.linalg.pinv(N, rtol=rtol).T, c, precision=jax.lax.Precision.HIGHEST)
    miss = linalg.greatest(abs(linalg.gram(N, a) - c))
    limit = CLOSE * float(jnp.finfo(N.dtype).eps) * (linalg.greatest(abs(a)) + linalg.greatest(abs(c)))
    return jnp.int32(Verdict.YES), verdict_of(miss <= limit, miss > limit), 0 - miss


def harmless_signs(operators, mu, xi):
    """Corollary 2: no positive entry in A_tu [mu] [xi]."""
    regular, _ = independence(operators, operators.unilateral)
    Y = operators.A_tu * select(mu * xi, operators.unilateral)[None, :]
    largest = linalg.greatest(Y)
    limit = CLOSE * float(jnp.finfo(mu.dtype).eps) * linalg.greatest(abs(Y))
    return regular, both(regular, verdict_of(largest <= limit, largest > limit)), -largest


def both(first: Array, second: Array) -> Array:
    """YES if both are, NO if one is NO, else UNDECIDED."""
    no = (first == int(Verdict.NO)) | (second == int(Verdict.NO))
    return verdict_of((first == int(Verdict.YES)) & (second == int(Verdict.YES)), no)
