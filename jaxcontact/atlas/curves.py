"""Quantities along one coordinate, as lines."""

from collections.abc import Sequence

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import (
    GREY,
    LINE_COLOURS,
    LINE_STYLES,
    add_caption,
    in_unit,
    label,
    new_figure,
    number,
    set_angle_ticks,
    symbol,
    upper_limit,
)

LEGEND_OPACITY = 0.85  # enough to read it over a hatch
MOST_LINES = 12  # beyond, nobody tells them apart


def draw_curve(
    dataset: xarray.Dataset,
    names: Sequence[str] | None = None,
    *,
    along: str | None = None,
    angles: str = "deg",
    upper: float | None = None,
    caption: str = "",
) -> Figure:
    """A figure of one or more quantities along one coordinate; see `add_curves`.

    Example: `draw_curve(sweep({"mu_max": bound}, rod, theta=angles))`
    """
    figure, (axes,) = new_figure(width=6.4, height=4.2)
    add_curves(axes, dataset, names, along=along, angles=angles, upper=upper)
    add_caption(figure, caption)
    return figure


def add_curves(
    axes: Axes,
    dataset: xarray.Dataset,
    names: Sequence[str] | None = None,
    *,
    along: str | None = None,
    angles: str = "deg",
    upper: float | None = None,
) -> None:
    """Draw quantities along one coordinate; one line for each value of any other dimension.

    Intervals where every line is infinite (no limit) or has no value are shaded and named; a line that is infinite in
    part says so in the legend.

    Args:
        names: variables of the dataset; all unless given.
        along: the coordinate to the right; the first dimension unless given.
        angles: radians are drawn in degrees ("deg") or as fractions of pi ("rad").
        upper: the upper end of the picture; chosen such that a pole does not flatten the rest unless given.

    Raises:
        ValueError: a name that is not in the dataset, or too many lines.
    """
    names = list(names or dataset.data_vars)
    along = along or str(dataset[_known(dataset, names[0], dataset.data_vars)].dims[0])
    across = dataset[_known(dataset, along, dataset.dims)]
    lines = [line for name in names for line in _lines(dataset[_known(dataset, name, dataset.data_vars)], along)]
    if len(lines) > MOST_LINES:
        raise ValueError(f"{len(lines)} lines are too many (at most {MOST_LINES}): draw an atlas instead")
    order = np.argsort(across.values)
    right = in_unit(across, angles)[order]
    values = [line.values[order].astype(float) for line in lines]
    for line, row, look in zip(lines, values, _looks(lines, names), strict=True):
        text = _line_label(line, dataset, names, angles)
        text += " (infinite in part)" if len(lines) > 1 and np.isinf(row).any() else ""
        axes.plot(right, np.where(np.isfinite(row), row, np.nan), label=text, lw=2, **look)
    _shade(axes, right, np.all([np.isinf(row) for row in values], axis=0), "infinite: no limit", None)
    _shade(axes, right, np.all([np.isnan(row) for row in values], axis=0), "no value", "////")
    _finish(axes, across, lines, values, angles, upper)


def _finish(axes: Axes, across, lines, values, angles: str, upper: float | None) -> None:
    if across.size > 1:
        axes.set_xlim(*np.sort(in_unit(across, angles))[[0, -1]])
    set_angle_ticks(axes.xaxis, across, angles)
    axes.set_xlabel(label(across, angles))
    texts = {label(line) for line in lines}
    axes.set_ylabel(texts.pop() if len(texts) == 1 else "coefficient of friction" if _all_plain(lines) else "")
    axes.grid(color=GREY, lw=0.6)
    top = upper if upper is not None else upper_limit(values)
    finite = np.concatenate([row[np.isfinite(row)] for row in values])
    if top is not None and finite.min() >= 0:
        axes.set_ylim(0, top)
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(edgecolor="none", framealpha=LEGEND_OPACITY)


def _lines(array: xarray.DataArray, along: str) -> list[xarray.DataArray]:
    """One array (k,) for each combination of the other dimensions."""
    others = [dim for dim in array.dims if dim != along]
    places = np.ndindex(*(array.sizes[dim] for dim in others))
    return [array.isel(dict(zip(others, place, strict=True))) for place in places]


def _looks(lines: Sequence[xarray.DataArray], names: Sequence[str]) -> list[dict]:
    """Colour by the other coordinates and dashes by quantity; both by quantity where there is only that."""
    per_name = len(lines) // len(names)
    looks = []
    for place in range(len(lines)):
        name, member = divmod(place, per_name)
        colour = member if per_name > 1 else name
        style = name if len(names) > 1 else member
        looks.append(
            {"color": LINE_COLOURS[colour % len(LINE_COLOURS)], "linestyle": LINE_STYLES[style % len(LINE_STYLES)]}
        )
    return looks


def _line_label(line: xarray.DataArray, dataset: xarray.Dataset, names: Sequence[str], angles: str) -> str:
    """What distinguishes a line: its quantity if there are several, and its place in the other dimensions."""
    places = [
        f"{symbol(str(name))} = {number(float(in_unit(place, angles)))}{_unit(place, angles)}"
        for name, place in line.coords.items()
        if place.ndim == 0 and name in dataset.dims
    ]
    quantity = [line.attrs.get("long_name") or symbol(str(line.name))] if len(names) > 1 or not places else []
    return ", ".join(quantity + places)


def _unit(place: xarray.DataArray, angles: str) -> str:
    unit = place.attrs.get("units", "")
    if unit == "rad" and angles == "deg":
        return "°"
    return "" if unit in ("", "1") else f" {unit}"


def _shade(axes: Axes, right: np.ndarray, where: np.ndarray, text: str, hatch: str | None) -> None:
    """Mark the intervals of the coordinate where something holds, from half way to the neighbours on either side."""
    if right.size < 2 or not where.any():
        return
    edges = np.concatenate([right[:1], (right[1:] + right[:-1]) / 2, right[-1:]])
    steps = np.diff(np.concatenate([[0], where.astype(int), [0]]))
    for first, last in zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True):
        look = {"facecolor": "white" if hatch else GREY, "edgecolor": "grey", "hatch": hatch, "lw": 0, "zorder": 0}
        axes.axvspan(edges[first], edges[last], label=text, **look)
        text = None  # one entry in the legend


def _all_plain(lines: Sequence[xarray.DataArray]) -> bool:
    return all(line.attrs.get("units", "") == "1" for line in lines)


def _known(dataset: xarray.Dataset, name: str, valid) -> str:
    if name not in valid:
        raise ValueError(f"the dataset has no {name!r}: it has {[str(known) for known in valid]}")
    return name
