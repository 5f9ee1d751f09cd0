"""The benchmark of the ladder: its records, its picture, and what it says where the exact value is out of reach."""

import json

import numpy as np
import pytest

from benchmarks import ladder


@pytest.fixture(scope="module")
def records():
    exact = ladder.ladder("unilateral", 2, 64, np.float64, most=9)
    bracketed = ladder.ladder("unilateral", 2, 64, np.float64, most=8)
    return exact, bracketed


def test_every_rung_is_at_most_the_exact_threshold_and_at_most_its_share_of_the_bracket(records):
    exact, bracketed = ({r["bound"]: r for r in part} for part in records)
    assert exact["critical"]["least"] == exact["critical"]["99th percentile"] == 1
    for name in ladder.ANY:
        assert exact[name]["share of"] == "critical"
        assert bracketed[name]["share of"] == "upper end of the bracket"
        assert 0 < exact[name]["least"] <= exact[name]["99th percentile"] <= 1 + 1e-12
        # The upper end of the bracket is no less than the exact value, so a share of it is no more.
        assert bracketed[name]["median"] <= exact[name]["median"] * (1 + 1e-12)
    assert bracketed["bracket"]["median"] >= bracketed["direct"]["median"]
    assert "critical" not in bracketed


def test_written_measurements_can_be_drawn_again(records, tmp_path):
    rows = records[0] + [{**r, "kind": "bilateral", "contacts": 3} for r in records[1]]
    (tmp_path / "old.json").write_text(json.dumps({"machine": ladder.machine(), "rows": rows, "atlas": []}))
    ladder.main(["--read", str(tmp_path / "old.json"), "--picture", str(tmp_path / "ladder.png")])
    assert (tmp_path / "ladder.png").stat().st_size > 10_000
