"""Figure 1(b): a rod sliding on the floor, Painlevé's example."""

from jax import Array

from ..dynamics import Contact, mechanism, static
from .rigid_rod import RigidRod


@mechanism
class PainleveRod(RigidRod):
    """A rod whose lower tip slides on a horizontal floor and may take off.

             o
            /
           / m, l
          /
         o  ) theta
    ------------------ floor y = 0

    Reference point: the centre of mass. Bound (Prop. 13) and critical friction coincide:
    (1 + 3 cos^2 theta) / (3 sin theta cos theta), least 4/3 at tan theta = 2. Friction harms when the tip slides to the
    left (xi = -1) and 0 < theta < pi/2.

    Source: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1, sections 2.2 and 3.3, equation (59);
    P. Painlevé, Leçons sur le frottement (1895).
    """

    frictional: bool = static(True, "whether the floor is rough")

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (Contact("floor", "unilateral", self.frictional),)

    def gaps(self, q: Array) -> Array:
        return self.lower_height(q)[None]

    def slips(self, q: Array, v: Array) -> Array:
        return self.lower_speed(q, v)[None]
