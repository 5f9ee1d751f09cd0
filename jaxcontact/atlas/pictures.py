"""Two pictures of the tutorial as one call each: the plane of two friction coefficients, and the scalar contact law."""

from collections.abc import Sequence

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .style import GREY, INK, LINE_COLOURS, LINE_STYLES, add_caption, label, new_figure, number, symbol

MARK, MARK_STEP = 4.5, 2.0  # points
EDGE = 0.03  # of the range of forces: room for a mark at its end
REGION_COLOURS = ("#F0E442", "#56B4E9", "#0072B2")  # Okabe and Ito, the stronger the property the darker


def draw_friction_plane(plane: xarray.Dataset, names: Sequence[str] | None = None, *, caption: str = "") -> Figure:
    """The plane of two friction coefficients, and what is known in each part of it (Fig. 4(a)).

    Args:
        plane: variables of two dimensions; each is below one where a property holds. Its `long_name` says which.
        names: the variables, from the widest region to the narrowest, later ones drawn on top; all unless given.

    Example: `draw_friction_plane(sweep({"exists": strip, "unique": triangle}, guides, mu_1=row, mu_2=row))`
    """
    names = list(names or plane.data_vars)
    figure, (axes,) = new_figure(width=5.6, height=6.6)
    handles = [Patch(facecolor=GREY, hatch="////", edgecolor="grey", label="nothing guaranteed for every load")]
    axes.patch.set(facecolor=GREY, hatch="////", edgecolor="grey")
    right, up = plane[names[0]].dims
    for name, colour in zip(names, REGION_COLOURS, strict=False):
        margin = plane[name].transpose(up, right)
        inside = [min(0.0, float(margin.min())) - 1.0, 1.0]
        axes.contourf(plane[right], plane[up], margin, levels=inside, colors=[colour])
        axes.contour(plane[right], plane[up], margin, levels=[1.0], colors=[INK], linewidths=1.2)
        handles.append(Patch(facecolor=colour, edgecolor=INK, label=margin.attrs.get("long_name", name)))
    axes.set(xlabel=label(plane[right]), ylabel=label(plane[up]), aspect="equal")
    figure.legend(handles=handles[::-1], loc="outside upper left", frameon=False)
    add_caption(figure, caption)
    return figure


def draw_scalar_picture(picture: xarray.Dataset, *, caption: str = "") -> Figure:
    """A function of one contact force for several coefficients of friction, its solutions marked (Figs. 3 and 7).

    Args:
        picture: `left` (load, friction, force) drawn over `force`, and `right` (load, friction, force) or (force) with
            which it is to agree; `solution` and `height` (load, friction, branch), NaN where a branch has no solution.
            One panel for each load; `picture["load"]` labels them, `picture.friction` the lines.

    Example: see `jaxcontact.figures.figure_3a`.
    """
    figure, panels = new_figure(columns=picture.sizes["load"], width=5.0, height=4.0)
    for place, axes in enumerate(panels):
        _add_scalar_panel(axes, picture.isel(load=place))
    add_caption(figure, caption)
    return figure


def _add_scalar_panel(axes: Axes, picture: xarray.Dataset) -> None:
    force = picture.force.values
    axes.axhline(0, color=GREY, lw=0.8, zorder=0)
    axes.axvline(0, color=GREY, lw=0.8, zorder=0)
    axes.plot(force, picture.right.values, color=INK, lw=1.2, label=picture.right.attrs["long_name"])
    for place in range(picture.sizes["friction"]):
        one = picture.isel(friction=place)
        count = int(np.isfinite(one.solution).sum())
        text = f"{symbol('mu')} = {number(float(one.friction), 3)}: {_count(count)}"
        look = {"color": LINE_COLOURS[place], "linestyle": LINE_STYLES[place]}
        axes.plot(force, one.left.values, lw=2, label=text, **look)
        size = MARK + MARK_STEP * (picture.sizes["friction"] - place)  # rings where solutions coincide
        axes.plot(one.solution, one.height, "o", ms=size, mfc="white", mec=LINE_COLOURS[place], mew=1.8, zorder=3)
    axes.set_xlim(force[0] - EDGE * np.ptp(force), force[-1])
    load = picture["load"]
    axes.set_title(f"{load.attrs['long_name']} = {number(float(load))} {load.attrs['units']}", fontsize=10)
    axes.set_xlabel(label(picture.force))
    axes.set_ylabel(label(picture.left))
    axes.legend(frameon=False, fontsize=8)


def _count(count: int) -> str:
    return ("no solution", "one solution", "two solutions")[count]
