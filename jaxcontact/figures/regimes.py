"""Painlevé's rod over angle and angular rate: where it slides, takes off, or where the sliding law breaks down."""

from enum import IntEnum

import jax.numpy as jnp
import numpy as np
import xarray
from jax import Array
from matplotlib.figure import Figure

from ..atlas import draw_atlas, sweep
from ..contact import Multiplicity, solutions
from ..dynamics import Delassus, delassus
from ..mechanisms import PainleveRod

FRICTION = 2.0  # beyond 4/3, the least critical friction of any angle
LEFTWARDS = -1.0  # the slip for which friction harms when 0 < theta < pi / 2
ANGLES = np.linspace(0.0, np.pi, 361)[1:-1]  # rad; lying on the floor the rod touches it everywhere
RATES = np.linspace(-8.0, 8.0, 321)  # rad/s


class Regime(IntEnum):
    """What one sliding contact that can only push does next."""

    SLIDES = 0
    """one solution, with a force"""
    DETACHES = 1
    """one solution, without"""
    INCONSISTENT = 2
    """no solution: the paradox"""
    INDETERMINATE = 3
    """several: it may go on sliding or take off"""
    BORDER = 4
    """infinitely many, or too close to call"""


MEANINGS = {
    "slides": Regime.SLIDES,
    "takes off": Regime.DETACHES,
    "inconsistent: no solution": Regime.INCONSISTENT,
    "indeterminate: two solutions": Regime.INDETERMINATE,
    "border": Regime.BORDER,
}


def regime(operators: Delassus, mu: Array, xi: Array) -> Array:
    """int32 `Regime` of one unilateral contact at friction mu (1,) and sign of slip xi (1,).

    `regime(delassus(rod, rod.state(theta=0.8)), jnp.array([2.0]), jnp.array([-1.0]))`
    """
    every = solutions(operators, mu, xi)
    pushes = jnp.any(every.valid & (every.normal[:, 0] > 0))
    one = jnp.where(pushes, int(Regime.SLIDES), int(Regime.DETACHES))
    named = {
        Multiplicity.NONE: int(Regime.INCONSISTENT),
        Multiplicity.ONE: one,
        Multiplicity.MANY: int(Regime.INDETERMINATE),
    }
    answer = jnp.int32(Regime.BORDER)
    for number, value in named.items():
        answer = jnp.where(every.multiplicity == int(number), value, answer)
    return answer.astype(jnp.int32)


def regimes(
    rod: PainleveRod | None = None, friction: float = FRICTION, angles=ANGLES, rates=RATES
) -> tuple[xarray.Dataset, Figure]:
    """The map of `Regime` over (theta, theta') for a rod whose tip slides to the left, and its picture.

    With A = 1 + 3 c^2 - 3 mu s c and w = l/2 theta'^2 s - g (59): slides where A > 0 > w, takes off where both are
    positive, inconsistent where both are negative, indeterminate where A < 0 < w (erratum B10).

    `numbers, picture = regimes(PainleveRod(length=2.0), friction=1.5)`
    """
    rod = PainleveRod() if rod is None else rod

    def quantity(rod, theta, thetadot):
        dtype = jnp.result_type(theta)
        here = delassus(rod, rod.state(theta=theta, thetadot=thetadot))
        return regime(here, jnp.full((1,), friction, dtype), jnp.full((1,), LEFTWARDS, dtype))

    quantity.flags, quantity.long_name = MEANINGS, "what the rod does next"
    numbers = sweep({"regime": quantity}, rod, theta=angles, thetadot=rates, progress=False)
    numbers.attrs["friction"] = float(friction)
    caption = (
        f"Painlevé's rod, tip sliding to the left on a floor, μ = {friction:g}: equation (59) with erratum B10. "
        "The paradox begins where 1 + 3 cos²θ = 3 μ sin θ cos θ; the tip is pulled off where ½ l θ'² sin θ > g."
    )
    return numbers, draw_atlas(numbers, caption=caption)
