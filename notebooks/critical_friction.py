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
# # Critical friction, beside the bounds
#
# A bound says: up to here nothing can go wrong. The critical friction says: up to here nothing can go wrong, and beyond it
# something can. This notebook computes both for one mechanism, two hinged links between two rough guides, says in words what
# each statement of the tutorial gives there, draws the three pictures that compare them, and ends with a question that neither
# answers: what about the one load that is really there?
#
# Source of the mechanics: Blumentals, Brogliato, Bertails-Descoubes, HAL hal-01096394v1 (2014), section 3.2.2, corrected where
# it errs.

# %%
# %matplotlib inline
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxcontact as jc
from jaxcontact import figures
from jaxcontact.mechanisms import ArticulatedPainleveKlein, PainleveKlein

# %% [markdown]
# ## One configuration
#
# The links are one metre long together, the guides half a metre apart. The first link makes 0.9 rad with the guides.

# %%
links = ArticulatedPainleveKlein(length=1.0, spacing=0.5)
here = jc.delassus(links, links.state(theta1=0.9))

for name in ("prop11", "norm_ratio", "operator_norm", "perron", "best_scaling", "critical"):
    print(f"{name:15} {float(jc.bounds.by_name()[name](here)):.4f}")

# %% [markdown]
# `norm_ratio` is Proposition 10 here, and `prop11` a third of it, which erratum B7 shows to be superfluous. The next three rungs
# cost a little more and give more; with two contacts the best scaling of the rows is already exact. `critical` is
#
# $$ r^* = 1 / \max_S \, \rho(A^{-1} A_t S), $$
#
# over the signatures $S = \mathrm{diag}(\pm 1, \pm 1)$, where $\rho$ is the largest positive real eigenvalue. Uniqueness for every
# load fails exactly when the determinant of $A - r A_t S$ vanishes for some $S$. Which one does?

# %%
mode = jc.bounds.binding_mode(here)
print("binding signs", np.asarray(mode.signs), " next signature at", f"{float(mode.runner_up):.4f}")

# %% [markdown]
# ## In words
#
# At friction 1.14 the tutorial's bound is silent and the exact threshold is not reached. `certify` judges every statement;
# `explain` puts the verdicts in words.

# %%
print(jc.explain(jc.certify(here, jnp.array([1.14, 1.14]))))

# %% [markdown]
# ## How much the bound gives away
#
# First the rigid rod between two guides. The share of the exact value that the bound reaches depends on the angle alone:
# $\min(1 / (3 \cos^2\theta), 1)$.

# %%
_, picture = figures.conservativeness_rod()
picture

# %% [markdown]
# A rod that stands steeper than 54.7° loses nothing by using the bound; one that lies flat loses two thirds. The hinged links are
# less simple. They lose nothing when they are straight, and little in between.

# %%
_, picture = figures.conservativeness_links()
picture

# %% [markdown]
# ## What tightness costs
#
# Between the bound and the exact threshold there is a ladder of bounds. On random systems the median share of the exact value and
# the time of one configuration in a batch are these; `python -m benchmarks ladder` measures them on your machine.
#
# ![each rung of the ladder: time per configuration against the share of the exact threshold](../docs/ladder.png)

# %% [markdown]
# ## Two coefficients of friction
#
# The guides need not be equally rough. The tutorial's bound is one number, a square in the plane of the two coefficients. Taken
# along each ray (`norm_ratio(here, ratio=...)`), the same proposition covers more; the exact region covers more still, and it is
# not symmetric: the upper guide may be three times as rough as the lower one and more.

# %%
_, picture = figures.friction_plane()
picture

# %% [markdown]
# In the yellow region every load has a solution, provided that both ends slide the same way, but some load has several
# (erratum B1 is about taking one region for the other).
#
# ## One load
#
# All this is about every load. A mechanism at work has one load. `critical_for_load` follows the number of solutions of this very
# problem as friction grows, and returns the first place where it ceases to be one. Take the rigid rod at 45°, heavy, its tips
# sliding to the left, and pull its lower tip.

# %%
leftwards = jnp.array([-1.0, -1.0])


def at_45_degrees(rod):
    return jc.delassus(rod, rod.state(theta=jnp.pi / 4))


def for_this_load(rod):
    return jc.bounds.critical_for_load(at_45_degrees(rod), leftwards)


def for_every_load(rod):
    return jc.bounds.critical(at_45_degrees(rod))


for_this_load.long_name, for_this_load.unit = "for gravity and this pull", "1"
for_every_load.long_name, for_every_load.unit = "for every load", "1"
heavy = PainleveKlein(gravity=9.81)
pulls = np.linspace(-30.0, 30.0, 121)
both = jc.sweep({"this": for_this_load, "every": for_every_load}, heavy, lower_pull=pulls, progress=False)
jc.atlas.draw_curve(both)

# %% [markdown]
# The two meet where the rod is not pulled at all: for this rod gravity alone is the worst load there is, and the critical friction
# is attained, which is what "exact" means. Away from that point the threshold is $1 + |F_1| / (m g)$. On both sides of it one can
# count.

# %%
pulled = PainleveKlein(gravity=9.81, lower_pull=10.0)
threshold = float(for_this_load(pulled))
print(f"threshold {threshold:.6f}, closed form {1 + 10 / 9.81:.6f}")
for factor in (0.99, 1.01):
    mu = jnp.full(2, factor * threshold)
    found = jc.solutions(at_45_degrees(pulled), mu, leftwards)
    print(f"mu = {float(mu[0]):.4f}: {int(found.count)} solution(s), normal forces in newton")
    print(np.asarray(found.normal)[np.asarray(found.valid)])

# %% [markdown]
# Without gravity the two normal forces are equal and opposite, equal friction at both guides cancels, and no friction, however
# large, makes a second solution. That is the case in which the printed condition $|\mu_1 - \mu_2| < 2\cot\theta$ is right.

# %%
weightless = PainleveKlein(gravity=0.0, lower_pull=10.0)
for mu in (0.5, 5.0, 50.0):
    print(f"mu = {mu}:", int(jc.solutions(at_45_degrees(weightless), jnp.full(2, mu), leftwards).count), "solution")

# %% [markdown]
# A threshold for one load is a statement about that load. A push that nobody planned moves it, down to the critical friction, never
# below. A design that must not jam whatever happens asks for `critical`, or for a bound below it.
