"""From a mechanism to what its contacts feel: terms, whitened Jacobians, Delassus operators. Knows no solving."""

from .delassus import Delassus, delassus, delassus_from_matrices, whitened
from .mechanism import coordinates_of, mechanism, parameter, static
from .records import Contact, Coordinate, State
from .schur import BilateralSchur, bilateral_schur, without_frictionless_bilateral
from .terms import Terms, terms

__all__ = [
    "BilateralSchur",
    "Contact",
    "Coordinate",
    "Delassus",
    "State",
    "Terms",
    "bilateral_schur",
    "coordinates_of",
    "delassus",
    "delassus_from_matrices",
    "mechanism",
    "parameter",
    "static",
    "terms",
    "whitened",
    "without_frictionless_bilateral",
]
