"""The sliding problem of a set of contacts: linear, absolute-value or complementarity, whichever is enough.

With D = T [mu xi] the law of sliding friction lambda_t = -mu xi |lambda_n| makes the gaps accelerate as

    s = W lambda - N^T D |lambda| + w,        s = 0 if bilateral,  0 <= lambda ⟂ s >= 0 if unilateral        (60)

Frictionless bilateral contacts e are linear and go first: with Q the projection off span(N_e) and X^+ the
pseudo-inverse, the others (r) obey the same law with Q N, Q D and w_r - N_r^T (N_e^+)^T w_e (tutorial 3.2.3, errata A8
to A10), and lambda_e = -N_e^+ ((N_e^+)^T w_e + N_r lambda_r - D_r |lambda_r|), the one of least norm. What is left is

    nothing            if all are bilateral and frictionless      equation (7)
    A x - B |x| + w    if only frictional bilateral ones          (40), (48)
    an LCP             if only unilateral ones                    (10), (32), (53)
    a horizontal LCP   if both, lambda_b = lambda+ - lambda-      (61), (62) before lambda+ is eliminated
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from .. import linalg
from ..complementarity import LCP, AbsoluteValueEquation, HorizontalLCP
from ..dynamics import Contact, Delassus
from ..dynamics.delassus import select, select_columns
from .span import Span, dependence, inside, off_span, span_of

ROUNDING = 2
"""w = c - N^T L^-1 F has lost all digits where it is below ROUNDING n eps of its terms."""


class Sorted(NamedTuple):
    """Contacts by the part they play; static."""

    linear: tuple[int, ...]
    """bilateral and frictionless"""
    signed: tuple[int, ...]
    """bilateral and frictional"""
    one_sided: tuple[int, ...]
    """unilateral"""

    @property
    def rest(self) -> tuple[int, ...]:
        return self.signed + self.one_sided


class Sliding(NamedTuple):
    """The problem that is left, and what leads back from it to all contacts."""

    problem: LCP | AbsoluteValueEquation | HorizontalLCP | None
    """in the order signed, one-sided; None if nothing is left"""
    N: Array
    """(n, r) whitened normals of the remaining contacts, off the span of the linear ones"""
    D: Array
    """(n, r) whitened friction directions T [mu xi], off that span"""
    span: Span
    """of the linear contacts"""


def sort_contacts(contacts: tuple[Contact, ...]) -> Sorted:
    """`sort_contacts(rod.contacts).one_sided`"""
    numbered = list(enumerate(contacts))
    return Sorted(
        tuple(i for i, contact in numbered if contact.bilateral and not contact.frictional),
        tuple(i for i, contact in numbered if contact.bilateral and contact.frictional),
        tuple(i for i, contact in numbered if not contact.bilateral),
    )


def sliding(operators: Delassus, friction: Array) -> Sliding:
    """The `Sliding` problem for friction = mu xi (m,), zero at frictionless contacts.

    >>> sliding(jc.delassus(guides, state), jnp.array([0.2, 0.3])).problem     # an AbsoluteValueEquation
    """
    kinds = sort_contacts(operators.contacts)
    N_linear, N = select_columns(operators.N, kinds.linear), select_columns(operators.N, kinds.rest)
    D = select_columns(operators.T, kinds.rest) * select(friction, kinds.rest)[None, :]
    span = span_of(N_linear)
    reduced, D = off_span(span, N), off_span(span, D)
    w = select(operators.w, kinds.rest) - linalg.gram(N, _load(span, operators, kinds))
    # Rounding counts as zero, its derivative stays: at zero force and zero acceleration the answer has a kink.
    w = w - lax.stop_gradient(linalg.where(_is_rounding(span, reduced, N, w, operators, kinds), w, 0))
    return Sliding(_problem(kinds, reduced, D, w), reduced, D, span)


def normal_forces(operators: Delassus, friction: Array, found: Sliding, remaining: Array) -> Array:
    """(m,) normal forces of all contacts in the user's order, from those of the remaining ones (r,)."""
    kinds = sort_contacts(operators.contacts)
    N, T = select_columns(operators.N, kinds.rest), select_columns(operators.T, kinds.rest)
    pushes = N * remaining[None, :] - T * (select(friction, kinds.rest) * lax.abs(remaining))[None, :]
    alpha = jnp.sum(pushes, axis=1) + _load(found.span, operators, kinds)
    linear = -linalg.gram(found.span.pseudo_inverse.T, alpha)
    forces = dict(zip(kinds.linear + kinds.rest, [*linear, *remaining], strict=True))
    return jnp.stack([forces[i] for i in range(len(forces))]) if forces else operators.w


def with_sign(contacts: tuple[Contact, ...], z: Array, w: Array) -> Array:
    """(r,) forces from a complementary pair: lambda+ - lambda- where bilateral, z where unilateral."""
    kinds = sort_contacts(contacts)
    signed = jnp.arange(len(kinds.rest)) < len(kinds.signed)
    return linalg.where(signed, z - w, z) if kinds.signed else z


def contradiction(operators: Delassus, found: Sliding) -> Array:
    """bool: y = w_e - N_e^T x, x = (N_e^+)^T w_e, proves that no acceleration satisfies the linear constraints, as
    G_e y = 0 yet w_e^T y = |y|^2 + x^T N_e y > 0, beyond the rounding of N_e y."""
    kinds = sort_contacts(operators.contacts)
    if not kinds.linear:
        return jnp.zeros((), bool)
    N, w = select_columns(operators.N, kinds.linear), select(operators.w, kinds.linear)
    x = _load(found.span, operators, kinds)
    y = w - linalg.gram(N, x)
    y = y - linalg.gram(N, linalg.gram(found.span.pseudo_inverse, y))  # what rounding left along N_e
    noise = dependence(sum(N.shape), N.dtype)
    combined, size = lax.abs(linalg.gram(N.T, y)), linalg.gram(lax.abs(N).T, lax.abs(y))
    most = linalg.greatest(size, initial=0)
    proved = jnp.all(combined <= noise * most)
    return found.span.deficient & proved & (jnp.sum(y * y) > noise * jnp.sum(lax.abs(x) * most))


def _load(span: Span, operators: Delassus, kinds: Sorted) -> Array:
    """(n,) (N_e^+)^T w_e: the linear contacts' share of the free acceleration, whitened."""
    return linalg.gram(span.pseudo_inverse, select(operators.w, kinds.linear))


def _is_rounding(span: Span, reduced: Array, N: Array, w: Array, operators: Delassus, kinds: Sorted) -> Array:
    """(r,) bool: free accelerations that are the rounding of their terms; where a contact depends on the linear ones,
    also those that stem from the noise in its gradient that counts as dependence."""
    load = length_of(_load(span, operators, kinds)[:, None])[0]
    size = length_of(N) * load + select(_size_of_w(operators), kinds.rest)
    rounding = ROUNDING * N.shape[0] * float(jnp.finfo(N.dtype).eps)
    return lax.abs(w) <= linalg.where(inside(reduced, N), dependence(N.shape[0], N.dtype), rounding) * size


def _size_of_w(operators: Delassus) -> Array:
    """(m,) |c| + |N| |L^-1 F|, whose difference is w; |w| itself where they are not known."""
    if operators.terms is None or operators.L is None:
        return lax.abs(operators.w)
    free = length_of(linalg.solve_lower(operators.L, operators.terms.F)[:, None])[0]
    return lax.abs(operators.terms.c) + length_of(operators.N) * free


@jax.jit
def length_of(columns: Array) -> Array:
    """(k,) lengths of columns (n, k), to compare with; not differentiated."""
    return lax.sqrt(jnp.sum(lax.stop_gradient(columns) ** 2, axis=0))


def _problem(kinds: Sorted, N: Array, D: Array, w: Array):
    """The cheapest form that says it all."""
    if not kinds.rest:
        return None
    W, Wt = linalg.gram(N, N), linalg.gram(N, D)
    if not kinds.signed:
        return LCP(W - Wt, w)
    if not kinds.one_sided:
        return AbsoluteValueEquation(W, Wt, w)
    pushing, pulling, slack = W - Wt, W + Wt, jnp.eye(len(kinds.rest), dtype=w.dtype)
    signed = jnp.arange(len(kinds.rest)) < len(kinds.signed)
    return HorizontalLCP(N=linalg.where(signed[None, :], pulling, slack), M=pushing, q=w)
