"""How much friction a configuration bears: sufficient, exact, certified."""

from collections.abc import Callable

from .bracket import Bracket, critical_bracket
from .certify import Certificate, certify
from .classes import (
    Membership,
    Verdict,
    beta,
    column_w,
    copositive,
    error_constant,
    p_matrix,
    positive_definite,
)
from .critical import critical, critical_for_signs
from .explain import explain
from .ladder import best_scaling, operator_norm, perron, positive_definite_radius, sharper_direct
from .norm_ratio import norm_ratio
from .proposition14 import prop14
from .propositions import direct, prop9a, prop9b, prop10, prop11, prop12, prop13, prop15
from .redundancy import Redundancy, determined_by_constraints, redundancy
from .sliding_class import guaranteed_error, lipschitz, uniqueness
from .slopes import Slopes, slopes
from .variants import BindingMode, binding_mode, critical_along_ray, critical_existence, critical_for_load

_BOUNDS = (
    norm_ratio,
    prop9a,
    prop9b,
    prop10,
    prop11,
    prop12,
    prop13,
    prop14,
    prop15,
    direct,
    sharper_direct,
    positive_definite_radius,
    operator_norm,
    perron,
    best_scaling,
    critical,
)


def by_name() -> dict[str, Callable]:
    """Every bound `(operators, ratio=None) -> r` by its name: `by_name()["prop10"]`."""
    return {bound.__name__: bound for bound in _BOUNDS}


__all__ = [
    "BindingMode",
    "Bracket",
    "Certificate",
    "Membership",
    "Redundancy",
    "Slopes",
    "Verdict",
    "best_scaling",
    "beta",
    "binding_mode",
    "by_name",
    "certify",
    "column_w",
    "copositive",
    "critical",
    "critical_along_ray",
    "critical_bracket",
    "critical_existence",
    "critical_for_load",
    "critical_for_signs",
    "determined_by_constraints",
    "direct",
    "error_constant",
    "explain",
    "guaranteed_error",
    "lipschitz",
    "norm_ratio",
    "operator_norm",
    "p_matrix",
    "perron",
    "positive_definite",
    "positive_definite_radius",
    "prop9a",
    "prop9b",
    "prop10",
    "prop11",
    "prop12",
    "prop13",
    "prop14",
    "prop15",
    "redundancy",
    "sharper_direct",
    "slopes",
    "uniqueness",
]
