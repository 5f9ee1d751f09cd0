"""The picture of speed against accuracy: error over time, a panel for each family, the Pareto front drawn."""

import math

from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from jaxcontact.atlas import new_figure
from jaxcontact.atlas.style import GREY, INK, LINE_COLOURS, add_caption

COLUMNS = 3

LOOKS = {
    "principal pivoting": (LINE_COLOURS[0], "o"),
    "lemke": (LINE_COLOURS[1], "s"),
    "gauss-seidel": (LINE_COLOURS[2], "D"),
    "banach": (LINE_COLOURS[3], "^"),
    "direct": (LINE_COLOURS[4], "P"),
}
"""Colour and mark of each method."""

FILLS = {"float64": "full", "float32": "none", "mixed": "left"}

LEAST, GREATEST = 1e-17, 10.0
"""Errors are drawn between these: nothing is better than exact, and beyond one there is no digit to lose."""

ERROR, COST = "error_99_percent", "us_per_problem"


def draw_tradeoff(measured: dict, contacts: int) -> Figure:
    """`measured` is what `python -m benchmarks tradeoff --json` writes; `contacts`, the size that is drawn."""
    rows = [r for r in measured["rows"] if r["contacts"] == contacts]
    if not rows:
        raise ValueError(
            f"no rows for {contacts} contacts: there are {sorted({r['contacts'] for r in measured['rows']})}"
        )
    names = list(dict.fromkeys(r["family"] for r in rows))
    figure, panels = new_figure(columns=COLUMNS, rows=math.ceil(len(names) / COLUMNS), width=4.2, height=3.3)
    for axes, name in zip(panels, names, strict=False):
        add_family(axes, name, [r for r in rows if r["family"] == name])
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    legend = dict(zip(labels, handles, strict=True))
    figure.legend(legend.values(), legend, loc="outside upper center", ncols=5, frameon=False, fontsize=8.5)
    here = measured["machine"]
    add_caption(
        figure,
        f"{contacts} contacts, {min(r['problems'] for r in rows)} problems in each family. Error: 99th percentile, "
        "over all lanes, of the greater of the errors of w and, where it is unique, of z, against exact answers in "
        f"integers, of the problem as given in float64; drawn between {LEAST:.0e} and {GREATEST:g}. Filled marks "
        "float64, open ones float32, half filled ones both; lines join the budgets of an iteration; grey: the Pareto "
        f"front. Batches of {min(r['lanes'] for r in rows)} on {here['processor']}, {here['cores']} cores, "
        f"jax {here['jax']}, {here['date'][:10]}.",
    )
    return figure


def add_family(axes, name: str, rows: list[dict]) -> None:
    """One panel."""
    best = front([(r[COST], drawn(r[ERROR])) for r in rows])
    axes.step(*zip(*best), where="post", color=GREY, lw=4, zorder=0)
    for method, (colour, mark) in LOOKS.items():
        for dtype, fill in FILLS.items():
            chosen = [r for r in rows if r["method"].startswith(method) and r["dtype"] == dtype]
            if chosen:
                style = {"color": colour, "marker": mark, "ms": 6, "fillstyle": fill, "mec": colour}
                line = "none" if dtype == "mixed" else "-"
                axes.plot(
                    [r[COST] for r in chosen],
                    [drawn(r[ERROR]) for r in chosen],
                    ls=line,
                    lw=0.8,
                    label=f"{method}, {dtype}",
                    **style,
                )
    axes.set(xscale="log", yscale="log", ylim=(LEAST / 3, GREATEST * 3), title=name)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time per problem, in batch (µs)")
    axes.set_ylabel("error, 99th percentile")
    axes.grid(color=GREY, lw=0.4)
    axes.title.set_color(INK)


def front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points that no other one beats in time and error at once, from the fastest on."""
    best: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if not best or error < best[-1][1]:
            best.append((cost, error))
    return best


def drawn(error: float | None) -> float:
    """The error as it is drawn; None is no number at all."""
    return GREATEST if error is None else min(max(error, LEAST), GREATEST)
