"""How much friction a configuration bears: sufficient, exact, certified."""

from collections.abc import Callable

from .critical import critical, critical_for_signs
from .ladder import best_scaling, operator_norm, perron, positive_definite_radius, sharper_direct
from .norm_ratio import norm_ratio
from .proposition14 import prop14
from .propositions import direct, prop9a, prop9b, prop10, prop11, prop12, prop13, prop15
from .slopes import Slopes, slopes

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
    "Slopes",
    "best_scaling",
    "by_name",
    "critical",
    "critical_for_signs",
    "direct",
    "norm_ratio",
    "operator_norm",
    "perron",
    "positive_definite_radius",
    "prop9a",
    "prop9b",
    "prop10",
    "prop11",
    "prop12",
    "prop13",
    "prop14",
    "prop15",
    "sharper_direct",
    "slopes",
]
