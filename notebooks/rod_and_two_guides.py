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
# # The Painlevé rod and the two guides
#
# A piece of chalk pushed across the blackboard starts to jump. In 1895 Paul Painlevé found out why the textbook equations cannot
# even say what it does: with enough friction, a rod sliding on its tip has no acceleration that satisfies rigid-body
# dynamics and Coulomb's law together, or two of them. This notebook looks at how much friction is enough, first for the rod,
# then for Felix Klein's variant between two guides, and ends at the best angle of that mechanism, which is a kink.
#
# Source of the mechanics: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1 (2014), corrected where it errs.

# %%
# %matplotlib inline
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax

jax.config.update("jax_enable_x64", True)

import jaxcontact as jc
from jaxcontact.mechanisms import PainleveKlein, PainleveRod

# %% [markdown]
# ## One tip on the floor
#
# The rod is geometry as data. `delassus` says what its contact feels: how strongly a normal force accelerates the tip away
# from the floor (`A_nu`), and how strongly friction does (`A_tu`).

# %%
rod = PainleveRod(length=1.0, mass=1.0)
here = jc.delassus(rod, rod.state(theta=1.1))
here.A_nu, here.A_tu

# %% [markdown]
# When the tip slides to the left, friction pushes it to the right and turns the rod *into* the floor. At
# $\mu = A_{nu} / |A_{tu}|$ a normal force no longer lifts the tip at all. That is the bound, and for a single contact it is exact:
# $(1 + 3\cos^2\theta) / (3 \sin\theta\cos\theta)$, never below $4/3$.


# %%
def bound(mechanism, theta):
    return jc.bounds.norm_ratio(jc.delassus(mechanism, mechanism.state(theta=theta)))


bound.long_name = "friction bound"
curve = jc.sweep({"mu_max": bound}, rod, theta=jnp.linspace(0.2, 1.5, 600), progress=False)
least = curve.mu_max.argmin("theta")
float(curve.mu_max[least]), float(jnp.tan(curve.theta[least].item()))  # 4/3 at tan theta = 2

# %%
jc.atlas.draw_curve(curve)

# %% [markdown]
# Beyond the bound, gravity alone decides between no solution and two. At $\theta = 1.1$ the bound is 1.334:

# %%
for mu in (1.0, 1.3, 1.6):
    found = jc.solutions(here, mu=jnp.array([mu]), xi=jnp.array([-1.0]))
    print(f"mu = {mu}: {int(found.count)} solution(s)", np.asarray(found.normal)[np.asarray(found.valid)].ravel())

# %% [markdown]
# At rest, the free tip falls ($w = -g < 0$): below the bound exactly one force holds it, above there is none (the
# *inconsistent* region). Spinning fast enough, $w > 0$, the tip would lift by itself: above the bound there are then two
# solutions, lift-off and an ever harder push (the *indeterminate* region).

# %%
spinning = jc.delassus(rod, rod.state(theta=1.1, speed=-3.0, thetadot=6.0))
for mu in (1.0, 1.6):
    found = jc.solutions(spinning, mu=jnp.array([mu]), xi=jnp.array([-1.0]))
    print(f"mu = {mu}: {int(found.count)} solution(s)", np.asarray(found.normal)[np.asarray(found.valid)].ravel())

# %% [markdown]
# ## Two guides
#
# Klein put both tips into guides, which hold the rod both ways. The tutorial's bound (Proposition 10) is
# $\min(1/(3\sin\theta\cos\theta), \cot\theta)$; the exact threshold, for every load and every direction of sliding, is
# $\cot\theta$ at equal coefficients. From $\theta = \arccos(1/\sqrt 3) \approx 54.7°$ on, the two agree.

# %%
guides = PainleveKlein()


def critical(mechanism, theta):
    return jc.bounds.critical(jc.delassus(mechanism, mechanism.state(theta=theta)))


critical.long_name = "critical friction"
both = jc.sweep({"bound": bound, "critical": critical}, guides, theta=jnp.linspace(0.3, 1.5, 600), progress=False)
jc.atlas.draw_curve(both)

# %% [markdown]
# The printed text takes $|\mu_1 - \mu_2| < 2\cot\theta$ for the condition of uniqueness. With gravity that is not enough:
# at $\theta = \pi/4$ and $\mu_1 = \mu_2 = 1.5$ there are three solutions, though the difference is zero.

# %%
heavy = PainleveKlein(gravity=9.81)
found = jc.solutions(
    jc.delassus(heavy, heavy.state(theta=jnp.pi / 4)), mu=jnp.array([1.5, 1.5]), xi=jnp.array([-1.0, -1.0])
)
print(int(found.count), "solutions:")
print(np.asarray(found.normal)[np.asarray(found.valid)])

# %% [markdown]
# ## The best angle is a kink
#
# Which angle above 45° bears most friction, by the bound? Follow the slope uphill. The derivative is exact, so an optimiser
# climbs quickly, and then hops around a place where the derivative jumps.

# %%
ascent = optax.adam(optax.exponential_decay(0.02, transition_steps=20, decay_rate=0.5))


@jax.jit
def step(theta, memory):
    change, memory = ascent.update(-jax.grad(bound, argnums=1)(guides, theta), memory)
    return theta + change, memory


theta = jnp.asarray(0.85)
memory = ascent.init(theta)
for _ in range(300):
    theta, memory = step(theta, memory)
float(theta), float(jnp.arccos(3**-0.5))

# %%
family = lambda theta: jc.delassus(guides, guides.state(theta=theta))
jc.bounds.slopes(family, jnp.arccos(3**-0.5), 1.0)

# %% [markdown]
# The smallest singular value of the normal coupling is double there: two ways of losing the contact are equally close. To the
# left the bound rises with slope $1/2$, to the right it falls with slope $-3/2$, and any number between the two is a
# generalised derivative. `slopes` gives both sides; `jax.grad` alone would give one element of that set.
#
# ## A map
#
# Finally the two guides at once, with different coefficients: the exact threshold along each direction of the plane
# $(\mu_1, \mu_2)$, in a batch.


# %%
def reach(mechanism, angle, theta):
    """The largest r with mu = r (cos angle, sin angle) for which every load has one solution."""
    ratio = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    return jc.bounds.critical(jc.delassus(mechanism, mechanism.state(theta=theta)), ratio)


plane = jc.sweep(
    {"r": reach}, guides, angle=jnp.linspace(0, jnp.pi / 2, 61), theta=jnp.array([0.6, 0.8, 1.0, 1.2]), progress=False
)
figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
for theta in plane.theta:
    r = plane.r.sel(theta=theta)
    axes.plot(r * np.cos(plane.angle), r * np.sin(plane.angle), label=f"θ = {float(theta):.1f} rad")
axes.set(xlabel="friction of the lower guide, μ₁", ylabel="friction of the upper guide, μ₂", aspect="equal")
axes.legend()
plt.close(figure)  # shown once, below
figure

# %% [markdown]
# Straight lines $\mu_1 + \mu_2 = 2\cot\theta$: the triangle of the corrected Figure 4(a).
