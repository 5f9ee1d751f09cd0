"""How the pictures look: colours that everyone can tell apart, labels with units, limits that show the curve."""

import re
import textwrap
from collections.abc import Sequence

import numpy as np
import xarray
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator

# Okabe and Ito, Color Universal Design (2008), without the yellow, which is lost on white; darkest first.
LINE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LINE_STYLES = ("-", "--", "-.", ":")
GREY = "#d9d9d9"
INK = "#333333"
CAPTION_SIZE = 8.5  # points
CAPTION_LETTERS_PER_INCH = 15  # at that size

GREEK = ("alpha", "beta", "gamma", "delta", "theta", "lambda", "mu", "xi", "phi", "psi", "omega")
ANGLES = ("deg", "rad")
TICKS_WANTED = 7  # at most about this many on an angle's axis
DEGREE_STEPS = (1, 2, 5, 10, 15, 30, 45, 90, 180)
PI_DIVISORS = (64, 32, 16, 8, 4, 2, 1)

# A bound that goes to infinity at an end of its range is cut where it leaves the ordinary: values above STRETCH times
# the middle ones are not drawn at the price of flattening the rest.
ORDINARY_SHARE = 75  # per cent of the values
STRETCH = 2.0
MARGIN = 1.05


def new_figure(columns: int = 1, rows: int = 1, width: float = 5.4, height: float = 4.0) -> tuple[Figure, np.ndarray]:
    """A figure that needs no display, and its axes as a flat row; width and height of one panel in inches."""
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels


def add_caption(figure: Figure, caption: str) -> None:
    """A caption under the panels, broken into lines that fit the figure."""
    columns = int(figure.get_figwidth() * CAPTION_LETTERS_PER_INCH)
    text = textwrap.fill(caption, columns)
    figure.supxlabel(text, fontsize=CAPTION_SIZE, color=INK, x=0.02, ha="left", linespacing=1.4)


def label(array: xarray.DataArray, angles: str = "deg") -> str:
    """The label of an axis: long name, symbol and unit as far as they are known; `angle from the horizontal θ (°)`."""
    unit, name = array.attrs.get("units", ""), symbol(str(array.name))
    unit = "°" if unit == "rad" and angles == "deg" else unit
    long_name = array.attrs.get("long_name", "").partition(";")[0]  # what follows is a remark
    short = name.startswith("$") or len(name) == 1
    text = f"{long_name}, {name}" if long_name and short else long_name or name
    return text if unit in ("", "1") else f"{text} ({unit})"


def number(value: float, digits: int = 4) -> str:
    """A number as text, with a minus sign rather than a hyphen."""
    return f"{value:.{digits}g}".replace("-", "−")


def symbol(name: str) -> str:
    """A Greek name in its letter, with what follows as index: `theta1` is θ₁; other names as they are."""
    found = re.fullmatch(rf"({'|'.join(GREEK)})_?(\w*)", name)
    if not found:
        return name.replace("_", " ")
    return rf"$\{found[1]}$" if not found[2] else rf"$\{found[1]}_{{\mathrm{{{found[2].replace('_', ' ')}}}}}$"


def in_unit(array: xarray.DataArray, angles: str = "deg") -> np.ndarray:
    """The values as they are drawn: radians in degrees if asked for."""
    if angles not in ANGLES:
        raise ValueError(f"angles is {angles!r}: write one of {ANGLES}")
    return np.degrees(array.values) if array.attrs.get("units") == "rad" and angles == "deg" else array.values


def set_angle_ticks(axis, array: xarray.DataArray, angles: str = "deg") -> None:
    """Ticks at round degrees, or at simple fractions of pi; any other coordinate keeps its own."""
    drawn = in_unit(array, angles)
    if array.attrs.get("units") != "rad" or drawn.size < 2:
        return
    width = float(np.ptp(drawn))
    steps = DEGREE_STEPS if angles == "deg" else [np.pi / divisor for divisor in PI_DIVISORS]
    step = next((step for step in steps if width <= step * TICKS_WANTED), steps[-1])
    axis.set_major_locator(MultipleLocator(step))
    if angles == "rad":
        axis.set_major_formatter(FuncFormatter(lambda value, _: _fraction_of_pi(value, step)))


def upper_limit(values: Sequence[np.ndarray]) -> float | None:
    """Where a picture of these values ends: at the greatest, or below it if few values tower above the others."""
    rows = [row[np.isfinite(row)] for row in map(np.ravel, values)]
    rows = [row for row in rows if row.size]
    if not rows:
        return None
    greatest = max(row.max() for row in rows)
    ordinary = max(np.percentile(row, ORDINARY_SHARE) for row in rows)
    return float(MARGIN * min(greatest, STRETCH * ordinary)) if ordinary > 0 else None


def _fraction_of_pi(value: float, step: float) -> str:
    count, divisor = round(value / step), round(np.pi / step)
    shared = int(np.gcd(count, divisor)) or 1
    count, divisor = count // shared, divisor // shared
    top = {0: "0", 1: r"\pi", -1: r"-\pi"}.get(count, rf"{count}\pi")
    return f"${top}$" if divisor == 1 or count == 0 else rf"${top}/{divisor}$"
