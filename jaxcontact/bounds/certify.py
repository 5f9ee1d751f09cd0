"""Every statement of the tutorial as a verdict at given friction: are its hypotheses met, does it hold, by how much."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, Delassus
from ..dynamics.numbers import as_float_array
from .classes import Verdict
from .critical import count_of_vertices, critical
from .judges import (
    below,
    consistent,
    consistent_bilateral,
    feasible,
    feasible_where,
    full_rank,
    harmless_signs,
    of_bilateral,
    rank_of,
    regular_bilateral,
    sure,
)
from .ladder import best_scaling, operator_norm, perron, positive_definite_radius, sharper_direct
from .proposition14 import prop14
from .propositions import direct, prop9a, prop9b, prop10, prop11, prop12, prop13, prop15
from .ratio import ratio_of
from .redundancy import Redundancy, redundancy
from .vertices import MOST_VERTICES


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
    gradients at unit length; inf where nothing can change it, NaN where the statement does not speak of these
    contacts."""
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


def _held(operators: Delassus) -> str:
    return "" if operators.bilateral else "needs bilateral contacts"


def _held_roughly(operators: Delassus) -> str:
    rough = set(operators.bilateral) & set(operators.frictional)
    return "" if rough else "needs frictional bilateral contacts"


def _held_roughly_with_terms(operators: Delassus) -> str:
    return _held_roughly(operators) or ("" if operators.terms is not None else "needs G and H of a mechanism")


_UNIQUE = "for every load and every sign of sliding there is exactly one set of contact forces"
_RANK = "the frictionless contact forces are unique for every load"
_REGULAR = "the matrix of the constrained system is regular in every mode of signs"
_FULL_RANK = "only that -G + H D keeps full rank; forces need not be unique, and it depends on the units (erratum B6)"
_PROJECTION = "the acceleration exists and is the projection of the free one on what the constraints admit"
_ACCELERATION = "acceleration and constraint force G lambda are unique, however many constraints repeat each other"
_BOTH = "acceleration and multipliers of the bilateral constraints exist and are unique for every force and drift"
_COMPATIBLE = "the bilateral constraints are compatible: for every force an acceleration exists, and it is unique"
_FULL_RANK_E = "-G + H D keeps full rank for the bilateral contacts; it depends on the units of the coordinates"
_REGULAR_E = "the system of the bilateral contacts with friction is regular in every mode of signs"
_SOME = "for these signs of sliding some solution exists for every load, perhaps not only one"
_SOLVABLE = "the frictionless problem has a solution for every applied force, and the acceleration is unique"

STATEMENTS = (
    Statement("prop1i", "Proposition 1(i)", _RANK, _purely("bilateral"), rank_of("bilateral")),
    Statement("prop1ii", "Proposition 1(ii)", _SOLVABLE, _purely("bilateral"), consistent),
    Statement("prop3i", "Proposition 3(i)", _RANK, _purely("unilateral"), rank_of("unilateral")),
    Statement("prop3iv", "Proposition 3(iv)", _SOLVABLE, _purely("unilateral"), feasible),
    Statement("prop4", "Proposition 4", _PROJECTION, _purely("unilateral"), feasible),
    Statement("prop5", "Propositions 5 and 6", _SOLVABLE, _mixed, feasible),
    Statement("cor1", "Corollary 1", _PROJECTION, _mixed, feasible),
    Statement("prop7", "Proposition 7(v), corrected", _SOLVABLE, _mixed, feasible_where(regular_bilateral)),
    Statement("prop8", "Proposition 8, corrected", _SOLVABLE, _mixed, feasible_where(consistent_bilateral)),
    Statement("prop9a", "Proposition 9(a)", _REGULAR, _rough(prop9a.reason), below(prop9a)),
    Statement("prop9b", "Proposition 9(b), corrected", _FULL_RANK, _rough(_with_terms), below(prop9b)),
    Statement("prop10", "Proposition 10", _UNIQUE, _rough(prop10.reason), below(prop10)),
    Statement("prop11", "Proposition 11", _UNIQUE, _rough(prop11.reason), below(prop11)),
    Statement("prop12", "Proposition 12", _UNIQUE, _rough(prop12.reason), below(prop12)),
    Statement("prop13", "Proposition 13", _UNIQUE, _rough(prop13.reason), below(prop13)),
    Statement("cor2", "Corollary 2", _SOME, _rough(_purely("unilateral")), harmless_signs, of_signs=True),
    Statement("prop14", "Proposition 14", _UNIQUE, _rough(_only_unilateral_14), below(prop14)),
    Statement("prop15", "Proposition 15", _UNIQUE, _rough(prop15.reason), below(prop15)),
    Statement("operator_norm", "Operator norm", _UNIQUE, _rough(operator_norm.reason), below(operator_norm)),
    Statement("perron", "Perron root", _UNIQUE, _rough(perron.reason), below(perron)),
    Statement("best_scaling", "Best scaling", _UNIQUE, _rough(best_scaling.reason), below(best_scaling)),
    Statement("direct", "Direct bound", _UNIQUE, _rough(_always), below(direct)),
    Statement("sharper_direct", "Direct bound, sharper", _UNIQUE, _rough(_always), below(sharper_direct)),
    Statement("definite", "Positive definite", _UNIQUE, _rough(_few), below(positive_definite_radius)),
    Statement("exact", "Exact threshold", _UNIQUE + "; beyond it, not for every load", _rough(_few), below(critical)),
    Statement("e2", "Appendix E(ii), corrected", _ACCELERATION, _held, sure),
    Statement("e3", "Appendix E(iii)", _BOTH, _held, of_bilateral(rank_of("bilateral"))),
    Statement("e4", "Appendix E(iv)", _COMPATIBLE, _held, consistent),
    Statement("e5", "Appendix E(v)", _FULL_RANK_E, _held_roughly_with_terms, full_rank),
    Statement("e6", "Appendix E(vi)", _REGULAR_E, _held_roughly, of_bilateral(below(direct))),
)
"""Appendix E speaks of systems M x - F y = a, F^T x = b with M >= 0; M is positive definite where there are operators,
so ker M and ker F^T meet in zero (for M >= 0: `determined_by_constraints`). Erratum B9 corrects its (ii), B12 the proof
of (iv)."""
