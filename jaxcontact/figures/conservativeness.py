"""How much of the exact friction threshold the tutorial's bound reaches, over two coordinates of a mechanism."""

import jax.numpy as jnp
import numpy as np
import xarray
from jax import Array
from matplotlib.figure import Figure

from ..atlas import draw_atlas, sweep
from ..bounds import critical, norm_ratio
from ..dynamics import Delassus, delassus
from ..mechanisms import ArticulatedPainleveKlein, PainleveKlein

POINTS = 361  # along each coordinate
LENGTHS = np.linspace(0.5, 2.0, POINTS)  # m
SPACINGS = np.linspace(0.0, 2.0, POINTS)[1:]  # m; up to the longest rod
ANGLES = np.linspace(0.0, np.pi / 2, POINTS)[1:-1]  # rad; at both ends friction does nothing or everything
BENT_SPACINGS = np.linspace(0.0, 1.0, POINTS)[1:-1]  # m, for links of one metre together


def reached(operators: Delassus) -> Array:
    """`norm_ratio` / `critical`, one where the bound is exact: `reached(delassus(guides, guides.state(theta=0.9)))`."""
    return jnp.minimum(norm_ratio(operators) / critical(operators), 1)  # more than one by rounding only


def conservativeness_rod() -> tuple[xarray.Dataset, Figure]:
    """The rigid rod between two rough guides, over its length and the distance of the guides: sin theta = D / l.

    Closed form: min(1 / (3 cos^2 theta), 1), from the bound min(1 / (3 sin cos), cot) and the exact cot.
    """

    def share(rod):
        sine = rod.spacing / rod.length
        theta = jnp.where(sine < 1, jnp.arcsin(sine), jnp.nan)  # upright, the two gaps are one
        return reached(delassus(rod, rod.state(theta=theta)))

    _describe(share)
    numbers = sweep({"share": share}, PainleveKlein(spacing=0.5), length=LENGTHS, spacing=SPACINGS, progress=False)
    _name_distance(numbers)
    caption = (
        "How conservative Proposition 10 is: rod between two rough guides, equal friction. The share of the exact "
        "threshold cot θ that the bound reaches depends on sin θ = D/l alone: a third for a rod that lies almost flat, "
        "all of it from D = 0.816 l (θ = 54.7°) on, where the bound is exact (erratum B14). Hatched: rod too short."
    )
    return numbers, draw_atlas(numbers, caption=caption)


def conservativeness_links() -> tuple[xarray.Dataset, Figure]:
    """Two hinged links between two rough guides, over the angle of the first and the distance of the guides."""

    def share(links, theta1):
        return reached(delassus(links, links.state(theta1=theta1)))

    _describe(share)
    links = ArticulatedPainleveKlein(spacing=0.5)
    numbers = sweep({"share": share}, links, theta1=ANGLES, spacing=BENT_SPACINGS, progress=False)
    _name_distance(numbers)
    caption = (
        "How conservative Proposition 10 is: two hinged links, l = 1 m together, between rough guides, equal friction. "
        "Along the ridge D = l sin θ₁ the links are straight and the bound is exact (erratum B14). "
        "Hatched: the links do not reach from guide to guide."
    )
    return numbers, draw_atlas(numbers, caption=caption)


def _describe(share) -> None:
    share.unit, share.long_name = "1", "bound / exact threshold"


def _name_distance(numbers: xarray.Dataset) -> None:
    numbers["spacing"].attrs = {"units": "m", "long_name": "distance D of the guides"}
