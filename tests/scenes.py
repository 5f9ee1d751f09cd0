"""Scenes for the tests of contact: mechanisms that state their terms, and their solutions by brute force in NumPy."""

from itertools import product

import jax.numpy as jnp
import numpy as np

import jaxcontact as jc


@jc.mechanism
class Stated:
    """A mechanism that is its terms at one state: any M, F, G, H, c and slips."""

    M: object  # (n, n)
    F: object  # (n,)
    G: object  # (n, m)
    H: object  # (n, m)
    c: object  # (m,)
    slip: object  # (m,)
    contacts: tuple = jc.static(())

    def mass_matrix(self, q):
        return self.M

    def bias(self, q, v, t):
        return self.F

    def gap_gradients(self, q):
        return self.G

    def slip_directions(self, q):
        return self.H

    def gap_curvature(self, q, v):
        return self.c

    def gaps(self, q):
        return 0.0 * q[:1] * jnp.ones_like(self.c)

    def slips(self, q, v):
        return self.slip

    def state(self):
        return jc.State(jnp.zeros_like(self.F), jnp.ones_like(self.F))


def random_scenes(contacts, count, n=5, seed=0):
    """(a `Stated` with a batch axis in front of every array, mu (count, m)); NaN friction where there is none."""
    rng = np.random.default_rng(seed)
    m = len(contacts)
    rough = np.array([contact.frictional for contact in contacts])
    R = rng.normal(size=(count, n, n))
    M = R @ R.transpose(0, 2, 1) + 0.5 * np.eye(n)
    arrays = {
        "M": M,
        "F": rng.normal(size=(count, n)),
        "G": rng.normal(size=(count, n, m)),
        "H": rng.normal(size=(count, n, m)),
        "c": rng.normal(size=(count, m)),
        "slip": rng.choice([-1.0, 1.0], size=(count, m)),
    }
    mu = np.where(rough, rng.uniform(0.0, 1.5, size=(count, m)), np.nan)
    return Stated(**{name: jnp.asarray(x) for name, x in arrays.items()}, contacts=contacts), jnp.asarray(mu)


def lane(batch, i):
    """One scene of a batch, as NumPy arrays."""
    return {name: np.asarray(getattr(batch, name)[i]) for name in ("M", "F", "G", "H", "c", "slip")}


def brute_force(contacts, scene, mu):
    """Every solution lambda of (36) with its constraints, by trying all signs and all sets of open contacts.

    On each mode it is the linear system (37) in (a, lambda), which shares no step with the library's elimination.
    Returns (solutions, margin): margin is the smallest distance to a change of mode, relative; 0 if a mode is singular.
    """
    M, F, G, H, c, slip = (scene[name] for name in ("M", "F", "G", "H", "c", "slip"))
    n, m = G.shape
    choices = [(1, -1) if k.bilateral and k.frictional else (1,) if k.bilateral else (1, 0) for k in contacts]
    pull = np.array([mu[i] * np.sign(slip[i]) if k.frictional else 0.0 for i, k in enumerate(contacts)])
    found, margin = [], np.inf
    for mode in product(*choices):
        sign = np.array(mode, float)
        K = np.block([[M, -(G - H * (pull * sign))], [(G * (sign != 0)).T, np.diag((sign == 0).astype(float))]])
        condition = np.linalg.cond(K)
        if condition > 1e9:
            return found, 0.0
        x = np.linalg.solve(K, np.concatenate([-F, -c * (sign != 0)]))
        a, lam = x[:n], x[n:]
        tests = [sign[i] * lam[i] if sign[i] else G[:, i] @ a + c[i] for i in range(m) if len(choices[i]) > 1]
        tests = np.array(tests) / max(1.0, np.abs(x).max())
        margin = min(margin, np.abs(tests).min(initial=np.inf) / condition)
        if (tests >= 0).all():
            found.append(lam)
    return found, margin


def gauss_projection(contacts, scene):
    """The acceleration of least constraint: min |a + M^-1 F|_M with G_b^T a + c_b = 0 and G_u^T a + c_u >= 0.

    (16), (28), (29): equality-constrained least squares on every set of active constraints; the best feasible one is
    the minimum, the problem being strictly convex.
    """
    M, F, G, c = (scene[name] for name in ("M", "F", "G", "c"))
    free, best, least = -np.linalg.solve(M, F), None, np.inf
    for active in product(*[(True,) if k.bilateral else (False, True) for k in contacts]):
        A = G[:, np.array(active, bool)]
        K = np.block([[M, -A], [A.T, np.zeros((A.shape[1],) * 2)]])
        x = np.linalg.lstsq(K, np.concatenate([-F, -c[np.array(active, bool)]]), rcond=None)[0]
        a = x[: F.size]
        feasible = all((G[:, i] @ a + c[i]) >= -1e-9 for i in range(c.size))
        cost = (a - free) @ M @ (a - free)
        if feasible and cost < least:
            best, least = a, cost
    return best
