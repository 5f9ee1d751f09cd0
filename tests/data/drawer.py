"""A user's mechanism in a file of its own."""

import jax.numpy as jnp

import jaxcontact as jc


@jc.mechanism
class Drawer:
    """A drawer guided by one side runner; (x, y, angle) of its centre, the runner at half its width."""

    mass: float = 2.0  # kg
    width: float = 0.8  # m, across
    depth: float = 0.4  # m, along the runner
    contacts = (jc.Contact("front", "bilateral", frictional=True), jc.Contact("rear", "bilateral", frictional=True))

    def kinetic_energy(self, q, v):
        inertia = self.mass * (self.width**2 + self.depth**2) / 12
        return 0.5 * self.mass * (v[0] ** 2 + v[1] ** 2) + 0.5 * inertia * v[2] ** 2

    def gaps(self, q):
        ends = jnp.stack([0.5 * self.depth, -0.5 * self.depth])
        return q[1] + ends * jnp.sin(q[2]) + 0.5 * self.width * (jnp.cos(q[2]) - 1)

    def slips(self, q, v):
        ends = jnp.stack([0.5 * self.depth, -0.5 * self.depth])
        return v[0] - (ends * jnp.sin(q[2]) + 0.5 * self.width * jnp.cos(q[2])) * v[2]

    def state(self, x=0.0):
        return jc.State(jnp.stack([x, 0.0 * x, 0.0 * x]))
