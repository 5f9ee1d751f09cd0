"""Quantities over two coordinates, as coloured maps with contour lines."""

from collections.abc import Sequence

import numpy as np
import xarray
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from .style import GREY, add_caption, in_unit, label, new_figure, set_angle_ticks, upper_limit

COLOURS = "viridis"
CLASS_COLOURS = ("#0072B2", "#56B4E9", "#F0E442", "#D55E00", "#CC79A7", "#009E73", "#E69F00")
WIDE_RANGE = 20.0  # greatest over least value from which colours go by ratio, not by difference
BELOW = (0, -0.16)  # the legend of classes: in heights of the panel, clear of the axis label
CONTOURS = 7
ROUND = (1.0, 2.0, 5.0)  # the round numbers of a decade
OUTER_SHARE = 2  # per cent of the values at each end that do not decide the range of a logarithmic scale


def draw_atlas(
    dataset: xarray.Dataset,
    names: Sequence[str] | None = None,
    *,
    right: str | None = None,
    up: str | None = None,
    angles: str = "deg",
    caption: str = "",
) -> Figure:
    """A figure with one map per quantity; see `add_map`.

    Example: `draw_atlas(sweep({"mu_max": bound}, rod, theta=angles, length=lengths))`
    """
    names = list(names or dataset.data_vars)
    figure, panels = new_figure(columns=len(names), width=5.8, height=4.4)
    for axes, name in zip(panels, names, strict=True):
        add_map(axes, dataset[name], right=right, up=up, angles=angles)
    add_caption(figure, caption)
    return figure


def add_map(
    axes: Axes, array: xarray.DataArray, *, right: str | None = None, up: str | None = None, angles: str = "deg"
) -> None:
    """Draw a quantity over two coordinates: colours, labelled contour lines, a legend for cells that have no number.

    An integer quantity with CF flags is drawn as classes. Colours go by ratio where a positive quantity spans a wide
    range; a pole is cut and the colour bar says so.

    Args:
        right, up: the dimensions to the right and upwards; the first and the second unless given.
        angles: radians are drawn in degrees ("deg") or as fractions of pi ("rad").

    Raises:
        ValueError: other than two dimensions.
    """
    if array.ndim != 2:
        raise ValueError(f"a map needs two dimensions, {array.name!r} has {list(array.dims)}: select or draw a curve")
    right = right or next(dim for dim in array.dims if dim != up)
    up = up or next(dim for dim in array.dims if dim != right)
    array = array.sortby([right, up]).transpose(up, right)
    x, y = in_unit(array[right], angles), in_unit(array[up], angles)
    if "flag_values" in array.attrs:
        _add_classes(axes, x, y, array)
    else:
        _add_colours(axes, x, y, array)
    for axis, coordinate in ((axes.xaxis, array[right]), (axes.yaxis, array[up])):
        set_angle_ticks(axis, coordinate, angles)
        axis.set_label_text(label(coordinate, angles))


def _add_colours(axes: Axes, x: np.ndarray, y: np.ndarray, array: xarray.DataArray) -> None:
    values = array.values.astype(float)
    finite = np.isfinite(values)
    _add_unnumbered(axes, x, y, values)
    if not finite.any():
        return
    norm, levels, extend = _scale(values[finite])
    shown = np.where(finite, values, np.nan)
    mesh = axes.pcolormesh(x, y, np.ma.masked_invalid(shown), norm=norm, cmap=COLOURS, rasterized=True)
    bar = axes.figure.colorbar(mesh, ax=axes, extend=extend, label=label(array))
    if isinstance(norm, LogNorm):
        bar.ax.yaxis.set_major_locator(LogLocator(subs=ROUND))
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.ax.minorticks_off()
    inside = [level for level in levels if values[finite].min() < level < values[finite].max()]
    if inside and min(values.shape) > 1:
        lines = axes.contour(x, y, np.ma.masked_invalid(shown), levels=inside, colors="black", linewidths=0.8)
        texts = axes.clabel(lines, fmt="%.4g", fontsize=8)
        for text in texts:
            text.set_path_effects([patheffects.withStroke(linewidth=2.5, foreground="white")])


def _scale(values: np.ndarray) -> tuple[Normalize, np.ndarray, str]:
    """Colour scale, contour levels, and which ends of the colour bar are open, for the finite values of a map."""
    least, greatest = float(values.min()), float(values.max())
    if least > 0 and greatest > WIDE_RANGE * least:
        low, high = np.percentile(values, [OUTER_SHARE, 100 - OUTER_SHARE])
        levels = LogLocator(subs=ROUND).tick_values(low, high)
        return LogNorm(low, high), levels, "both"
    top = upper_limit([values]) if least >= 0 else greatest
    high = min(greatest, top) if top is not None else greatest
    high = high if high > least else least + 1.0  # a constant map has no range of its own
    return (
        Normalize(least, high),
        MaxNLocator(CONTOURS).tick_values(least, high),
        "max" if greatest > high else "neither",
    )


def _add_unnumbered(axes: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray) -> None:
    """Infinite cells in plain grey, cells without a value hatched, each named in a legend."""
    handles = []
    if np.isinf(values).any():
        infinite = np.ma.masked_where(~np.isinf(values), np.zeros(values.shape))
        axes.pcolormesh(x, y, infinite, cmap=ListedColormap([GREY]), rasterized=True)
        handles.append(Patch(facecolor=GREY, label="infinite: no limit"))
    if np.isnan(values).any():
        axes.patch.set(hatch="////", edgecolor="grey", facecolor="white")
        handles.append(Patch(facecolor="white", edgecolor="grey", hatch="////", label="no value"))
    if handles:
        axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False, borderaxespad=0)


def _add_classes(axes: Axes, x: np.ndarray, y: np.ndarray, array: xarray.DataArray) -> None:
    """Each flag in a colour of its own, named in a legend beside the map; only the flags that occur."""
    flags, meanings = np.atleast_1d(array.attrs["flag_values"]), array.attrs["flag_meanings"].split()
    number = np.searchsorted(np.sort(flags), array.values)
    colours = ListedColormap([CLASS_COLOURS[k % len(CLASS_COLOURS)] for k in range(flags.size)])
    norm = BoundaryNorm(np.arange(flags.size + 1) - 0.5, flags.size)
    axes.pcolormesh(x, y, number, cmap=colours, norm=norm, rasterized=True)
    handles = [
        Patch(facecolor=colours(int(place)), label=meanings[int(k)].replace("_", " "))
        for place, k in enumerate(np.argsort(flags))
        if (number == place).any()
    ]
    axes.set_title(label(array), loc="left", fontsize="medium")
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=BELOW, frameon=False, borderaxespad=0)
