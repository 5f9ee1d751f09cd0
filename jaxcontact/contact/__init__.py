"""Sliding contact as a linear, absolute-value or complementarity problem; forces and accelerations back."""

from .certificate import Certificate
from .forces import ContactForces, contact_forces
from .residuals import Residuals
from .sliding import Sliding, normal_forces, sliding
from .solutions import Multiplicity, Solutions, classify, solutions

__all__ = [
    "Certificate",
    "ContactForces",
    "Multiplicity",
    "Residuals",
    "Sliding",
    "Solutions",
    "classify",
    "contact_forces",
    "normal_forces",
    "sliding",
    "solutions",
]
