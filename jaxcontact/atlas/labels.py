"""The labels of a sweep: dimensions, units, long names, and where the numbers come from."""

import dataclasses
import json
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from typing import TYPE_CHECKING

import jax
import numpy as np

from .grid import Grid

if TYPE_CHECKING:
    import xarray

PACKAGES = ("jaxcontact", "jax", "jaxlib")


def labelled(
    values: Mapping[str, np.ndarray], quantities: Mapping[str, Callable], mechanism: object, grid: Grid
) -> "xarray.Dataset":
    """The values of a sweep as an `xarray.Dataset`: shapes (axes..., own dimensions...), units and provenance attached.

    Raises ModuleNotFoundError naming the extra to install if xarray is missing.
    """
    coordinates = {name: (name, row, axis_labels(mechanism, name)) for name, row in grid.axes.items()}
    variables = {}
    for name, array in values.items():
        own = array.ndim - len(grid.shape)
        dims = getattr(quantities[name], "dims", None) or tuple(f"{name}_{k}" for k in range(own))
        if len(dims) != own:
            raise ValueError(f"quantity {name!r} returns {own} dimensions of its own and names {len(dims)}: {dims}")
        variables[name] = ((*grid.axes, *dims), array, quantity_labels(quantities[name], array.dtype))
    return _xarray().Dataset(variables, coordinates, provenance(mechanism, grid))


def axis_labels(mechanism: object, name: str) -> dict[str, str]:
    """Unit and long name of a coordinate of the chart (`coordinates`) or of a parameter (metadata of its field)."""
    chart = getattr(mechanism, "coordinates", None)
    if isinstance(chart, Mapping) and name in chart:
        unit, doc = chart[name].unit, chart[name].doc
    else:
        stated = {field.name: field.metadata for field in dataclasses.fields(mechanism)}.get(name, {})
        unit, doc = stated.get("unit"), stated.get("doc")
    return _without_blanks({"units": unit, "long_name": doc})


def quantity_labels(quantity: Callable, dtype: np.dtype) -> dict[str, object]:
    """What a quantity says of itself: `unit`, `long_name`, and the flags of an integer status as CF asks for them."""
    said = {"units": getattr(quantity, "unit", None), "long_name": getattr(quantity, "long_name", None)}
    flags = getattr(quantity, "flags", None)
    if flags:
        said["flag_values"] = np.array([int(value) for value in flags.values()], dtype)
        said["flag_meanings"] = " ".join(str(meaning).replace(" ", "_") for meaning in flags)
    return _without_blanks(said)


def provenance(mechanism: object, grid: Grid) -> dict[str, str]:
    """What the numbers come from: versions, device, dtype, mechanism and the parameters that did not vary."""
    kind = type(mechanism)
    fixed = {
        field.name: _plain(getattr(mechanism, field.name))
        for field in dataclasses.fields(mechanism)
        if field.name not in grid.axes
    }
    return {
        **{f"{package}_version": _version(package) for package in PACKAGES},
        "device": str(jax.devices()[0].device_kind),
        "dtype": str(grid.dtype),
        "mechanism": f"{kind.__module__}.{kind.__qualname__}",
        "parameters": json.dumps(fixed),
        "date_created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _plain(value: object) -> object:
    """A field as JSON holds it: numbers and rows of numbers, anything else by its text."""
    if isinstance(value, bool | int | float | str | type(None)):
        return value
    return np.asarray(value).tolist() if isinstance(value, np.ndarray | np.generic | jax.Array) else str(value)


def _without_blanks(labels: Mapping[str, object]) -> dict[str, object]:
    return {key: value for key, value in labels.items() if not isinstance(value, str | None) or value}


def _version(package: str) -> str:
    """The installed version, or `not installed` for a copy that runs from its source folder."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _xarray():
    try:
        import xarray
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError("sweep needs xarray: pip install 'jaxcontact[sweep]'") from missing
    return xarray
