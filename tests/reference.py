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


def critical_systems(kinds: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, T, threshold) of random systems to 40 digits, rounded to float64; kinds as in `make_critical.py`."""
    rows = json.loads((DATA / "critical.json").read_text())["systems"][kinds]
    N, T = (np.array([row[name] for row in rows]) / 8 for name in "NT")
    return N, T, np.array([float(row["critical"]) for row in rows])
