"""`jaxcontact curve` and `jaxcontact atlas`: read, sweep, draw or store, report."""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .. import atlas
from ..dynamics import delassus
from .reading import check_complete, check_name, read_bounds, read_class, read_range, read_settings

PICTURES = (".png", ".svg")
DEFAULT_BOUND = "norm_ratio"
LONG_NAMES = {"critical": "critical friction"}  # the others are bounds, sufficient only


def run_curve(given: argparse.Namespace) -> None:
    """One axis. Raises ValueError for a command that makes no sense, before anything is computed."""
    if len(given.over) != 1:
        raise ValueError(f"a curve goes over one coordinate, --over is given {len(given.over)} times: use atlas")
    _run(given, lambda numbers: atlas.draw_curve(numbers, angles=given.angles, caption=_caption(numbers)))


def run_atlas(given: argparse.Namespace) -> None:
    """Two axes, or more where numbers are asked for. Raises ValueError before anything is computed."""
    if len(given.over) < 2:
        raise ValueError("an atlas goes over two coordinates: give --over twice, or use curve")
    if len(given.over) > 2 and Path(given.out).suffix.lower() in PICTURES:
        raise ValueError(
            f"a picture shows two coordinates, not {len(given.over)}: write .nc or .csv, or --set the others"
        )
    _run(given, lambda numbers: atlas.draw_atlas(numbers, angles=given.angles, caption=_caption(numbers)))


def _run(given: argparse.Namespace, draw: Callable) -> None:
    out = atlas.check_path(given.out)
    cls = read_class(given.mechanism)
    axes = _axes(cls, given.over, given.dtype)
    fields, coordinates = read_settings(cls, given.set)
    twice = sorted(set(axes) & {*fields, *coordinates})
    if twice:
        raise ValueError(f"{', '.join(twice)} is in --over and in --set: keep one of them")
    check_complete(cls, [*axes, *fields, *coordinates])
    bounds = read_bounds(given.bound or [DEFAULT_BOUND])
    # A field without default that varies needs some value to begin with: its first.
    mechanism = cls(**{name: float(row[0]) for name, row in axes.items() if _is_field(cls, name)} | fields)
    quantities = {name: _quantity(name, bound, coordinates) for name, bound in bounds.items()}
    started = time.perf_counter()
    numbers = atlas.sweep(quantities, mechanism, **axes)
    seconds = time.perf_counter() - started
    numbers.attrs["coordinates_set"] = json.dumps(coordinates)
    atlas.save(draw(numbers) if out.suffix.lower() in PICTURES else numbers, out)
    print(_report(out, numbers, seconds))
    for name, array in numbers.data_vars.items():
        if np.isnan(array.values).all():
            print(f"{name} has no value at any point: what it asks of a mechanism is in help(jaxcontact.bounds.{name})")


def _axes(cls: type, words: list[str], dtype: str) -> dict[str, np.ndarray]:
    axes = {}
    for word in words:
        name, row = read_range(word)
        check_name(cls, name, "--over")
        if name in axes:
            raise ValueError(f"--over {name} is given twice")
        axes[name] = row.astype(dtype)
    return axes


def _quantity(name: str, bound: Callable, fixed: dict[str, float]) -> Callable:
    """A bound as a function of the mechanism and its chart coordinates, those in `fixed` held."""

    def quantity(mechanism, **coordinates):
        return bound(delassus(mechanism, mechanism.state(**fixed, **coordinates)))

    quantity.unit, quantity.long_name = "1", LONG_NAMES.get(name, f"friction bound, {name.replace('_', ' ')}")
    return quantity


def _is_field(cls: type, name: str) -> bool:
    return name in cls.__dataclass_fields__


def _caption(numbers) -> str:
    """What the picture was made with, so that it can be made again."""
    fixed = json.loads(numbers.attrs["parameters"]) | json.loads(numbers.attrs["coordinates_set"])
    stated = ", ".join(
        f"{name} = {value:g}" if isinstance(value, float) else f"{name} = {value}"
        for name, value in fixed.items()
        if value is not None
    )
    return f"{numbers.attrs['mechanism'].rpartition('.')[2]}: {stated}"


def _report(out: Path, numbers, seconds: float) -> str:
    points = int(np.prod(list(numbers.sizes.values())))
    without = sum(int(np.isnan(array.values).sum()) for array in numbers.data_vars.values())
    infinite = sum(int(np.isinf(array.values).sum()) for array in numbers.data_vars.values())
    more = f", {infinite} infinite" if infinite else ""
    return f"{out}: {points} points in {seconds:.2f} s, {without} without a value (NaN){more}"
