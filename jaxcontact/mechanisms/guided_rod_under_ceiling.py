"""Figure 1(c): a rod with one bilateral and one unilateral tip."""

import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, mechanism, parameter, static
from .rigid_rod import RigidRod, height_of


@mechanism
class GuidedRodUnderCeiling(RigidRod):
    """A rod whose lower tip runs in a guide while its upper tip touches a ceiling that can only push down.

    ------------------- ceiling y = D
               o   -> f_u
              /
             / m, l
    ========/==========
           o  ) theta      -> f_b, guide y = 0
    ===================

    Reference point: the centre of mass. The horizontal forces f_b, f_u at the tips pull in +x. Between guide and
    ceiling the angle cannot change, theta' = 0 (but at theta = pi/2: A_c = 0 and w_c = l theta'^2, erratum A6).
    A_c = 12 cos^2 theta / (m (3 cos^2 theta + 1)); w_c after erratum A5. With friction at both tips, exactly:
    mu_b < (1 + 3 cos^2 theta) / (3 sin theta cos theta) and mu_b + xi_u mu_u < 2 cot theta.

    Source: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1, sections 2.3 and 3.4.
    """

    gravity: float = parameter(0.0, "m/s^2", "gravity, downwards")
    spacing: float | None = parameter(None, "m", "height D of the ceiling; None: where the upper tip is", positive=True)
    guide_pull: float = parameter(0.0, "N", "horizontal force f_b at the lower tip")
    ceiling_pull: float = parameter(0.0, "N", "horizontal force f_u at the upper tip")
    guide_frictional: bool = static(True, "whether the guide is rough")
    ceiling_frictional: bool = static(True, "whether the ceiling is rough")

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (
            Contact("guide", "bilateral", self.guide_frictional),
            Contact("ceiling", "unilateral", self.ceiling_frictional),
        )

    def applied_force(self, q: Array, v: Array, t) -> Array:
        return self.horizontal_pull(q, self.guide_pull, self.ceiling_pull)

    def gaps(self, q: Array) -> Array:
        upper = self.upper_height(q)
        return jnp.stack([self.lower_height(q), height_of(self.spacing, upper) - upper])

    def slips(self, q: Array, v: Array) -> Array:
        return jnp.stack([self.lower_speed(q, v), self.upper_speed(q, v)])
