"""The benchmark of limits counts what has to be moved and computed, and takes the larger time as the floor."""

import json

import pytest

from benchmarks import limits

LIMIT = {"bytes": 1e9, "operations": 1e12}


def test_a_bound_reads_an_angle_and_writes_its_results():
    records = {r["program"]: r for r in limits.bounding(1, 64, "float64")}
    assert records["norm_ratio"]["bytes"] == 64 * 8 * 2
    assert records["norm_ratio, value_and_grad"]["bytes"] == 64 * 8 * 3
    assert all(r["failed"] == 0 for r in records.values())
    # A sine or cosine alone takes more than ten operations for each angle.
    assert all(r["operations"] > 64 * 10 for r in records.values())


@pytest.mark.parametrize(("dtype", "size"), [("float64", 8), ("float32", 4)])
def test_a_solve_reads_its_data_and_writes_its_answer(dtype, size):
    records = {r["program"]: r for r in limits.solving(2, 32, dtype)}
    assert {r["bytes"] for r in records.values()} == {32 * (size * (4 + 2 + 2 + 1) + 4 * 2)}
    assert records["direct"]["operations"] == 0
    pivots = records["principal pivoting"]
    assert pivots["operations"] == 2 * 2**2 * pivots["steps"] * 32
    assert (limits.TWO_PRECISIONS in records) == (dtype == "float64")


def test_the_floor_is_the_larger_of_two_times(monkeypatch):
    monkeypatch.setattr(limits, "seconds_of", lambda calls: dict.fromkeys(calls, 10.0))

    def record(name, moved, operations):
        return limits.recorded(name, 1, 100, 0.0, moved, operations, None)

    rows = limits.measured([record("a", 5e9, 1e12), record("b", 1e9, 4e12)], "float64", LIMIT)
    assert [r["to_floor"] for r in rows] == [10 / 5, 10 / 4]
    assert [r["per_second"] for r in rows] == [10.0, 10.0]


def test_the_file_has_the_ceilings_and_a_row_for_each_program(tmp_path):
    file = tmp_path / "limits.json"
    limits.main(["--contacts", "1", "--sizes", "1", "--dtypes", "float32", "--numbers", "4096", "--json", str(file)])
    written = json.loads(file.read_text())
    assert min(written["ceilings"]["float32"].values()) > 0
    assert {"norm_ratio", "critical", *limits.METHODS} <= {r["program"] for r in written["rows"]}
    for r in written["rows"]:
        needed = [r[what] / ceiling for what, ceiling in written["ceilings"]["float32"].items()]
        assert r["to_floor"] == pytest.approx(r["batch"] / r["per_second"] / max(needed))
