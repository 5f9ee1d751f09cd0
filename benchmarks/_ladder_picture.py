"""The picture of the ladder: the share of the exact threshold that each rung reaches, over what it costs."""

from matplotlib.figure import Figure

from jaxcontact.atlas import new_figure
from jaxcontact.atlas.style import GREY, LINE_COLOURS, add_caption

NAMED = (2, 4, 8)
"""Numbers of contacts written beside their points, with whiskers from the 1st to the 99th percentile."""

LOOKS = {
    "norm_ratio": (LINE_COLOURS[0], "o"),
    "direct": (LINE_COLOURS[0], "o"),
    "operator_norm": (LINE_COLOURS[1], "s"),
    "sharper_direct": (LINE_COLOURS[1], "s"),
    "perron": (LINE_COLOURS[2], "D"),
    "positive_definite_radius": (LINE_COLOURS[2], "D"),
    "best_scaling": (LINE_COLOURS[3], "^"),
    "bracket": (LINE_COLOURS[4], "v"),
    "critical": (LINE_COLOURS[6], "P"),
}
"""Colour and mark of each rung."""

TITLES = {"bilateral": "bilateral contacts", "unilateral": "unilateral contacts"}
WORDS = {
    "norm_ratio": "norm_ratio (the tutorial's)",
    "direct": "direct (the tutorial's)",
    "bracket": "bracket, lower end",
}


def draw_ladder(measured: dict) -> Figure:
    """One panel for each kind of contacts; `measured` is what `python -m benchmarks ladder --json` writes."""
    figure, panels = new_figure(columns=2, width=6.0, height=5.0)
    for axes, (kind, title) in zip(panels, TITLES.items(), strict=True):
        rows = [r for r in measured["rows"] if r["kind"] == kind and r["dtype"] == "float64"]
        for name in dict.fromkeys(r["bound"] for r in rows):
            add_rung(axes, [r for r in rows if r["bound"] == name], *LOOKS[name])
        axes.set(xscale="log", ylim=(0, 1.06), title=title)
        axes.set_xlabel("time per configuration, in batch (µs)")
        axes.set_ylabel("share of the exact threshold")
        axes.grid(color=GREY, lw=0.6)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, frameon=False, fontsize=8.5)
    here = measured["machine"]
    systems, sizes = ([r[key] for r in measured["rows"]] for key in ("systems", "contacts"))
    add_caption(
        figure,
        f"Median over random systems of {min(sizes)} to {max(sizes)} contacts: a line for each rung, their number "
        "beside some points, whiskers from the 1st to the 99th percentile. Open marks, where the exact value is out of "
        "reach: the share of the upper end of a bracket, which is no less than the exact value. "
        f"At least {min(systems)} systems of each size, float64; {here['processor']}, {here['cores']} cores, "
        f"jax {here['jax']}, {here['date'][:10]}.",
    )
    return figure


def add_rung(axes, rows: list[dict], colour: str, mark: str) -> None:
    """The line of one rung through its numbers of contacts."""
    rows = sorted(rows, key=lambda r: r["contacts"])
    cost, middle = [r["us per configuration"] for r in rows], [r["median"] for r in rows]
    name = rows[0]["bound"]
    axes.plot(cost, middle, color=colour, lw=1.2, marker=mark, ms=5, label=WORDS.get(name, name))
    for r, x, y in zip(rows, cost, middle, strict=True):
        if r["share of"] != "critical":
            axes.plot(x, y, marker=mark, ms=5, mfc="white", mec=colour, zorder=3)
        if r["contacts"] in NAMED:
            axes.plot([x, x], [r["lowest percent"], r["99th percentile"]], color=colour, lw=1, alpha=0.6)
            axes.annotate(str(r["contacts"]), (x, y), xytext=(4, 4), textcoords="offset points", fontsize=8)
