"""A rod with two unilateral tips: between a floor and a ceiling."""

import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, mechanism, parameter, static
from .rigid_rod import RigidRod, height_of


@mechanism
class RodBetweenFloorAndCeiling(RigidRod):
    """A rod caught between floor and ceiling, both of which only push: Figure 1(c) with a floor in place of the guide.

    ----------------- ceiling y = D
             o
            /
           / m, l
          o  ) theta
    ----------------- floor y = 0

    Reference point: the centre of mass. Bound (Prop. 13): min(1 / (3 sin theta cos theta), cot theta).

    Source: the variant of section 2.3 with two unilateral contacts; Blumentals, Brogliato, Bertails-Descoubes,
    HAL hal-01096394v1, Proposition 13.
    """

    spacing: float | None = parameter(None, "m", "height D of the ceiling; None: where the upper tip is", positive=True)
    floor_frictional: bool = static(True, "whether the floor is rough")
    ceiling_frictional: bool = static(True, "whether the ceiling is rough")

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (
            Contact("floor", "unilateral", self.floor_frictional),
            Contact("ceiling", "unilateral", self.ceiling_frictional),
        )

    def gaps(self, q: Array) -> Array:
        upper = self.upper_height(q)
        return jnp.stack([self.lower_height(q), height_of(self.spacing, upper) - upper])

    def slips(self, q: Array, v: Array) -> Array:
        return jnp.stack([self.lower_speed(q, v), self.upper_speed(q, v)])
