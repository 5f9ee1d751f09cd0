"""The 50-digit reference tables as arrays."""

import json
from pathlib import Path

import numpy as np

DATA = Path(__file__).parent / "data"


def tables() -> dict:
    return json.loads((DATA / "reference_values.json").read_text())


def table(key: str) -> dict[str, np.ndarray]:
    """The columns of one table by name, in float64; NaN where a value is not determined."""
    entry = tables()[key]
    rows = np.array([[x if isinstance(x, float) else np.nan for x in row] for row in entry["rows"]])
    return {name: rows[:, i] for i, name in enumerate(entry["columns"])}
