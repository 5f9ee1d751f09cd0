"""Speed against accuracy: time per problem and exact errors of every method, budget and dtype, family by family.

The families, and where their exact answers come from, are in `_tradeoff_problems`. Errors are those of the problem as
given in float64: float32 pays for rounding the data too. All lanes count, failed ones with what they propose. Mixed
precision is `solve_in_two_precisions`, or float64 started from float32 everywhere.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks._machine import machine
from benchmarks._tradeoff_methods import METHODS, programs
from benchmarks._tradeoff_picture import draw_tradeoff
from benchmarks._tradeoff_problems import families
from jaxcontact import atlas as maps
from jaxcontact.complementarity import Status

SIZES = (2, 4, 8, 16)

GOALS = (1e-3, 1e-6, 1e-10)
"""The share of the lanes within each of these errors is recorded."""

LANES, LEAST_LANES = 2**14, 512
"""Problems are repeated until the batch holds LANES / m^2 of them, at least LEAST_LANES."""

REPEATS, PATIENCE = 9, 0.3
"""A time is the least of several runs, as many as fit in PATIENCE seconds, at least one and at most REPEATS."""


def main(argv: list[str]) -> None:
    """Print the table; `--sizes`, `--count`, `--json FILE`, `--picture FILE`, `--read FILES`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks tradeoff", description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of contacts")
    parser.add_argument("--count", type=int, default=512, help="different problems in each family")
    parser.add_argument("--json", metavar="FILE", help="write the measurements to this file")
    parser.add_argument("--read", metavar="FILE", nargs="+", help="measure nothing, join these files")
    parser.add_argument("--picture", metavar="FILE", help="draw error over time")
    parser.add_argument("--drawn", type=int, default=8, help="the number of contacts that is drawn")
    given = parser.parse_args(argv)
    measurements = joined(given.read) if given.read else measured(given.sizes, given.count)
    if given.json:
        Path(given.json).write_text(json.dumps(measurements, indent=1, allow_nan=False) + "\n")
    if given.picture:
        maps.save(draw_tradeoff(measurements, given.drawn), given.picture)


def joined(files):
    """The measurements of several files; the machine is the first one's."""
    parts = [json.loads(Path(file).read_text()) for file in files]
    return {"machine": parts[0]["machine"], "rows": [row for part in parts for row in part["rows"]]}


def measured(sizes, count, methods=METHODS):
    """{"machine", "rows"}, printed as it comes."""
    jax.config.update("jax_enable_x64", True)
    here, rows = machine(), []
    print(here)
    for m in sizes:
        made = families(m, count)
        for program in programs(m, max(LANES // m**2, LEAST_LANES, count), methods):
            print(HEADS, flush=True)
            rows += [shown(row(family, problems, *program)) for family, problems in made.items()]
    return {"machine": here, "rows": rows}


def row(family, problems, name, dtype, lanes, call, compilation):
    """A record of one measurement; the batch is the problems over and over."""
    count, m = problems.q.shape
    given = "float32" if dtype == "float32" else "float64"
    M, q = (jnp.asarray(np.resize(part, (lanes, *part.shape[1:])), given) for part in (problems.M, problems.q))
    (found, again), seconds = timed(partial(call, M, q))
    found = jax.tree.map(lambda part: part[:count], found)
    answered = np.isin(found.status, (Status.SOLVED, Status.REDUNDANT))
    error_w, error_z = errors(problems, found)
    error = np.maximum(error_w, error_z)
    backward = backward_errors(problems, found.z.astype(float))
    return {
        "family": family,
        "contacts": m,
        "dtype": dtype,
        "method": name,
        "problems": count,
        "origin": problems.origin,
        "lanes": lanes,
        "us_per_problem": 1e6 * seconds / lanes,
        "failed": float(np.mean(~answered)),
        **summary("w_error", error_w),
        **(summary("z_error", error_z) if np.isfinite(problems.z).all() else {}),
        **summary("error", error),
        "error_worst_answered": finite(error[answered].max(initial=0)),
        **summary("backward_error", backward),
        **{f"within_{goal:.0e}": float(np.mean(error <= goal)) for goal in GOALS},
        "solved_again": again / lanes,
        "compile_seconds": None if jax.config.jax_compilation_cache_dir else compilation,
    }


def errors(problems, found):
    """Largest errors (count,) of w relative to the greater of |w| and |q|, and of z relative to |z| where z is unique,
    else zero; inf for no number."""
    unique = np.isfinite(problems.z).all(axis=1)
    size_z, size_q = largest(problems.z), largest(problems.q)
    size_z = np.where(size_z > 0, size_z, size_q / largest(problems.M.reshape(len(size_q), -1)))
    error_w = largest(found.w - problems.w) / positive(np.maximum(size_q, largest(problems.w)))
    error_z = np.where(unique, largest(found.z - problems.z) / size_z, 0)
    lost = ~np.isfinite(found.z).all(axis=1)
    return np.where(lost | np.isnan(error_w), np.inf, error_w), np.where(lost, np.inf, error_z)


def backward_errors(problems, z):
    """(count,) the judge's eta, of float64 data whatever the dtype of the answer."""
    M, q, _, _, _ = problems
    sizes = np.einsum("bij,bj->bi", abs(M), abs(z)) + abs(q)
    w = np.einsum("bij,bj->bi", M, z) + q
    smaller = np.minimum(z / positive(largest(z))[:, None], w / positive(largest(sizes))[:, None])
    return np.where(np.isnan(largest(smaller)), np.inf, largest(smaller))


def largest(x):
    """(count,) largest absolute entry; NaN if one is."""
    return np.abs(x).max(axis=1)


def positive(x):
    """x, and one for zero."""
    return np.where(x == 0, 1, x)


def summary(name, error):
    """The 99th percentile and the worst; None where that is no number."""
    return {
        f"{name}_99_percent": finite(np.quantile(error, 0.99, method="higher")),
        f"{name}_worst": finite(error.max()),
    }


def finite(x):
    """A float, or None for what JSON cannot say."""
    return float(x) if np.isfinite(x) else None


def timed(run):
    """(result, least seconds) after one run that does not count."""
    result, times = run(), []
    while len(times) < REPEATS and sum(times) < PATIENCE:
        began = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - began)
    return result, min(times)


HEADS = "  m  dtype    method                                  family                us     failed    w 99%    z 99%"
HEADS += "    worst  eta 99%  <=1e-3  <=1e-6 <=1e-10   again"


def shown(r):
    """The record, printed."""
    keys = ("w_error_99_percent", "z_error_99_percent", "error_worst", "backward_error_99_percent")
    numbers = (r.get(key) for key in keys)
    shares = (r[f"within_{goal:.0e}"] for goal in GOALS)
    print(
        f"{r['contacts']:3d}  {r['dtype']:8} {r['method']:39} {r['family']:17} {r['us_per_problem']:9.3f}"
        f"  {r['failed']:7.4f}  "
        + "  ".join(f"{x:7.0e}" if x is not None else "      -" for x in numbers)
        + "".join(f" {share:7.4f}" for share in (*shares, r["solved_again"])),
        flush=True,
    )
    return r
