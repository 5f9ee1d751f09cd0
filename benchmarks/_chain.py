"""A chain of hinged rods, every joint in a guide of its own: a mechanism with as many contacts as one likes."""

import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from jaxcontact.mechanisms.rigid_rod import height_of


@jc.mechanism
class GuidedChain:
    """Hinged rods of length and mass one, joint k in a rough horizontal guide at whatever height it has.

    Coordinates: first joint x, y, then the angle of each rod from the horizontal; rod i at theta (1 - i / (2 rods)).
    """

    length: float = jc.parameter(1.0, "m", "length of each rod", positive=True)
    mass: float = jc.parameter(1.0, "kg", "mass of each rod", positive=True)
    rods: int = jc.static(3, "number of rods")

    @property
    def contacts(self):
        return tuple(jc.Contact(f"joint {k}", "bilateral", True) for k in range(self.rods + 1))

    def kinetic_energy(self, q, v):
        x, y, energy = v[0], v[1], 0.0
        for sine, cosine, rate in zip(jnp.sin(q[2:]), jnp.cos(q[2:]), v[2:]):
            dx, dy = -0.5 * self.length * sine * rate, 0.5 * self.length * cosine * rate
            energy = energy + 0.5 * self.mass * ((x + dx) ** 2 + (y + dy) ** 2)
            energy = energy + self.mass * self.length**2 / 24 * rate**2
            x, y = x + 2 * dx, y + 2 * dy
        return energy

    def gaps(self, q):
        heights = [q[1]]
        for sine in jnp.sin(q[2:]):
            heights.append(heights[-1] + self.length * sine)
        return jnp.stack([height - height_of(None, height) for height in heights])

    def slips(self, q, v):
        speeds = [v[0]]
        for sine, rate in zip(jnp.sin(q[2:]), v[2:]):
            speeds.append(speeds[-1] - self.length * sine * rate)
        return jnp.stack(speeds)

    def state(self, theta):
        angles = [theta * (1 - i / (2 * self.rods)) for i in range(self.rods)]
        return jc.State(jnp.stack([jnp.zeros_like(theta), jnp.zeros_like(theta), *angles]))


def chain_terms(theta, rods):
    """M (count, n, n), G and H (count, n, m) of the chain, stated by hand."""
    angle = theta[:, None] * (1 - np.arange(rods, dtype=theta.dtype) / (2 * rods))
    s, c = np.sin(angle), np.cos(angle)
    count, n, m = len(theta), rods + 2, rods + 1
    after = rods - 1 - np.arange(rods, dtype=theta.dtype)
    lever = np.minimum(after[:, None], after[None, :]) + 0.5
    M = np.zeros((count, n, n), theta.dtype)
    M[:, 0, 0] = M[:, 1, 1] = rods
    M[:, 2:, 0] = M[:, 0, 2:] = -(after + 0.5) * s
    M[:, 2:, 1] = M[:, 1, 2:] = (after + 0.5) * c
    M[:, 2:, 2:] = lever * (s[:, :, None] * s[:, None, :] + c[:, :, None] * c[:, None, :])
    M[:, range(2, n), range(2, n)] = after + 1 / 3
    G, H = np.zeros((2, count, n, m), theta.dtype)
    G[:, 1], H[:, 0] = 1, 1
    earlier = np.arange(rods)[:, None] < np.arange(m)[None, :]
    G[:, 2:], H[:, 2:] = earlier * c[:, :, None], earlier * -s[:, :, None]
    return M, G, H
