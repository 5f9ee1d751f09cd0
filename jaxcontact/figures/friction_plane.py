"""The plane of two coefficients of friction where its regions are curved: two bent links between two guides."""

import jax.numpy as jnp
import numpy as np
import xarray
from jax import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..atlas import new_figure, sweep
from ..atlas.pictures import REGION_COLOURS
from ..atlas.style import GREY, INK, add_caption
from ..bounds import critical, critical_existence, norm_ratio
from ..dynamics import Delassus, delassus
from ..mechanisms import ArticulatedPainleveKlein

SPACING = 0.5  # m, for links of one metre together
FIRST_ANGLE = 0.9  # rad, of the first link; the second follows
RAYS = np.linspace(0.0, np.pi / 2, 361)  # rad, directions (cos, sin) in the plane
END = 3.0  # greatest coefficient of friction in the plane
SQUARE_COLOUR = "#FFFFFF"

REGIONS = {
    "exists": "a solution for every load, tips sliding the same way",
    "unique": "exactly one for every load, tips sliding any way",
    "bound": "guaranteed by Proposition 10 along each ray",
}


def reach(operators: Delassus, angle: Array) -> Array:
    """(3,) how far along the ray (cos, sin) of the plane existence, uniqueness, and the guarantee of the bound go.

    `reach(delassus(guides, guides.state(theta=0.9)), 0.5)`
    """
    ratio = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    same_way = jnp.ones_like(ratio)
    exact = critical_existence(operators, same_way, ratio), critical(operators, ratio)
    return jnp.stack([*exact, norm_ratio(operators, ratio)])


def friction_plane() -> tuple[xarray.Dataset, Figure]:
    """Existence, uniqueness and guarantee around one state of two hinged links, by the distance along each ray."""

    def along(links, angle):
        return reach(delassus(links, links.state(theta1=FIRST_ANGLE)), angle)

    along.dims, along.unit, along.long_name = ("region",), "1", "friction reached along the ray"
    links = ArticulatedPainleveKlein(spacing=SPACING)
    numbers = sweep({"reach": along}, links, angle=RAYS, progress=False).assign_coords(region=list(REGIONS))
    numbers["angle"].attrs = {"units": "rad", "long_name": "direction (cos, sin) in the plane (μ₁, μ₂)"}
    here = delassus(links, links.state(theta1=FIRST_ANGLE))
    numbers.attrs["square"] = float(norm_ratio(here))
    return numbers, _drawn(numbers)


def _drawn(numbers: xarray.Dataset) -> Figure:
    figure, (axes,) = new_figure(width=5.6, height=6.6)
    axes.patch.set(facecolor=GREY, hatch="////", edgecolor="grey")
    handles = [Patch(facecolor=GREY, hatch="////", edgecolor="grey", label="not guaranteed for every load")]
    for (name, text), colour in zip(REGIONS.items(), REGION_COLOURS, strict=True):
        _fill(axes, numbers["angle"].values, numbers.reach.sel(region=name).values, colour)
        handles.append(Patch(facecolor=colour, edgecolor=INK, label=text))
    side = numbers.attrs["square"]
    axes.plot([0, side, side], [side, side, 0], color=SQUARE_COLOUR, lw=2, ls="--")
    axes.text(0.5 * side, 0.5 * side, "the tutorial's\nsquare", color=SQUARE_COLOUR, ha="center", va="center")
    ends = (0, END)
    axes.set(xlabel="friction of the lower guide, $\\mu_1$", ylabel="friction of the upper guide, $\\mu_2$")
    axes.set(xlim=ends, ylim=ends, aspect="equal")
    figure.legend(handles=handles[::-1], loc="outside upper left", frameon=False)
    caption = (
        "The plane of Figure 4(a) for two hinged links, l = 1 m, D = l/2, θ₁ = 51.6°. The tutorial draws Proposition "
        "10 as a square; taken along each ray it gives more. The exact threshold shows that the upper guide may be "
        "much rougher than the lower one. Outside the blue, some load has no solution or several (erratum B1)."
    )
    add_caption(figure, caption)
    return figure


def _fill(axes: Axes, angle: np.ndarray, radius: np.ndarray, colour: str) -> None:
    """A region that reaches as far as `radius` along each direction, cut well outside the picture."""
    radius = np.minimum(radius, 2 * END)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    axes.fill([0, *x], [0, *y], facecolor=colour, edgecolor="none")
    axes.plot(x, y, color=INK, lw=1.2)
