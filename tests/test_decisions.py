"""The tables of decisions and the headline sentences say what the measurements say."""

import json
import math

import pytest

from benchmarks import decisions, headlines

MACHINE = {"processor": "a processor", "cores": 2, "jax": "0.0", "date": "2026-01-02T03:04:05+00:00"}


def problem(method, dtype, time, within, failed=0.0, family="stacks", contacts=4, again=0.0):
    shares = dict(zip(decisions.DIGITS.values(), within, strict=True))
    return {
        "family": family, "contacts": contacts, "dtype": dtype, "method": method, "us_per_problem": time,
        "failed": failed, "solved_again": again, **shares,
    }  # fmt: skip


TRADEOFF = [
    problem("principal pivoting", "float64", 2.0, (1, 1, 1)),
    problem("principal pivoting", "float32", 1.0, (1, 0.98, 0)),
    problem("gauss-seidel 10", "float32", 0.5, (0.99, 0.2, 0), failed=0.9),
    problem("principal pivoting, again if in doubt", "mixed", 3.0, (1, 1, 0.5), again=0.25),
    problem("lemke", "float64", 9.0, (0.7, 0.6, 0.5), family="hard"),
    problem("lemke", "float32", 8.0, (0, 0, 0), family="hard"),
    problem("direct", "float64", 1e-3, (1, 1, 1), contacts=16),
]


def cells(table, first):
    """The cells of the line that begins with this one."""
    lines = [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in table.splitlines()]
    return next(line[1:] for line in lines if line[0] == first)


def test_the_fastest_way_that_reaches_the_accuracy_is_named():
    table = decisions.of_tradeoff(TRADEOFF)
    assert cells(table, "stacks") == [
        "`ProjectedGaussSeidel(sweeps=10)`, float32, 0.5 µs, in `attempt`",
        "`PrincipalPivoting()`, float64, 2 µs",
        "`PrincipalPivoting()`, float64, 2 µs",
    ]
    assert cells(table, "hard") == [f"none; {share}% by `Lemke()`, float64" for share in (70, 60, 50)]
    assert "Direct" not in table  # sixteen contacts are more than usual
    assert "float32 is enough for 1e-03 in stacks." in table
    assert "float32 is enough for 1e-06 in no family." in table


def test_a_gain_within_the_noise_does_not_buy_a_lower_precision():
    rows = [problem("direct", *row, (1, 1, 1)) for row in (("mixed", 0.95), ("float32", 0.96), ("float64", 1.0))]
    assert decisions.fastest(rows, "within_1e-03") == "`Direct()`, float64, 1 µs"
    assert decisions.fastest(rows[:2], "within_1e-03") == "`Direct()`, float32, 0.96 µs"


def test_mixed_precision_stands_beside_float64():
    table = decisions.of_tradeoff(TRADEOFF)
    assert cells(table[table.index("| mixed precision") :], "stacks") == ["25%, 1.50"]


def test_a_method_with_failures_is_not_recommended_and_the_fastest_peer_is_the_one_named():
    def solver(method, dtype, per_second, failed=0.0):
        return {"method": method, "contacts": 8, "dtype": dtype, "per_second": per_second, "failed": failed}

    rows = [
        solver("principal pivoting", "float64", 3e6),
        solver("gauss-seidel 10", "float64", 9e6, failed=0.5),
        solver("lemke", "float32", 4e5),
        solver("slow 1.0", "float64", 1e5),
        solver("quick 2.0, loop", "float64", 1e6),
    ]
    expected = ["`PrincipalPivoting()`, 3 million", "3 times quick 2.0, loop", "`Lemke()`, 400,000"]
    assert cells(decisions.of_solvers(rows), "8") == expected
    assert "peer" not in decisions.of_solvers(rows[:3])  # a column that would be empty


def test_the_cheapest_bound_that_is_tight_enough_is_named():
    def bound(name, median, time, dtype="float64"):
        shared = {"kind": "bilateral", "contacts": 3, "dtype": dtype}
        return {**shared, "bound": name, "median": median, "us per configuration": time}

    rows = [
        bound("norm_ratio", 0.6, 1.0),
        bound("norm_ratio", 0.99, 0.1, "float32"),
        bound("perron", 0.9, 2.0),
        bound("critical", 1.0, 9.0),
    ]
    assert cells(decisions.of_ladder(rows), "3 bilateral") == [
        "`norm_ratio`, 1 µs", "`perron`, 2 µs", "`critical`, 9 µs", "`critical`, 9 µs"
    ]  # fmt: skip


def bound_row(program, dtype, per_second, to_c=math.nan):
    return {
        "contacts": 2, "dtype": dtype, "program": program, "per_second": per_second, "failed": 0,
        "to_value": per_second / 4e6, "to_numpy": per_second / 1e5, "to_c": to_c,
        "compile_seconds": None if program == "numpy 1.0" else 1.0,
    }  # fmt: skip


def test_first_calls_are_told_by_their_median_and_the_slowest():
    def call(cache, what, *seconds):
        kinds = ("as called s", "jit s", "batch s")
        return {"part": "first_calls", "cache": cache, "what": what} | dict(zip(kinds, seconds, strict=True))

    rows = [call("none", name, 2.0, 1.0, k) for k, name in enumerate("abc")]
    rows += [call("warm", name, 0.2, k / 10, 0.3) for k, name in enumerate("cba")]
    rows += [{"part": "first_calls", "kind": "jit s", "slow": 0}, {"part": "memory", "what": "x"}]
    table = decisions.of_growth(rows)
    assert table.startswith("| first call of 3 quantities |")
    assert cells(table, "jit") == ["1 s", "1 s, c", "0.1 s", "0.2 s, a"]
    assert cells(table, "batch") == ["1 s", "2 s, c", "0.3 s", "0.3 s, c"]


def test_what_was_not_measured_leaves_no_number():
    rows = [bound_row("norm_ratio", "float64", 4e6, to_c=0.5), bound_row("critical", "float64", 1e6)]
    rows += [bound_row(name, "float64", 1e5) for name in ("numpy 1.0", "norm_ratio, plain")]
    table = decisions.of_bounds([*rows, bound_row("norm_ratio", "float32", 8e6)])
    assert len(table.splitlines()) == 4  # two heads, and the programs one would choose from
    assert cells(table, "2") == ["norm_ratio", "4 million", "40", "0.5", "2.00"]
    assert "nan" not in table
    assert decisions.decisions({}) == ""
    other = {"growth": {"machine": MACHINE, "rows": [{"part": "memory", "what": "x"}]}}
    assert decisions.decisions(other) == ""  # no table, and no line that says where it is from


def test_tables_are_written_between_the_markers_and_nowhere_else(tmp_path):
    page, file = tmp_path / "page.md", tmp_path / "tradeoff.json"
    before, after = "# Title\n\n", "\n\nMore.\n"
    page.write_text(f"{before}{decisions.BEGIN}\nold\n{decisions.END}{after}")
    file.write_text(json.dumps({"machine": MACHINE, "rows": TRADEOFF}))
    for _ in range(2):  # the second time changes nothing
        decisions.main(["--tradeoff", str(file), "--write", str(page)])
        tables = f"{decisions.of_tradeoff(TRADEOFF)}\n\n{decisions.source('tradeoff', {'machine': MACHINE})}"
        assert page.read_text() == f"{before}{decisions.BEGIN}\n\n{tables}\n\n{decisions.END}{after}"
    page.write_text("no markers")
    with pytest.raises(ValueError, match="expected one line"):
        decisions.main(["--tradeoff", str(file), "--write", str(page)])
    assert page.read_text() == "no markers"


def test_headlines_are_ratios_of_rows_of_the_same_run():
    guides = [bound_row("norm_ratio", "float64", 4e6), bound_row("numpy 1.0", "float64", 1e5)]
    chain = [{**bound_row("critical", "float64", 1e5), "contacts": 4}]
    ours = {"method": "principal pivoting", "contacts": 8, "per_second": 2e6, "failed": 0.0}
    peers = [{**ours, "method": name, "per_second": rate} for name, rate in (("slow", 1.0), ("quick", 5e5))]
    bound, solve, exact = headlines.sentences(guides, chain, [ours, *peers])
    assert "4 million" in bound
    assert "40 times NumPy" in bound
    assert "2 million per second, 4 times quick; 0.00% failed" in solve
    assert "4 contacts: 0.1 million configurations per second, 0.025 of the rate" in exact
    assert "no peer is installed" in headlines.sentences(guides, chain, [ours])[1]
