"""The propositions of the tutorial as bounds on friction, each by its number, in the corrected statement.

Every function takes `(operators, ratio=None)` and returns r with mu = r * ratio, like `norm_ratio`. "Any load" means
any right-hand side w; since F ranges over R^n and the gaps are independent, that is any force. Where the contacts are
not of the kind a proposition speaks of, its value is NaN and `prop10.reason(operators)` says why.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from ..dynamics import Contact, Delassus
from .norm_ratio import norm_ratio, norm_ratio_of_factors, safe_ratio, scaled_tangents
from .ratio import ratio_of

Contacts = tuple[Contact, ...]


def proposition(hypothesis: Callable[[Contacts], str]) -> Callable:
    """Attach to a bound the kinds of contact it speaks of: elsewhere its value is NaN, and `.reason(operators)` says
    why."""

    def decorate(bound):
        compiled = jax.jit(bound, inline=True)

        @functools.wraps(bound)
        def guarded(operators: Delassus, ratio: Array | None = None, **options) -> Array:
            rates = ratio_of(operators.contacts, ratio, operators.N.dtype)
            if hypothesis(operators.contacts):
                return jnp.full((), jnp.nan, operators.N.dtype)
            return compiled(operators, rates, **options)

        guarded.reason = lambda operators: hypothesis(operators.contacts)
        return guarded

    return decorate


def _names(contacts: Contacts) -> str:
    return ", ".join(repr(contact.name) for contact in contacts)


def _all_bilateral_frictional(contacts: Contacts) -> str:
    odd = tuple(contact for contact in contacts if not (contact.bilateral and contact.frictional))
    return f"it speaks of bilateral frictional contacts only; {_names(odd)} are not" if odd else ""


def _all_bilateral(contacts: Contacts) -> str:
    odd = tuple(contact for contact in contacts if not contact.bilateral)
    return f"it speaks of bilateral contacts only; {_names(odd)} are unilateral" if odd else ""


def _all_unilateral(contacts: Contacts) -> str:
    odd = tuple(contact for contact in contacts if contact.bilateral)
    return f"it speaks of unilateral contacts only; {_names(odd)} are bilateral" if odd else ""


def _bilateral_all_frictional(contacts: Contacts) -> str:
    odd = tuple(contact for contact in contacts if contact.bilateral and not contact.frictional)
    return f"its bilateral contacts are frictional; {_names(odd)} are not (eliminate them first)" if odd else ""


def _bilateral_all_frictionless(contacts: Contacts) -> str:
    odd = tuple(contact for contact in contacts if contact.bilateral and contact.frictional)
    return f"its bilateral contacts are frictionless; {_names(odd)} are not" if odd else ""


def _any_contacts(contacts: Contacts) -> str:
    return ""


@proposition(_all_bilateral_frictional)
def prop9a(operators: Delassus, ratio: Array) -> Array:
    """Proposition 9(a): sigma_min(A_nb) / sigma_max(A_tb diag(ratio)).

    Hypothesis: M positive definite, bilateral frictional contacts, independent gaps. Guarantee: the matrix of (38) is
    regular in every mode of signs. Load class: any. Erratum B5: "there exists a mode" holds without any bound; full
    rank in every mode is the content, and Proposition 10 makes it uniqueness. `prop9a(delassus(guides, state))`
    """
    return norm_ratio_of_factors(operators.N, scaled_tangents(operators, ratio))


@proposition(_all_bilateral_frictional)
def prop9b(operators: Delassus, ratio: Array) -> Array:
    """Proposition 9(b): the root of (39), c / (a + sqrt(a^2 + b c)) with a = sigma_max(G^T H), b = sigma_max(H)^2, c =
    sigma_min(G)^2.

    Hypothesis: none on M. Guarantee, after erratum B6: only rank(-G + H D) = m_b; the accelerations need not be unique.
    It depends on the units of the coordinates (it adds lengths and angles). Load class: none. `prop9b(delassus(guides,
    state))`

    Raises:
        ValueError: for operators built from matrices, which hold neither G nor H.
    """
    if operators.terms is None:
        raise ValueError("prop9b needs G and H: build the operators with jc.delassus(mechanism, state)")
    G = operators.terms.G
    H = jnp.stack([operators.terms.H[:, i] * ratio[i] for i in range(len(operators.contacts))], axis=1)
    a = linalg.singular_value_max(linalg.gram(G, H))
    b, c = linalg.singular_value_max(H) ** 2, linalg.singular_value_min(G) ** 2
    return safe_ratio(c, a + safe_sqrt(a * a + b * c))


@proposition(_all_bilateral_frictional)
def prop10(operators: Delassus, ratio: Array) -> Array:
    """Proposition 10: sigma_min(A_nb) / sigma_max(A_tb diag(ratio)).

    Hypothesis: M positive definite, bilateral frictional contacts, independent gaps. Guarantee: forces and
    accelerations exist and are unique for every sign of sliding, and the fixed point iteration contracts. Load class:
    any. Exact for one contact; erratum B14: exact too for equal coefficients of the Painlevé-Klein system at theta >=
    arccos(1/sqrt 3). `prop10(delassus(guides, state))`
    """
    return norm_ratio_of_factors(operators.N, scaled_tangents(operators, ratio))


@proposition(_all_bilateral_frictional)
def prop11(operators: Delassus, ratio: Array) -> Array:
    """Proposition 11: a third of Proposition 10.

    Hypothesis, guarantee and load class as Proposition 10, through a horizontal complementarity problem. Erratum B7:
    the factor 1/3 is superfluous, (I - X)^-1 (I + X) is positive definite if and only if |X| < 1.
    `prop11(delassus(guides, state))`
    """
    return norm_ratio_of_factors(operators.N, scaled_tangents(operators, ratio)) / 3


@proposition(_all_bilateral)
def prop12(operators: Delassus, ratio: Array) -> Array:
    """Proposition 12: sigma_min(A~_nb) / sigma_max(A~_tb diag(ratio)), the frictionless contacts eliminated.

    Hypothesis: M positive definite, bilateral contacts, matrix (49) positive definite. Guarantee: accelerations and all
    forces exist and are unique. Load class: any. Errata A8 to A10 correct the blocks behind (47); the bound of the
    Painlevé-Klein example stays 2 cot theta. `prop12(delassus(guides, state))`
    """
    return norm_ratio(operators, ratio)


@proposition(_all_unilateral)
def prop13(operators: Delassus, ratio: Array) -> Array:
    """Proposition 13: sigma_min(A_nu) / sigma_max(A_tu diag(ratio)).

    Hypothesis: M positive definite, unilateral contacts, independent gaps. Guarantee: the contact problem (53) has one
    solution, Lipschitz in the load, for every sign of sliding. Load class: any. Erratum C4: the largest coefficient is
    taken over the frictional contacts. `prop13(delassus(rod, state))`
    """
    return norm_ratio_of_factors(operators.N, scaled_tangents(operators, ratio))


@proposition(_bilateral_all_frictionless)
def prop15(operators: Delassus, ratio: Array) -> Array:
    """Proposition 15: sigma_min(A_c) / sigma_max(A_tu - A_nbnu^T A_nb^-1 A_nbtu), the bilateral contacts eliminated.

    Hypothesis: M positive definite, frictionless bilateral and unilateral contacts, independent gaps. Guarantee: the
    contact problem has one solution for every sign of sliding. Load class: any. `prop15(delassus(rod, state))`
    """
    return norm_ratio(operators, ratio)


@proposition(_any_contacts)
def direct(operators: Delassus, ratio: Array) -> Array:
    """The direct bound: sigma_min(W) / sigma_max(Wt diag(ratio)) of all contacts together, none eliminated.

    Hypothesis: W positive definite; bilateral and unilateral contacts in any mixture. Guarantee: one solution for every
    sign of sliding. Load class: any. Not in the tutorial: W - Wt D is positive definite for every |D| <= [mu]
    (Corollary 3), so every vertex determinant of the mixed problem is positive. It replaces Proposition 14, which
    depends on the unit of mass. `direct(delassus(rod, state))`
    """
    return norm_ratio_of_factors(operators.N, scaled_tangents(operators, ratio))


def safe_sqrt(x: Array) -> Array:
    """sqrt of x >= 0 with a finite derivative at zero."""
    return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1.0)), x)
