"""Every statement of the tutorial as a verdict at given friction: are its hypotheses met, does it hold, by how much."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from .. import linalg
from ..dynamics import Contact, Delassus
from ..dynamics.delassus import select, select_columns
from ..dynamics.numbers import as_float_array
from .classes import Verdict
from .coupling import DEPENDENT
from .critical import count_of_vertices, critical
from .ladder import best_scaling, operator_norm, perron, positive_definite_radius, sharper_direct
from .proposition14 import prop14
from .propositions import direct, prop9a, prop9b, prop10, prop11, prop12, prop13, prop15
from .ratio import ratio_of
from .redundancy import Redundancy, missed, redundancy
from .vertices import MOST_VERTICES

CLOSE = 64
"""A bound is compared with friction up to this many roundings, times the condition of the gaps."""


class Statement(NamedTuple):
    """One row of a certificate, before any number."""

    key: str
    title: str
    says: str
    """What follows if it holds, in words."""
    inapplicable: Callable[[Delassus], str]
    """Why it does not speak of these contacts; empty if it does."""
    judge: Callable
    """(operators, mu, xi) -> (hypotheses, holds, margin)."""
    of_signs: bool = False
    """Whether it speaks of given signs of sliding only."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Certificate:
    """Verdicts on every statement, one entry each; under `vmap` the arrays get a batch axis in front."""

    hypotheses: Array
    """(k,) int32 `Verdict`: are the hypotheses met."""
    holds: Array
    """(k,) int32 `Verdict`: does the statement apply to this friction, hypotheses included."""
    margin: Array
    """(k,) how far from changing: for a bound, bound / friction - 1; for a rank, the smallest singular value of the gap
    gradients at unit length; NaN where the statement does not speak of these contacts."""
    mu: Array
    """(m,) the friction coefficients, zero where frictionless."""
    redundancy: Redundancy
    """Which gaps depend on which."""
    statements: tuple[tuple[str, str, str, str], ...] = field(metadata={"static": True})
    """(key, title, what it says, why it does not apply or "")."""
    contacts: tuple[Contact, ...] = field(metadata={"static": True})

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(key for key, *_ in self.statements)

    def __getitem__(self, key: str) -> tuple[Array, Array, Array]:
        """(hypotheses, holds, margin) of one statement: `certify(here, mu)["prop10"]`."""
        i = self.names.index(key)
        return self.hypotheses[..., i], self.holds[..., i], self.margin[..., i]


def certify(operators: Delassus, mu: Array, xi: Array | None = None) -> Certificate:
    """Each statement of the tutorial, in its corrected form, at friction mu.

    `certify(here, jnp.array([0.3, 0.3]))["prop10"]`; `explain(certify(here, mu))` puts it in words.

    Args:
        operators: from `delassus`; batches through `jax.vmap`.
        mu: (m,) friction coefficients; entries of frictionless contacts are ignored.
        xi: (m,) signs of sliding, for the statements about given signs (Corollary 2); None: for any signs.

    Raises:
        ValueError: for a mu or xi of the wrong length, or (eager calls) a negative mu.
    """
    mu = ratio_of(operators.contacts, as_float_array("mu", mu), operators.N.dtype)
    if xi is not None and jnp.shape(xi) != mu.shape:
        raise ValueError(f"xi must have one sign per contact, shape {mu.shape}, got {jnp.shape(xi)}")
    xi = None if xi is None else jnp.asarray(xi).astype(mu.dtype)
    unsigned = "give the signs of sliding, xi" if xi is None else ""
    reasons = [s.inapplicable(operators) or (unsigned if s.of_signs else "") for s in STATEMENTS]
    nothing = (jnp.int32(Verdict.NO), jnp.int32(Verdict.NO), jnp.full((), jnp.nan, mu.dtype))
    rows = [nothing if why else s.judge(operators, mu, xi) for s, why in zip(STATEMENTS, reasons)]
    hypotheses, holds, margin = (jnp.stack(column) for column in zip(*rows))
    texts = tuple((s.key, s.title, s.says, why) for s, why in zip(STATEMENTS, reasons))
    return Certificate(hypotheses, holds, margin, mu, redundancy(operators), texts, operators.contacts)


def _independence(operators: Delassus, rows: tuple[int, ...]) -> tuple[Array, Array]:
    """(verdict, smallest singular value of the gap gradients at unit length)."""
    N = select_columns(operators.N, rows)
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    least = linalg.singular_value_min(N / jnp.where(length > 0, length, 1)[None, :])
    limit = DEPENDENT * float(jnp.finfo(N.dtype).eps)
    # At rounding level dependence cannot be told from near dependence: NO is said of what is equal up to rounding.
    return _verdict(least > limit, least <= limit), least


def _rank_of(kind: str) -> Callable:
    def judge(operators, mu, xi):
        known = jnp.int32(Verdict.YES)
        return known, *_independence(operators, getattr(operators, kind))

    return judge


def _bound(bound: Callable) -> Callable:
    """mu below the bound along its own direction: the bound with ratio mu exceeds one."""

    def judge(operators, mu, xi):
        regular, least = _independence(operators, tuple(range(len(operators.contacts))))
        value = bound(operators, mu)
        limit = CLOSE * float(jnp.finfo(mu.dtype).eps) * (1 + 1 / jnp.where(least > 0, least, 1))
        clear = _verdict(value - 1 > limit, value - 1 < -limit)
        return regular, _both(regular, clear), value - 1

    return judge


def _feasible(operators, mu, xi):
    """K and K_b meet; M is positive definite, since the operators exist."""
    miss, rounding = missed(operators)
    known = jnp.int32(Verdict.YES)
    # Whatever is missed within rounding is not told from a border.
    return known, _verdict(miss <= rounding, miss > rounding), 0 - miss


def _feasible_where(hypothesis: Callable) -> Callable:
    def judge(operators, mu, xi):
        met = hypothesis(operators)
        _, meet, margin = _feasible(operators, mu, xi)
        return met, _both(met, meet), margin

    return judge


def _regular_bilateral(operators: Delassus) -> Array:
    return _independence(operators, operators.bilateral)[0]


def _consistent_bilateral(operators: Delassus) -> Array:
    return _consistent(operators, None, None)[1]


def _consistent(operators, mu, xi):
    """c_b in the range of G_b^T: the same question for the bilateral contacts alone."""
    b = operators.bilateral
    if operators.terms is None:
        return _feasible(operators, mu, xi)
    N, c = select_columns(operators.N, b), select(operators.terms.c, b)
    length = jnp.sqrt(jnp.sum(N * N, axis=0))
    N, c = N / length[None, :], c / length
    rtol = DEPENDENT * float(jnp.finfo(N.dtype).eps)
    a = jnp.matmul(jnp.linalg.pinv(N, rtol=rtol).T, c, precision=jax.lax.Precision.HIGHEST)
    miss = jnp.max(abs(linalg.gram(N, a) - c))
    limit = CLOSE * float(jnp.finfo(N.dtype).eps) * (jnp.max(abs(a)) + jnp.max(abs(c)))
    return jnp.int32(Verdict.YES), _verdict(miss <= limit, miss > limit), 0 - miss


def _harmless_signs(operators, mu, xi):
    """Corollary 2: no positive entry in A_tu [mu] [xi]."""
    regular, _ = _independence(operators, operators.unilateral)
    Y = operators.A_tu * select(mu * xi, operators.unilateral)[None, :]
    largest = jnp.max(Y)
    limit = CLOSE * float(jnp.finfo(mu.dtype).eps) * jnp.max(abs(Y))
    return regular, _both(regular, _verdict(largest <= limit, largest > limit)), -largest


def _verdict(yes: Array, no: Array) -> Array:
    known = jnp.where(yes, int(Verdict.YES), int(Verdict.UNDECIDED))
    return jnp.where(no, int(Verdict.NO), known).astype(jnp.int32)


def _both(first: Array, second: Array) -> Array:
    """YES if both are, NO if one is NO, else UNDECIDED."""
    no = (first == int(Verdict.NO)) | (second == int(Verdict.NO))
    return _verdict((first == int(Verdict.YES)) & (second == int(Verdict.YES)), no)


def _always(operators: Delassus) -> str:
    return ""


def _purely(kind: str) -> Callable:
    other = "unilateral" if kind == "bilateral" else "bilateral"
    return lambda operators: "" if getattr(operators, kind) and not getattr(operators, other) else f"not all {kind}"


def _mixed(operators: Delassus) -> str:
    return "" if operators.bilateral and operators.unilateral else "needs bilateral and unilateral contacts"


def _few(operators: Delassus) -> str:
    return "" if count_of_vertices(operators) <= MOST_VERTICES else "too many contacts to look at every vertex"


def _rough(reason: Callable) -> Callable:
    return lambda operators: reason(operators) or ("" if operators.frictional else "nothing is frictional")


def _with_terms(operators: Delassus) -> str:
    return prop9b.reason(operators) or ("" if operators.terms is not None else "needs G and H of a mechanism")


def _only_unilateral_14(operators: Delassus) -> str:
    return prop14.reason(operators) or _mixed(operators)


_UNIQUE = "for every load and every sign of sliding there is exactly one set of contact forces"
_RANK = "the frictionless contact forces are unique for every load"
_REGULAR = "the matrix of the constrained system is regular in every mode of signs"
_FULL_RANK = "only that -G + H D keeps full rank; forces need not be unique, and it depends on the units (erratum B6)"
_PROJECTION = "the acceleration exists and is the projection of the free one on what the constraints admit"
_SOME = "for these signs of sliding some solution exists for every load, perhaps not only one"
_SOLVABLE = "the frictionless problem has a solution for every applied force, and the acceleration is unique"

STATEMENTS = (
    Statement("prop1i", "Proposition 1(i)", _RANK, _purely("bilateral"), _rank_of("bilateral")),
    Statement("prop1ii", "Proposition 1(ii)", _SOLVABLE, _purely("bilateral"), _consistent),
    Statement("prop3i", "Proposition 3(i)", _RANK, _purely("unilateral"), _rank_of("unilateral")),
    Statement("prop3iv", "Proposition 3(iv)", _SOLVABLE, _purely("unilateral"), _feasible),
    Statement("prop4", "Proposition 4", _PROJECTION, _purely("unilateral"), _feasible),
    Statement("prop5", "Propositions 5 and 6", _SOLVABLE, _mixed, _feasible),
    Statement("cor1", "Corollary 1", _PROJECTION, _mixed, _feasible),
    Statement("prop7", "Proposition 7(v), corrected", _SOLVABLE, _mixed, _feasible_where(_regular_bilateral)),
    Statement("prop8", "Proposition 8, corrected", _SOLVABLE, _mixed, _feasible_where(_consistent_bilateral)),
    Statement("prop9a", "Proposition 9(a)", _REGULAR, _rough(prop9a.reason), _bound(prop9a)),
    Statement("prop9b", "Proposition 9(b), corrected", _FULL_RANK, _rough(_with_terms), _bound(prop9b)),
    Statement("prop10", "Proposition 10", _UNIQUE, _rough(prop10.reason), _bound(prop10)),
    Statement("prop11", "Proposition 11", _UNIQUE, _rough(prop11.reason), _bound(prop11)),
    Statement("prop12", "Proposition 12", _UNIQUE, _rough(prop12.reason), _bound(prop12)),
    Statement("prop13", "Proposition 13", _UNIQUE, _rough(prop13.reason), _bound(prop13)),
    Statement("cor2", "Corollary 2", _SOME, _rough(_purely("unilateral")), _harmless_signs, of_signs=True),
    Statement("prop14", "Proposition 14", _UNIQUE, _rough(_only_unilateral_14), _bound(prop14)),
    Statement("prop15", "Proposition 15", _UNIQUE, _rough(prop15.reason), _bound(prop15)),
    Statement("operator_norm", "Operator norm", _UNIQUE, _rough(operator_norm.reason), _bound(operator_norm)),
    Statement("perron", "Perron root", _UNIQUE, _rough(perron.reason), _bound(perron)),
    Statement("best_scaling", "Best scaling", _UNIQUE, _rough(best_scaling.reason), _bound(best_scaling)),
    Statement("direct", "Direct bound", _UNIQUE, _rough(_always), _bound(direct)),
    Statement("sharper_direct", "Direct bound, sharper", _UNIQUE, _rough(_always), _bound(sharper_direct)),
    Statement("definite", "Positive definite", _UNIQUE, _rough(_few), _bound(positive_definite_radius)),
    Statement("exact", "Exact threshold", _UNIQUE + "; beyond it, not for every load", _rough(_few), _bound(critical)),
)
"""Appendix E is Propositions 1 and 9 put abstractly: its (iv) is `prop1ii`, its (vi) `prop9a`, its (v) `prop9b`."""
