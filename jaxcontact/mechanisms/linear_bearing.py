"""A plain linear bearing with an offset drive: the 2:1 rule of the bearing makers."""

import jax.numpy as jnp
from jax import Array

from ..dynamics import Contact, Coordinate, State, mechanism, parameter, static


@mechanism
class LinearBearing:
    """A carriage on a shaft, moved by a drive that pushes at a distance from the shaft.

            drive ->  +                      ^
                      |                      | offset Y
        [contact]-----*-----[contact]   ------  shaft y = 0
        |<-------- length X -------->|

    Reference point: the middle of the carriage, on the shaft; the centre of mass lies there. Coordinates q = (x, y,
    theta) in m, m, rad. Two rough bilateral contacts on the shaft, X apart, and a frictionless constraint that makes
    the driven point advance at a given speed. The carriage jams at mu = X / (2 Y), whatever the load: 0.25 at Y = 2 X.
    `norm_ratio` (Prop. 12) gives that value as long as 4 (J + m Y^2) >= m X^2 and the gaps are in metres.

    Source: the 2:1 ratio of plain-bearing design guides (igus, PBC Linear); moments about the middle give it in two
    lines: P Y = N X and P = 2 mu N.
    """

    length: float = parameter(1.0, "m", "distance X between the two contacts", positive=True)
    offset: float = parameter(2.0, "m", "distance Y of the drive from the shaft")
    mass: float = parameter(1.0, "kg", "mass of the carriage", positive=True)
    inertia: float = parameter(0.1, "kg m^2", "moment of inertia about the middle", positive=True)
    drive_speed: float = parameter(1.0, "m/s", "speed of the driven point")
    load: float = parameter(0.0, "N", "force on the middle of the carriage, in -y")
    frictional: bool = static(True, "whether the shaft is rough")

    coordinates = {"t": Coordinate("s", "time since the driven point passed the origin")}

    @property
    def contacts(self) -> tuple[Contact, ...]:
        return (
            Contact("rear", "bilateral", self.frictional),
            Contact("front", "bilateral", self.frictional),
            Contact("drive", "bilateral", False),
        )

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        return 0.5 * self.mass * (v[0] ** 2 + v[1] ** 2) + 0.5 * self.inertia * v[2] ** 2

    def applied_force(self, q: Array, v: Array, t) -> Array:
        return jnp.array([0.0, -self.load, 0.0], q.dtype)

    def gaps(self, q: Array, t) -> Array:
        half = 0.5 * self.length * jnp.sin(q[2])
        driven = q[0] - self.offset * jnp.sin(q[2])
        return jnp.stack([q[1] - half, q[1] + half, driven - self.drive_speed * t])

    def slips(self, q: Array, v: Array) -> Array:
        return jnp.stack([v[0], v[0], jnp.zeros_like(v[0])])

    def state(self, t=0.0) -> State:
        """The carriage aligned with the shaft, moving with the drive."""
        position = jnp.asarray(self.drive_speed * t)
        t = jnp.asarray(t).astype(position.dtype)
        q = jnp.array([position, 0.0, 0.0])
        return State(q, jnp.array([self.drive_speed, 0.0, 0.0], q.dtype), t)
