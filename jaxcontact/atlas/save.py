"""Datasets and figures on disk, whole or not at all."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

PNG_DOTS_PER_INCH = 160
# Names inside an SVG are made from this word, so that the same figure is the same file.
SVG_SALT = "jaxcontact"


def save(thing: "xarray.Dataset | Figure", path: str | os.PathLike) -> Path:
    """Write a dataset (.nc, .csv) or a figure (.png, .svg), the format by the suffix.

    The file appears under its name only when it is complete; a missing folder is made. CSV holds one row per point and
    no units; .nc holds all labels.

    Raises:
        ValueError: a suffix that is not one of `SUFFIXES`, or not one for this thing.

    Example: `save(sweep({"mu_max": bound}, rod, theta=angles), "out/rod.nc")`
    """
    path = check_path(path)
    write = _writer(thing, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(thing, unfinished)
        os.replace(unfinished, path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            unfinished.unlink()
    return path


def check_path(path: str | os.PathLike) -> Path:
    """The path, if its suffix can be written and it is no folder: to be asked before a long computation.

    Raises ValueError. Example: `check_path("out/atlas.nc")`
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"cannot write {str(path)!r}: the name must end in one of {', '.join(SUFFIXES)}")
    if path.is_dir():
        raise ValueError(f"cannot write {str(path)!r}: it is a folder")
    return path


def _writer(thing: object, path: Path) -> Callable[[object, Path], None]:
    suffix = path.suffix.lower()
    kind, write = SUFFIXES[suffix]
    if not hasattr(thing, {"figure": "savefig", "dataset": "to_netcdf"}[kind]):
        fitting = ", ".join(known for known, (other, _) in SUFFIXES.items() if other != kind)
        raise ValueError(
            f"{suffix} holds a {kind}, not a {type(thing).__name__}: draw it first, or save it as {fitting}"
        )
    return write


def _write_netcdf(dataset: "xarray.Dataset", path: Path) -> None:
    dataset.to_netcdf(path, engine="h5netcdf")


def _write_csv(dataset: "xarray.Dataset", path: Path) -> None:
    dataset.to_dataframe().to_csv(path, na_rep="nan")


def _write_png(figure: "Figure", path: Path) -> None:
    figure.savefig(path, format="png", dpi=PNG_DOTS_PER_INCH)


def _write_svg(figure: "Figure", path: Path) -> None:
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": SVG_SALT}):
        figure.savefig(path, format="svg", metadata={"Date": None})


SUFFIXES = {
    ".nc": ("dataset", _write_netcdf),
    ".csv": ("dataset", _write_csv),
    ".png": ("figure", _write_png),
    ".svg": ("figure", _write_svg),
}
"""Suffix -> what it holds and how it is written."""
