"""Which method, which bound, which dtype: tables in Markdown, written from the JSON files of the other benchmarks.

Each file is optional; there are rows only for what was measured. `--write FILE` puts the tables between the two marker
comments of that file, otherwise they are printed.
"""

import argparse
import dataclasses
import json
from pathlib import Path

from benchmarks import bounds, solvers, tradeoff
from benchmarks._growth_first_calls import AS_CALLED, BATCH, JIT
from benchmarks._markdown import ordered, rate, table

BEGIN, END = "<!-- decisions -->", "<!-- end of decisions -->"

ENOUGH = 0.99
"""A method reaches an accuracy if this share of the lanes does."""

NOISE = 1.1
"""Times and shares within this factor of the best are as good."""

DIGITS = {goal: f"within_{goal:.0e}" for goal in tradeoff.GOALS}

TIGHTNESS = (0.5, 0.8, 0.95)
"""Shares of the exact threshold, in the median, for which the cheapest bound is named; besides the exact one."""

USUAL = 8
"""The accuracy table is of the largest measured number of contacts up to this one."""


def main(argv: list[str]) -> None:
    """Print or write the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks decisions", description=__doc__.splitlines()[0])
    for name in TABLES:
        parser.add_argument(f"--{name}", metavar="FILE", help=f"what `python -m benchmarks {name} --json` wrote")
    parser.add_argument("--write", metavar="FILE", help=f"replace what stands between {BEGIN} and {END}")
    given = vars(parser.parse_args(argv))
    files = {name: json.loads(Path(given[name]).read_text()) for name in TABLES if given[name]}
    tables = decisions(files)
    if given["write"]:
        Path(given["write"]).write_text(replaced(Path(given["write"]).read_text(), tables))
    else:
        print(tables)


def decisions(files: dict) -> str:
    """All tables; `files` maps the name of a benchmark to what it wrote."""
    made = {name: TABLES[name](measured["rows"]) for name, measured in files.items()}
    return "\n\n".join(f"{found}\n\n{source(name, files[name])}" for name, found in made.items() if found)


def replaced(text: str, tables: str) -> str:
    """The text with the tables between its markers. Raises ValueError where they are missing or not one pair."""
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise ValueError(f"expected one line {BEGIN} and after it one line {END}: write them where the tables belong")
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{tables}\n\n{END}{rest.partition(END)[2]}"


def source(name: str, measured: dict) -> str:
    """Where the numbers come from."""
    here = measured["machine"]
    where = f"{here['processor']}, {here['cores']} cores" if here.get("device", "cpu") == "cpu" else here["device"]
    ceilings = "; ".join(
        f"{dtype}: {limit['bytes'] / 1e9:,.0f} GB/s, {limit['operations'] / 1e9:,.0f} billion operations per second"
        for dtype, limit in measured.get("ceilings", {}).items()
    )
    note = f" Note: {here['note']}." if "note" in here else ""
    return (
        f"Measured by `python -m benchmarks {name}` on {where}, jax {here['jax']}, {here['date'][:10]}."
        f"{ceilings and f' Ceilings: {ceilings}.'}{note}"
    )


def of_solvers(rows: list[dict]) -> str:
    """The fastest method without a failure, by number of contacts, beside the fastest peer."""
    lines = []
    for m in ordered(rows, "contacts"):
        cells = [f"{m}"]
        for dtype in ("float64", "float32"):
            ours = [
                r for r in rows if (r["contacts"], r["dtype"]) == (m, dtype) and own(r["method"]) and not r["failed"]
            ]
            best = max(ours, key=lambda r: r["per_second"], default=None)
            cells.append(f"{code(best['method'])}, {rate(best['per_second'])}" if best else "")
            if dtype == "float64":
                cells.append(beside_peer(best, [r for r in rows if r["contacts"] == m and not own(r["method"])]))
        lines.append(cells)
    return table(["contacts", "float64, solves per second", "the fastest peer", "float32, solves per second"], lines)


def beside_peer(best: dict | None, peers: list[dict]) -> str:
    """How many times as fast as which peer."""
    peer = max(peers, key=lambda r: r["per_second"], default=None)
    if best is None or peer is None:
        return ""
    return f"{best['per_second'] / peer['per_second']:.3g} times {peer['method']}"


def of_tradeoff(rows: list[dict]) -> str:
    """The fastest way to each accuracy, by family, and where float32 is enough."""
    sizes = ordered(rows, "contacts")
    m = max((size for size in sizes if size <= USUAL), default=sizes[0])
    rows = [r for r in rows if r["contacts"] == m]
    families = ordered(rows, "family")
    heads = [f"{m} contacts", *(f"{ENOUGH:.0%} within {goal:.0e}" for goal in DIGITS)]
    made = {family: [r for r in rows if r["family"] == family] for family in families}
    lines = [[family, *(fastest(part, key) for key in DIGITS.values())] for family, part in made.items()]
    return "\n\n".join([table(heads, lines), enough_of_float32(made), again(made)]).strip()


def fastest(rows: list[dict], key: str) -> str:
    """The fastest row that reaches an accuracy, the plainest of those that are as good as fastest; or how far the best
    one gets."""
    reaching = [r for r in rows if r[key] >= ENOUGH]
    if reaching:
        least = min(r["us_per_problem"] for r in reaching)
        best = min((r for r in reaching if r["us_per_problem"] <= NOISE * least), key=plainness)
        unsure = ", in `attempt`" if best["failed"] > 1 - ENOUGH else ""
        return f"{code(best['method'])}, {best['dtype']}, {best['us_per_problem']:.2g} µs{unsure}"
    most = max(r[key] for r in rows)
    best = min((r for r in rows if NOISE * r[key] >= most), key=plainness)
    return f"none; {best[key]:.0%} by {code(best['method'])}, {best['dtype']}" if most else "none"


def plainness(row: dict) -> tuple:
    """What one would rather use comes first: one precision, the higher one, the quicker."""
    return ("float64", "float32", "mixed").index(row["dtype"]), row["us_per_problem"]


def enough_of_float32(made: dict) -> str:
    """A sentence for each accuracy: in which families some method reaches it in float32."""
    sentences = []
    for goal, key in DIGITS.items():
        enough = [
            family for family, rows in made.items() if any(r["dtype"] == "float32" and r[key] >= ENOUGH for r in rows)
        ]
        sentences.append(f"float32 is enough for {goal:.0e} in {', '.join(enough) or 'no family'}.")
    return " ".join(sentences)


def again(made: dict) -> str:
    """What mixed precision costs and gains: beside float64 everywhere, by family."""
    names = ordered([r for rows in made.values() for r in rows if r["dtype"] == "mixed"], "method")
    heads = ["mixed precision: solved again, time beside float64", *map(code, names)]
    lines = []
    for family, rows in made.items():
        found = {(r["method"], r["dtype"]): r for r in rows}
        cells = []
        for name in names:
            mixed, pure = found.get((name, "mixed")), found.get((name.partition(", ")[0], "float64"))
            times = mixed and pure and mixed["us_per_problem"] / pure["us_per_problem"]
            cells.append(f"{mixed['solved_again']:.0%}, {times:.2f}" if times else "")
        lines.append([family, *cells])
    return table(heads, lines) if names else ""


def of_bounds(rows: list[dict]) -> str:
    """Rates of the bounds of a mechanism, in float64, beside NumPy and C, and what float32 gains."""
    rows = [r for r in rows if r["compile_seconds"] is not None and not r["program"].endswith(bounds.PLAIN)]
    lines = []
    single = {(r["contacts"], r["program"]): r["per_second"] for r in rows if r["dtype"] == "float32"}
    for r in rows:
        if r["dtype"] == "float64":
            key = r["contacts"], r["program"]
            gain = f"{single[key] / r['per_second']:.2f}" if key in single else ""
            peers = [f"{r[peer]:.3g}" if r[peer] == r[peer] else "" for peer in ("to_numpy", "to_c")]
            lines.append([str(r["contacts"]), r["program"], rate(r["per_second"]), *peers, gain])
    heads = ["contacts", "program", "configurations per second, float64", "times NumPy", "times C", "float32 gains"]
    return table(heads, lines)


def of_ladder(rows: list[dict]) -> str:
    """The cheapest bound that reaches each tightness, by kind and number of contacts."""
    rows = [r for r in rows if r["dtype"] == "float64"]
    heads = ["contacts", *(f"{share:.0%} of the exact threshold, in the median" for share in TIGHTNESS), "exact"]
    lines = []
    for kind in ordered(rows, "kind"):
        for m in ordered(rows, "contacts"):
            part = [r for r in rows if (r["kind"], r["contacts"]) == (kind, m)]
            exact = [r for r in part if r["bound"] == "critical"]
            if part:
                lines.append([f"{m} {kind}", *(cheapest(part, share) for share in TIGHTNESS), cheapest(exact, 0)])
    return table(heads, lines)


def cheapest(rows: list[dict], share: float) -> str:
    """The cheapest bound of this tightness."""
    best = min((r for r in rows if r["median"] >= share), key=lambda r: r["us per configuration"], default=None)
    return f"`{best['bound']}`, {best['us per configuration']:.2g} µs" if best else ""


def of_limits(rows: list[dict]) -> str:
    """Rates of bounds and solvers on one device, each beside the time that it takes to move or compute what it must."""
    found = {(r["contacts"], r["program"], r["dtype"]): r for r in rows}
    lines = []
    for m, program in dict.fromkeys(key[:2] for key in found):
        cells = [str(m), code(program)]
        for dtype in ("float64", "float32"):
            r = found.get((m, program, dtype))
            cells += [rate(r["per_second"]), f"{r['to_floor']:.3g}"] if r else ["", ""]
        failed = max(r["failed"] for key, r in found.items() if key[:2] == (m, program))
        lines.append([*cells, f"{failed:.1%}" if failed else ""])
    heads = [f"{dtype}, {what}" for dtype in ("float64", "float32") for what in ("per second", "times its floor")]
    return table(["contacts", "program", *heads, "failed"], lines)


def of_growth(rows: list[dict]) -> str:
    """What first calls cost, by the way in which they are made."""
    rows = [r for r in rows if r["part"] == "first_calls" and "what" in r]
    lines = []
    for kind in (AS_CALLED, JIT, BATCH):
        cells = [kind]
        for cache in ("none", "warm"):
            calls = sorted((r[f"{kind} s"], r["what"]) for r in rows if r["cache"] == cache)
            cells += (
                [f"{calls[len(calls) // 2][0]:.2g} s", f"{calls[-1][0]:.2g} s, {calls[-1][1]}"] if calls else ["", ""]
            )
        lines.append(cells)
    heads = [f"{what}, {cache}" for cache in ("no cache", "with JAX's cache") for what in ("median", "slowest")]
    return table([f"first call of {len(ordered(rows, 'what'))} quantities", *heads], lines) if rows else ""


def own(name: str) -> bool:
    """Whether a method is one of ours."""
    return name.partition(", ")[0] in METHODS


def code(name: str) -> str:
    """A method as one writes it in Python, with what was added to it."""
    base, comma, rest = name.partition(", ")
    if base not in METHODS:
        return name
    method = METHODS[base][0]
    fields = ((field, getattr(method, field.name)) for field in dataclasses.fields(method))
    given = ", ".join(f"{field.name}={value!r}" for field, value in fields if value != field.default)
    return f"`{type(method).__name__}({given})`{comma}{rest}"


METHODS = solvers.METHODS | tradeoff.METHODS

TABLES = {
    "solvers": of_solvers,
    "tradeoff": of_tradeoff,
    "bounds": of_bounds,
    "ladder": of_ladder,
    "limits": of_limits,
    "growth": of_growth,
}
