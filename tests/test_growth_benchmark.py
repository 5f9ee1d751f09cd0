"""The benchmark of growth: its scenes carry the weights above, its file is whole after every row, its processes
report."""

import json

import numpy as np
import pytest

from benchmarks import _growth_first_calls, _growth_memory, growth
from jaxcontact.complementarity import Lemke, PrincipalPivoting


def test_columns_side_by_side_touch_nothing_of_each_other_and_the_floor_carries_each():
    M, q, forces = growth.columns(2, growth.TALLEST + 2)
    assert not M[:, : growth.TALLEST, growth.TALLEST :].any()
    # Only the floor does not fall along: 1/m of the box on it, and its gap closes with g.
    np.testing.assert_array_equal(np.flatnonzero(q[0]), [0, growth.TALLEST])
    # The second column has two boxes: 1/m below, 1/m + 1/m' between.
    below, between = M[:, -2, -2], M[:, -1, -1]
    alone = forces[:, -1] * (between - below), (forces[:, -2] - forces[:, -1]) * below
    np.testing.assert_allclose(alone, growth.GRAVITY, rtol=4 * np.finfo(float).eps)  # a sum, a difference


@pytest.mark.parametrize("method", [PrincipalPivoting(), Lemke()])
@pytest.mark.parametrize(("count", "m"), [(1, 1), (3, 20)])
def test_every_contact_carries_the_weight_above(method, count, m):
    row = growth.solving(method, *growth.columns(count, m))
    assert row["statuses"] == ["SOLVED"]
    assert row["solved"] == 1
    assert row["backward error"] <= 1e-13  # the judge's own limit is of this size
    # Sums of at most eight weights, amplified by the condition of a column, 8^2.
    assert row["error of a force"] <= growth.TALLEST**2 * np.finfo(float).eps


def test_a_run_that_is_cut_leaves_its_rows(tmp_path):
    record = growth.Record(str(tmp_path / "growth.json"))
    for k in range(3):
        record.add({"part": "batch", "batch": 10**k})
        kept = json.loads((tmp_path / "growth.json").read_text())
        assert [row["batch"] for row in kept["rows"]] == growth.powers(10**k)
        assert kept["machine"]["cores"] >= 1


def test_first_calls_fill_a_cache_for_each_quantity_and_the_next_process_adds_nothing_to_it(tmp_path):
    def entries():
        return {path.relative_to(tmp_path) for path in tmp_path.rglob("*-cache")}

    def rows(cache):
        return list(_growth_first_calls.in_a_process("PainleveKlein", str(tmp_path), cache, quick=True))

    cold, kept = rows("none"), entries()
    assert {str(path.parent) for path in kept} == {
        f"PainleveKlein/{name}/{kind}" for name in ("norm_ratio", "critical") for kind in ("as called", "jit", "batch")
    }
    warm = rows("warm")
    assert entries() == kept
    assert [row["what"] for row in warm] == [row["what"] for row in cold]
    for row in cold + warm:
        assert row["jit s"] == pytest.approx(row["jit tracing s"] + row["jit compiling s"], abs=1e-9)


def test_the_peak_counts_what_was_held():
    kept = np.ones(10**7)
    assert _growth_memory.peak() >= kept.nbytes
