"""A thin rigid rod in the plane: its energy and its tips, shared by the mechanisms built on it.

    upper tip  (x + l/2 cos theta, y + l/2 sin theta)
          o
         /
        *   centre of mass (x, y)
       /
      o  ) theta, from the horizontal
    lower tip  (x - l/2 cos theta, y - l/2 sin theta)

Coordinates q = (x, y, theta) in m, m, rad. Moment of inertia m l^2 / 12 about the centre of mass.
"""

import jax.numpy as jnp
from jax import Array, lax

from ..dynamics import Coordinate, State, mechanism, parameter


@mechanism
class RigidRod:
    """The rod itself, its lower tip standing at height zero; what touches it is said by the mechanisms derived from
    it."""

    length: float = parameter(1.0, "m", "length of the rod", positive=True)
    mass: float = parameter(1.0, "kg", "mass of the rod", positive=True)
    gravity: float = parameter(9.81, "m/s^2", "gravity, downwards")

    contacts = ()
    coordinates = {
        "theta": Coordinate("rad", "angle of the rod from the horizontal"),
        "x": Coordinate("m", "horizontal position of the centre of mass"),
        "speed": Coordinate("m/s", "horizontal velocity of the centre of mass"),
        "thetadot": Coordinate("rad/s", "angular velocity of the rod"),
    }

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        return 0.5 * self.mass * (v[0] ** 2 + v[1] ** 2) + self.mass * self.length**2 / 24 * v[2] ** 2

    def potential_energy(self, q: Array) -> Array:
        return self.mass * self.gravity * q[1]

    def lower_height(self, q: Array) -> Array:
        """m."""
        return q[1] - 0.5 * self.length * jnp.sin(q[2])

    def upper_height(self, q: Array) -> Array:
        """m."""
        return q[1] + 0.5 * self.length * jnp.sin(q[2])

    def lower_speed(self, q: Array, v: Array) -> Array:
        """Horizontal velocity of the lower tip, m/s."""
        return v[0] + 0.5 * self.length * jnp.sin(q[2]) * v[2]

    def upper_speed(self, q: Array, v: Array) -> Array:
        """Horizontal velocity of the upper tip, m/s."""
        return v[0] - 0.5 * self.length * jnp.sin(q[2]) * v[2]

    def horizontal_pull(self, q: Array, at_lower, at_upper) -> Array:
        """Generalised force of horizontal forces in +x at the two tips, N and N m."""
        lever = 0.5 * self.length * jnp.sin(q[2])
        return jnp.array([at_lower + at_upper, jnp.zeros_like(lever), lever * (at_lower - at_upper)], q.dtype)

    def state(self, theta, x=0.0, speed=None, thetadot=None) -> State:
        """Lower tip at height zero and staying there. At rest unless a velocity is given."""
        height, rise = 0.5 * self.length * jnp.sin(theta), 0.5 * self.length * jnp.cos(theta)
        q = jnp.array([x, height, theta])
        if speed is None and thetadot is None:
            return State(q)
        speed, thetadot = (0.0 if rate is None else rate for rate in (speed, thetadot))
        return State(q, jnp.array([speed, rise * thetadot, thetadot], q.dtype))


def height_of(spacing, height: Array) -> Array:
    """Where a guide lies, m: at `spacing`, or, if that is None, wherever the tip is, as fixed as any guide.

    With None a sweep over the angle is a sweep over rods held at that angle by guides at the fitting distance.
    """
    return lax.stop_gradient(height) if spacing is None else spacing
