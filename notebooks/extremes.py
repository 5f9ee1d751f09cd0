# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The ends of the ranges
#
# What is promised where the data are extreme, what comes out, and where it breaks. Each reference is a closed form evaluated with
# mpmath at the numbers as they are rounded, so that only the library's own errors are counted. They are given in roundings: 1 is
# $2.2 \cdot 10^{-16}$ in float64 and $1.2 \cdot 10^{-7}$ in float32. `tests/test_extremes.py` holds the promises.

# %%
# %matplotlib inline
import dataclasses
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import mpmath
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxcontact as jc
from jaxcontact.mechanisms import GuidedRod, LinearBearing, PainleveKlein

mpmath.mp.dps = 60
DTYPES = (np.float64, np.float32)


def over(quantity, values):
    return [np.asarray(part, float) for part in jax.jit(jax.vmap(quantity))(jnp.asarray(values))]


def with_dtype(mechanism, dtype):
    return jax.tree.map(dtype, mechanism)


def thresholds(here):
    return jc.bounds.critical(here), jc.bounds.norm_ratio(here)


def roundings(value, exact, dtype):
    return abs(value / exact - 1) / np.finfo(dtype).eps


def table(head, *columns):
    print("".join(f"{name:>22}" for name in head))
    for row in zip(*columns, strict=True):
        print("".join(f"{x:>22}" if isinstance(x, str) else f"{x:22.3g}" for x in row))


def names(status):
    return [jc.Status(int(s)).name for s in status]


# %% [markdown]
# ## Upright and flat
#
# A rod between two rough guides, the angle within $10^{-k}$ of either end. Promise: `critical` $= \cot\theta$ and `norm_ratio`
# $= \min(1/(3\sin\theta\cos\theta), \cot\theta)$ to a few roundings. Where it breaks: nearer to upright than a few dozen roundings
# `critical` calls the two gaps dependent and is 0, which never claims too much.

# %%
near = 10.0 ** -np.arange(1.0, 13.0)


def upright_and_flat(dtype):
    theta = np.concatenate([near, np.pi / 2 - near]).astype(dtype)
    rod = with_dtype(PainleveKlein(), dtype)
    critical, _ = over(lambda t: thresholds(jc.delassus(rod, rod.state(theta=t))), theta)
    exact = np.array([float(abs(mpmath.cot(mpmath.mpf(float(t))))) for t in theta])
    lost = exact[critical == 0]
    end = f"0 from cot theta = {lost.max():.1e} down" if lost.size else "never called dependent"
    print(
        f"{np.dtype(dtype).name}: worst error {roundings(critical, exact, dtype)[critical > 0].max():.1f} roundings; {end}"
    )


for dtype in DTYPES:
    upright_and_flat(dtype)

# %% [markdown]
# ## Beside the critical friction
#
# One contact at $\mu = \mu_{crit} (1 \pm 10^{-k})$. Promise: below, one force, with no more than $A / (A - \mu |A_t|)$ roundings of
# error; above, no answer and the reason. It holds down to the last digit.

# %%
rod = GuidedRod()
state = rod.state(theta=0.9, speed=-1.0)
limit = float(jc.bounds.critical(jc.delassus(rod, state)))


def force(mu):
    found = jc.contact_forces(rod, state, mu[None])
    return found.status, found.normal[0]


k = np.arange(1.0, 16.0)
status, normal = over(force, limit * (1 + np.concatenate([-(10.0**-k), 10.0**-k])))
table(("k", "below", "force (N)", "above"), k, names(status[:15]), normal[:15], names(status[15:]))

# %% [markdown]
# ## Ratios of masses and lengths
#
# The rod with a point mass at its upper tip: the critical friction is $\cot\theta$ whatever the tip weighs. `norm_ratio` falls as
# one over the ratio of masses (it depends on the scaling of the rows), and the rounded mass matrix knows it to as many roundings.
# A plain bearing jams at half its length over the offset of the drive; in float32, from an offset of $10^6$ on, its three constraints
# cannot be told from dependent ones, and `critical` is 0.


# %%
@jc.mechanism
class TippedRod(PainleveKlein):
    """The rod between two guides with a point mass at its upper tip."""

    tip: float = 1.0  # kg

    def kinetic_energy(self, q, v):
        rise = 0.5 * self.length * v[2]
        x, y = v[0] - rise * jnp.sin(q[2]), v[1] + rise * jnp.cos(q[2])
        return PainleveKlein.kinetic_energy(self, q, v) + 0.5 * self.tip * (x**2 + y**2)


ratio = 10.0 ** np.arange(-12, 13, 2)


def of_ratios(dtype):
    rod, bearing = with_dtype(TippedRod(), dtype), with_dtype(LinearBearing(), dtype)

    def tipped(mass):
        loaded = dataclasses.replace(rod, tip=mass)
        return thresholds(jc.delassus(loaded, loaded.state(theta=dtype(0.9))))

    def offset(y):
        moved = dataclasses.replace(bearing, offset=y)
        return thresholds(jc.delassus(moved, moved.state(dtype(0.0))))

    row = ratio.astype(dtype)
    critical, bound = over(tipped, row)
    jams, _ = over(offset, row)
    cot = float(mpmath.cot(mpmath.mpf(float(dtype(0.9)))))
    errors = roundings(critical, cot, dtype), roundings(jams, 0.5 / row.astype(float), dtype)
    print(np.dtype(dtype).name)
    table(("ratio", "rod: roundings", "bearing: roundings", "rod: norm_ratio"), ratio, *errors, bound)


for dtype in DTYPES:
    of_ratios(dtype)

# %% [markdown]
# In float32 the rod is rounded away beside a tip of $10^8$ kg: from there on the answer is NaN or, for `norm_ratio`, noise. Use
# float64 for ratios beyond $10^4$.
#
# ## Contacts that nearly depend on each other
#
# A block pressed by 2 N on two pins a distance $d$ apart; each carries 1 N, and `critical` is $2d$. Promise: SOLVED with
# $1/d^2$ roundings of error, then REDUNDANT, where only the sum is determined.


# %%
@jc.mechanism
class TwoPins:
    """A block of mass and inertia one on two pins."""

    distance: float = 1.0  # m
    contacts = (jc.Contact("left", "bilateral", True), jc.Contact("right", "bilateral", True))

    def mass_matrix(self, q):
        return jnp.eye(3, dtype=q.dtype)

    def applied_force(self, q, v, t):
        return jnp.array([0.0, -2.0, 0.0], q.dtype)

    def gaps(self, q):
        rise = 0.5 * self.distance * q[2]
        return jnp.stack([q[1] - rise, q[1] + rise])

    def slips(self, q, v):
        return jnp.stack([v[0] + 0.25 * v[2], v[0] - 0.25 * v[2]])


distance = np.append(10.0 ** -np.arange(0.0, 17.0), 0.0)
pins, state = TwoPins(), jc.State(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0]))


def held(d):
    here = dataclasses.replace(pins, distance=d)
    found = jc.contact_forces(here, state, jnp.stack([d, d]))
    return jc.bounds.critical(jc.delassus(here, state)), found.status, found.normal[0], jnp.sum(found.normal)


critical, status_of_pins, left, total = over(held, distance)
head = ("d (m)", "critical", "status", "left pin (N)", "both (N)")
table(head, distance, critical, names(status_of_pins), left, total)

# %% [markdown]
# ## Units
#
# Kilogram and metre replaced by $10^k$ of them, the loads with them. Promise: nothing changes as long as the numbers exist. It ends
# where the inertia $m l^2$ overflows or vanishes, beyond $10^{\pm 100}$ in float64 and $10^{\pm 12}$ in float32, with BAD_INPUT.

# %%
powers = (-120, -100, -50, 0, 50, 100, 120)
rod = PainleveKlein()


def measured(one):
    here = dataclasses.replace(rod, mass=one, length=one, gravity=9.81 * one, lower_pull=one * one)
    found = jc.contact_forces(here, here.state(theta=0.9, speed=-one), jnp.full(2, 0.5))
    return found.normal[0] / (one * one), found.status


normal, status = over(measured, np.array([float(f"1e{k}") for k in powers]))
table(("power of ten", "force in its unit", "status"), np.array(powers, float), normal, names(status))

# %% [markdown]
# ## Many contacts
#
# A stack of blocks whose contacts lean and slide to and fro. The reference is NumPy's linear solve, all contacts pressing. Lemke's
# method takes one step for each contact. What looks at every vertex refuses: `critical` beyond 20 000 vertices, `solutions`
# beyond ten contacts, both with an error that says what to use instead.


# %%
def zigzag(blocks, lean=0.05, mu=0.05, gravity=9.81):
    side = (-1.0) ** np.arange(blocks)
    G, H = np.zeros((2, 2, blocks, blocks))
    for i in range(blocks):
        G[:, i, i] = np.sin(lean * side[i]), np.cos(lean * side[i])
        H[:, i, i] = np.cos(lean * side[i]), -np.sin(lean * side[i])
        if i:
            G[:, i - 1, i], H[:, i - 1, i] = -G[:, i, i], -H[:, i, i]
    G, H = G.reshape(2 * blocks, blocks), H.reshape(2 * blocks, blocks)
    return G.T @ G - G.T @ H * (mu * side), -G.T @ np.repeat([0.0, gravity], blocks)


sizes, rows = (10, 100, 300), []
for blocks in sizes:
    M, q = zigzag(blocks)
    exact = np.linalg.solve(M, -q)
    for dtype in DTYPES if blocks == 100 else (np.float64,):
        solve = (
            jax.jit(lambda M, q: jc.solve(jc.LCP(M, q), jc.Lemke())).lower(M.astype(dtype), q.astype(dtype)).compile()
        )
        began = time.perf_counter()
        found = jax.block_until_ready(solve(M.astype(dtype), q.astype(dtype)))
        rows.append(
            (
                blocks,
                np.dtype(dtype).name,
                jc.Status(int(found.status)).name,
                float(found.steps),
                float(abs(found.z - exact).max() / exact.max()),
                time.perf_counter() - began,
            )
        )
table(("contacts", "dtype", "status", "steps", "error", "seconds"), *zip(*rows))

# %% [markdown]
# The error grows with the condition of the matrix. A thousand of these contacts take less than a second (`pytest -m slow`). So do a
# thousand without friction, in one column of boxes or in columns of five: pivoting gives every force as the weight above it, to 14
# digits of the greatest; Gauss-Seidel with its thousand sweeps gives 13 in columns of five and says MAX_STEPS of the tall one.
#
# ## In one picture
#
# The forces on the two pins beside their distance: the digits that are lost are those that the condition predicts, until the status
# says that only the sum is known.

# %%
solved = status_of_pins == jc.Status.SOLVED
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.loglog(distance[solved], np.maximum(abs(left - 1)[solved], 1e-17), "o", label="SOLVED: error of one force")
axes.loglog(
    distance[:-1][~solved[:-1]], abs(total / 2 - 1)[:-1][~solved[:-1]] + 1e-17, "s", label="REDUNDANT: error of the sum"
)
axes.loglog(distance[:-1], np.minimum(2.2e-16 / distance[:-1] ** 2, 1), "--", color="grey", label="one rounding / d²")
axes.set(xlabel="distance of the pins (m)", ylabel="relative error (10⁻¹⁷: none)")
axes.grid(color="#d9d9d9", lw=0.6)
axes.legend(frameon=False)
plt.close(figure)  # shown once, below
figure
