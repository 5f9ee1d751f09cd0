"""Figure 1(a): a rod whose lower tip runs in a horizontal guide."""

from jax import Array

from ..dynamics import Contact, mechanism, static
from .rigid_rod import RigidRod


@mechanism
class GuidedRod(RigidRod):
    """A pendulum with a sliding base: the lower tip runs in a straight horizontal guide that holds it both ways.

             o
            /
           / m, l
    ======/=======
         o  ) theta      guide y = 0
    ==============

    Reference point: the centre of mass. Frictionless, lambda = m (g - l/2 theta'^2 sin theta) / (1 + 3 cos^2 theta)
    (erratum A1). With friction, bound (Prop. 10) and critical friction coincide:
    (1 + 3 cos^2 theta) / (3 sin theta cos theta).

    Source: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1, section 2.1 equation (8) and section 3.2.2.
    """

    frictional: bool = static(True, "whether the guide is rough")

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (Contact("guide", "bilateral", self.frictional),)

    def gaps(self, q: Array) -> Array:
        return self.lower_height(q)[None]

    def slips(self, q: Array, v: Array) -> Array:
        return self.lower_speed(q, v)[None]
