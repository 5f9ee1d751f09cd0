"""Figure 1(f): the articulated Painlevé-Klein system, two hinged links between two guides."""

import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, Coordinate, State, mechanism, parameter, static
from .rigid_rod import height_of


@mechanism
class ArticulatedPainleveKlein:
    """Two links of mass m/2 and length l/2, hinged to each other, whose free ends run in two parallel guides.

    =======================
                  o            upper guide y = D
    =============/=========
                / ) theta_2    second link m/2, l/2
               o
              /                first link m/2, l/2
    =========/=============
     (x, y) o  ) theta_1       lower guide y = 0
    =======================

    Reference point: the lower end. Coordinates q = (x, y, theta_1, theta_2) in m, m, rad, rad (erratum A18), angles
    from the horizontal. Straight, theta_1 = theta_2: bound (Prop. 10) = critical = cot theta, where the gradient in
    (theta_1, theta_2) has a kink. Closed forms: Figure 6.

    Source: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1, section 3.2.2, Figure 6.
    """

    length: float = parameter(1.0, "m", "length l of the two links together", positive=True)
    mass: float = parameter(1.0, "kg", "mass m of the two links together", positive=True)
    gravity: float = parameter(9.81, "m/s^2", "gravity, downwards")
    spacing: float | None = parameter(None, "m", "distance D of the guides; None: what the state asks", positive=True)
    lower_frictional: bool = static(True, "whether the lower guide is rough")
    upper_frictional: bool = static(True, "whether the upper guide is rough")

    coordinates = {
        "theta1": Coordinate("rad", "angle of the first link from the horizontal"),
        "theta2": Coordinate("rad", "angle of the second link from the horizontal"),
        "x": Coordinate("m", "horizontal position of the lower end"),
        "speed": Coordinate("m/s", "horizontal velocity of the lower end"),
        "theta1dot": Coordinate("rad/s", "angular velocity of the first link"),
    }

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (
            Contact("lower guide", "bilateral", self.lower_frictional),
            Contact("upper guide", "bilateral", self.upper_frictional),
        )

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        near, link = 0.25 * self.length, 0.5 * self.length
        s1, c1, s2, c2 = jnp.sin(q[2]), jnp.cos(q[2]), jnp.sin(q[3]), jnp.cos(q[3])
        first = (v[0] - near * s1 * v[2]) ** 2 + (v[1] + near * c1 * v[2]) ** 2
        second = (v[0] - link * s1 * v[2] - near * s2 * v[3]) ** 2 + (v[1] + link * c1 * v[2] + near * c2 * v[3]) ** 2
        return 0.25 * self.mass * (first + second) + self.mass * self.length**2 / 192 * (v[2] ** 2 + v[3] ** 2)

    def potential_energy(self, q: Array) -> Array:
        heights = 2 * q[1] + self.length * (0.75 * jnp.sin(q[2]) + 0.25 * jnp.sin(q[3]))
        return 0.5 * self.mass * self.gravity * heights

    def gaps(self, q: Array) -> Array:
        upper = q[1] + 0.5 * self.length * (jnp.sin(q[2]) + jnp.sin(q[3]))
        return jnp.stack([q[1], upper - height_of(self.spacing, upper)])

    def slips(self, q: Array, v: Array) -> Array:
        return jnp.stack([v[0], v[0] - 0.5 * self.length * (jnp.sin(q[2]) * v[2] + jnp.sin(q[3]) * v[3])])

    def state(self, theta1, theta2=None, x=0.0, speed=None, theta1dot=None) -> State:
        """Both ends in the guides and staying there: theta_2' follows from theta_1'. At rest unless a velocity is
        given.

        Without theta2 it follows from the distance of the guides, theta_2 = arcsin(2D/l - sin theta_1), NaN where they
        are too far apart; without that distance either, the links are straight.
        """
        theta2 = self._second_angle(theta1) if theta2 is None else theta2
        q = jnp.array([x, 0.0, theta1, theta2])
        if speed is None and theta1dot is None:
            return State(q)
        speed, theta1dot = (0.0 if rate is None else rate for rate in (speed, theta1dot))
        theta2dot = -jnp.cos(theta1) / jnp.cos(theta2) * theta1dot
        return State(q, jnp.array([speed, 0.0, theta1dot, theta2dot], q.dtype))

    def _second_angle(self, theta1):
        if self.spacing is None:
            return theta1
        return jnp.arcsin(2 * self.spacing / self.length - jnp.sin(theta1))
