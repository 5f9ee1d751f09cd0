"""The tutorial's Figures 3 to 7, corrected, and how conservative its bound is: the numbers, and their pictures."""

from collections.abc import Callable, Iterator
from pathlib import Path

import jax.numpy as jnp
import xarray
from matplotlib.figure import Figure

from .. import atlas
from .conservativeness import conservativeness_links, conservativeness_rod
from .friction_plane import friction_plane
from .guides import figure_4a, figure_4b, figure_5a, figure_5b, figure_6a, figure_6b
from .single_contact import figure_3a, figure_3b, figure_7

FIGURES: dict[str, Callable[[], tuple[xarray.Dataset, Figure]]] = {
    "figure_3a": figure_3a,
    "figure_3b": figure_3b,
    "figure_4a": figure_4a,
    "figure_4b": figure_4b,
    "figure_5a": figure_5a,
    "figure_5b": figure_5b,
    "figure_6a": figure_6a,
    "figure_6b": figure_6b,
    "figure_7": figure_7,
    "conservativeness_rod": conservativeness_rod,
    "conservativeness_links": conservativeness_links,
    "friction_plane": friction_plane,
}
FORMATS = (".png", ".svg")

__all__ = ["FIGURES", "FORMATS", "write_figures", *FIGURES]


def write_figures(folder: str | Path) -> Iterator[Path]:
    """Write every figure as PNG and SVG with its numbers as CSV beside it, naming each file when it is there.

    Raises ValueError unless JAX runs with 64-bit floats: the numbers are those of the closed forms to twelve digits.

    Example: `list(write_figures("figures"))`
    """
    if jnp.result_type(float) != jnp.float64:
        raise ValueError("the figures need 64-bit floats: write jax.config.update('jax_enable_x64', True) first")
    for name, make in FIGURES.items():
        numbers, picture = make()
        yield atlas.save(numbers, Path(folder) / f"{name}.csv")
        for suffix in FORMATS:
            yield atlas.save(picture, Path(folder) / f"{name}{suffix}")
