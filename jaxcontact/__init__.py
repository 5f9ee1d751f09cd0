"""Friction bounds, certificates and batched contact solving for mechanisms, in JAX."""

from . import bounds, linalg, mechanisms
from .atlas import sweep
from .dynamics import (
    Contact,
    Coordinate,
    Delassus,
    State,
    Terms,
    delassus,
    delassus_from_matrices,
    mechanism,
    parameter,
    static,
    terms,
)

__all__ = [
    "Contact",
    "Coordinate",
    "Delassus",
    "State",
    "Terms",
    "bounds",
    "delassus",
    "delassus_from_matrices",
    "linalg",
    "mechanism",
    "mechanisms",
    "parameter",
    "static",
    "sweep",
    "terms",
]
