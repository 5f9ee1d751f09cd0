"""Three headline numbers in three sentences: a bound, a solve and an exact threshold per second, each beside a peer."""

import argparse
import json
from pathlib import Path

import jax
import numpy as np

from benchmarks import bounds, solvers
from benchmarks._machine import machine
from benchmarks._peers import available

TWO, FOUR, EIGHT = 2, 4, 8
"""Contacts of the two guides, of the chain whose exact threshold is timed, of the complementarity problems."""

METHOD = "principal pivoting"

PART = {TWO: 1, FOUR: 16}
"""The batch of the guides is divided by this: four contacts are slow with NumPy, and with exact thresholds."""


def main(argv: list[str]) -> None:
    """Print the three sentences; `--batch`, `--json FILE`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks headlines", description=__doc__.splitlines()[0])
    parser.add_argument("--batch", type=int, default=1_000_000, help="configurations of the two guides")
    parser.add_argument("--problems", type=int, default=2**14, help="complementarity problems")
    parser.add_argument("--json", metavar="FILE", help="write the numbers to this file")
    options = parser.parse_args(argv)
    jax.config.update("jax_enable_x64", True)
    here, rows = machine(), measured(options.batch, options.problems)
    said = sentences(*rows)
    print(here, *said, sep="\n")
    if options.json:
        written = {"machine": here, "sentences": said, "rows": rows}
        Path(options.json).write_text(json.dumps(written, indent=1) + "\n")


def measured(batch, problems):
    """The rows of two guides and of the chain as `bounds` writes them, those of the solvers as `solvers` does."""
    guides, chain = (bounds.measured(m, max(batch // part, 2), "float64") for m, part in PART.items())
    M, q = solvers.problems(EIGHT, problems, np.float64)
    solves = solvers.measured({METHOD: solvers.METHODS[METHOD][0]}, available(), M, q, alone=False)
    return guides, chain, solves


def sentences(guides, chain, solves):
    """The three sentences."""
    bound, exact = named(guides, bounds.BASE), named(chain, "critical")
    ours, *peers = solves
    peer = max(peers, key=lambda r: r["per_second"], default=None)
    beside = "no peer is installed" if peer is None else f"{times(ours, peer)} times {peer['method']}"
    return [
        f"Friction bound of two guides from derived terms: {million(bound)} million configurations per second, "
        f"{bound['to_numpy']:.3g} times NumPy's batched LAPACK.",
        f"Complementarity problems of {ours['contacts']} contacts by {ours['method']}: {million(ours)} million per "
        f"second, {beside}; {ours['failed']:.2%} failed.",
        f"Exact critical friction of {exact['contacts']} contacts: {million(exact)} million configurations per second, "
        f"{exact['to_value']:.3g} of the rate of the bound.",
    ]


def named(rows, program):
    """The row of a program."""
    return next(r for r in rows if r["program"] == program)


def million(r):
    """The rate in millions per second."""
    return f"{r['per_second'] / 1e6:.3g}"


def times(ours, peer):
    """The ratio of two rates."""
    return f"{ours['per_second'] / peer['per_second']:.3g}"
