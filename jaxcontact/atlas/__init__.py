"""Any quantity over any grid: chunked, labelled, stored, drawn."""

import importlib

from .save import SUFFIXES, check_path, save
from .sweep import sweep

# matplotlib is an extra: a drawing function is looked up where it is first asked for, so that `import jaxcontact` and a
# sweep work without it.
DRAWING = {
    "add_curves": "curves",
    "add_map": "maps",
    "draw_atlas": "maps",
    "draw_curve": "curves",
    "draw_friction_plane": "pictures",
    "draw_scalar_picture": "pictures",
    "new_figure": "style",
}

__all__ = ["SUFFIXES", "check_path", "save", "sweep", *DRAWING]


def __getattr__(name):
    if name not in DRAWING:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(importlib.import_module(f"{__name__}.{DRAWING[name]}"), name)
    except ModuleNotFoundError as missing:
        if missing.name != "matplotlib":
            raise
        raise ModuleNotFoundError("drawing needs matplotlib: pip install 'jaxcontact[plot]'") from missing
