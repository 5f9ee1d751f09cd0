"""Figure 1(e): the flexible Painlevé-Klein system, two half-rods on a line with a spring between them."""

import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, Coordinate, State, mechanism, parameter, static
from .rigid_rod import height_of


@mechanism
class FlexiblePainleveKlein:
    """A telescoping rod between two guides: two half-rods of mass m/2 and length l/2 on one line, a gap d between them.

    ======================
                    o         upper guide y = D
    ===============/======
                  /  m/2, l/2
                 z   d, spring
    ============/=========
        (x, y) o  ) theta     lower guide y = 0; half-rod m/2, l/2
    ======================

    Reference point: the lower tip. Coordinates q = (x, y, d, theta) in m, m, m, rad. Centres of the halves at l/4 and
    3l/4 + d along the line. Negative d down to -l/2 telescopes; below -l the tips have changed places, which the
    algebra allows (the d = -1.2 l of Figure 5).
    Bound (Prop. 10): (3d^2 + 3dl + l^2) / (l (3d + 2l) sin theta cos theta) for d > -2l/3. Unique for every load if and
    only if mu_1 + mu_2 < (6d^2 + 9dl + 4l^2 + p cos 2theta) / (|p| sin theta cos theta), p = l (3d + 2l) (erratum A17).

    Source: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1, section 3.2.2, Figure 5.
    """

    length: float = parameter(1.0, "m", "length l of the two half-rods together", positive=True)
    mass: float = parameter(1.0, "kg", "mass m of the two half-rods together", positive=True)
    gravity: float = parameter(9.81, "m/s^2", "gravity, downwards")
    stiffness: float = parameter(0.0, "N/m", "spring between the half-rods")
    free_gap: float = parameter(0.0, "m", "gap at which the spring is slack")
    spacing: float | None = parameter(None, "m", "distance D of the guides; None: what the state asks")
    lower_frictional: bool = static(True, "whether the lower guide is rough")
    upper_frictional: bool = static(True, "whether the upper guide is rough")

    coordinates = {
        "theta": Coordinate("rad", "angle of the rod from the horizontal"),
        "d": Coordinate("m", "gap between the half-rods"),
        "x": Coordinate("m", "horizontal position of the lower tip"),
        "speed": Coordinate("m/s", "horizontal velocity of the lower tip"),
        "thetadot": Coordinate("rad/s", "angular velocity of the rod"),
    }

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (
            Contact("lower guide", "bilateral", self.lower_frictional),
            Contact("upper guide", "bilateral", self.upper_frictional),
        )

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        sin, cos = jnp.sin(q[3]), jnp.cos(q[3])
        near, far = 0.25 * self.length, 0.75 * self.length + q[2]
        first = (v[0] - near * sin * v[3]) ** 2 + (v[1] + near * cos * v[3]) ** 2
        second = (v[0] + cos * v[2] - far * sin * v[3]) ** 2 + (v[1] + sin * v[2] + far * cos * v[3]) ** 2
        return 0.25 * self.mass * (first + second) + self.mass * self.length**2 / 96 * v[3] ** 2

    def potential_energy(self, q: Array) -> Array:
        heights = 2 * q[1] + (self.length + q[2]) * jnp.sin(q[3])
        return 0.5 * self.mass * self.gravity * heights + 0.5 * self.stiffness * (q[2] - self.free_gap) ** 2

    def gaps(self, q: Array) -> Array:
        upper = q[1] + (self.length + q[2]) * jnp.sin(q[3])
        return jnp.stack([q[1], upper - height_of(self.spacing, upper)])

    def slips(self, q: Array, v: Array) -> Array:
        upper = v[0] + jnp.cos(q[3]) * v[2] - (self.length + q[2]) * jnp.sin(q[3]) * v[3]
        return jnp.stack([v[0], upper])

    def state(self, theta, d=0.0, x=0.0, speed=None, thetadot=None) -> State:
        """Both tips in the guides and staying there: d' follows from theta'. At rest unless a velocity is given."""
        q = jnp.array([x, 0.0, d, theta])
        if speed is None and thetadot is None:
            return State(q)
        speed, thetadot = (0.0 if rate is None else rate for rate in (speed, thetadot))
        d_rate = -(self.length + d) * jnp.cos(theta) / jnp.sin(theta) * thetadot
        return State(q, jnp.array([speed, 0.0, d_rate, thetadot], q.dtype))
