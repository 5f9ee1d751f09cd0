"""Sliding contact as a linear, absolute-value or complementarity problem; forces and accelerations back."""

from .forces import ContactForces, contact_forces
from .residuals import Residuals
from .sliding import Sliding, normal_forces, sliding

__all__ = ["ContactForces", "Residuals", "Sliding", "contact_forces", "normal_forces", "sliding"]
