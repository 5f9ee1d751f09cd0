"""Figure 1(d): the Painlevé-Klein system, a rod between two guides."""

import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, mechanism, parameter, static
from .rigid_rod import RigidRod, height_of


@mechanism
class PainleveKlein(RigidRod):
    """A rod whose two tips run in two parallel guides.

    ===================
    <- F_2     o            upper guide y = D
    ==========/========
             / m, l
    ========/==========
    <- F_1 o  ) theta       lower guide y = 0
    ===================

    Reference point: the centre of mass. The forces F_1 (lower tip) and F_2 (upper tip) pull in -x. The guides fix
    theta. With both guides rough the bound (Prop. 10) is min(1 / (3 sin theta cos theta), cot theta), with a kink at
    cos^2 theta = 1/3; unique for every load if and only if mu_1 + mu_2 < 2 cot theta (erratum B1). With one rough guide
    (Prop. 12): 2 cot theta, which is exact.

    Source: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1, sections 3.2.2 and 3.2.3.
    """

    gravity: float = parameter(0.0, "m/s^2", "gravity, downwards")
    spacing: float | None = parameter(None, "m", "distance D of the guides; None: what the angle asks", positive=True)
    lower_pull: float = parameter(0.0, "N", "force F_1 at the lower tip, in -x")
    upper_pull: float = parameter(0.0, "N", "force F_2 at the upper tip, in -x")
    lower_frictional: bool = static(True, "whether the lower guide is rough")
    upper_frictional: bool = static(True, "whether the upper guide is rough")

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (
            Contact("lower guide", "bilateral", self.lower_frictional),
            Contact("upper guide", "bilateral", self.upper_frictional),
        )

    def applied_force(self, q: Array, v: Array, t) -> Array:
        return self.horizontal_pull(q, -self.lower_pull, -self.upper_pull)

    def gaps(self, q: Array) -> Array:
        upper = self.upper_height(q)
        return jnp.stack([self.lower_height(q), upper - height_of(self.spacing, upper)])

    def slips(self, q: Array, v: Array) -> Array:
        return jnp.stack([self.lower_speed(q, v), self.upper_speed(q, v)])
