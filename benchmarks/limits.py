"""How far bounds and solvers are from what the device can move and compute, in batches that fill it.

Two ceilings are measured first, in each dtype, as XLA's own code reaches them: bytes per second of a negation, read and
written, and multiplications and additions per second of long chains. A bound has to read its angle and to write its
results; its operations are those of its compiled program, a division as one. A solve has to read M and q and to write
z, the status, the residual and its steps; of its operations only 2 m^2 for each pivot or sweep are counted, not the
balancing and the judge. The floor is the larger of the two times: a program takes `to_floor` times as long.

It runs on the device that JAX finds first; `bounds` and `solvers` have NumPy, Numba and C beside the same programs.
Programs are compiled by several threads at once, so it is there too that compilation is timed.
"""

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import bounds, solvers
from benchmarks._machine import machine
from benchmarks._timing import in_turns
from jaxcontact.complementarity import LCP, PrincipalPivoting, Status, solve, solve_in_two_precisions
from jaxcontact.linalg import compiler_options

NUMBERS = {"cpu": 2**22}
OTHERWISE = 2**26
"""Numbers of a batch, in its angles or in its matrices: more than the caches hold."""

PART = {1: 1, 2: 1, 4: 16, 8: 256}
"""A batch of angles is divided by this, by contacts."""

MOST, DISTINCT = 2**22, 2**12
"""The largest batch of problems, and how many of them differ."""

CHAINS, LINKS = 8, 128
"""Independent chains of multiplications and additions, so that none waits for the one before, and their length."""

METHODS = ("direct", "principal pivoting", "lemke", "gauss-seidel 50")
"""Of `solvers`."""

TWO_PRECISIONS = "principal pivoting, two precisions"

AT_ONCE = 8
"""Calls that are waited for together, so that the wait for the device is not counted."""

ROUNDS, PATIENCE = 10, 0.3

HEADS = "  m  dtype    program                                batch  million/s  failed     GB/s    Gop/s  to floor"


def main(argv: list[str]) -> None:
    """Print the table; `--contacts`, `--sizes`, `--dtypes`, `--numbers`, `--json FILE`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks limits", description=__doc__.splitlines()[0])
    parser.add_argument("--contacts", type=int, nargs="*", default=list(PART), choices=PART, help="of the bounds")
    parser.add_argument("--sizes", type=int, nargs="*", default=solvers.SIZES, help="contacts of the problems")
    parser.add_argument("--dtypes", nargs="+", default=["float64", "float32"], choices=["float64", "float32"])
    numbers = NUMBERS.get(jax.default_backend(), OTHERWISE)
    parser.add_argument("--numbers", type=int, default=numbers, help="in a batch of angles, and in one of matrices")
    parser.add_argument("--json", metavar="FILE", help="write the measurements to this file as they come")
    options = parser.parse_args(argv)
    jax.config.update("jax_enable_x64", True)
    here, rows = machine(), []
    ceilings = {dtype: ceiling(options.numbers, dtype) for dtype in options.dtypes}
    print(here, ceilings, HEADS, sep="\n", flush=True)
    for m in sorted({*options.contacts, *options.sizes}):
        for dtype in options.dtypes:
            records = bounding(m, options.numbers // PART[m], dtype) if m in options.contacts else []
            rows += measured(records, dtype, ceilings[dtype])
            records = solving(m, min(options.numbers // m**2, MOST), dtype) if m in options.sizes else []
            rows += measured(records, dtype, ceilings[dtype])
            if options.json:
                written = {"machine": here, "ceilings": ceilings, "rows": rows}
                Path(options.json).write_text(json.dumps(written, indent=1) + "\n")


def ceiling(numbers, dtype):
    """{what: per second}, bytes and operations."""
    x = jnp.full(numbers, 0.5, dtype)

    def chains(x):
        ends = [x + k for k in range(CHAINS)]
        for _ in range(LINKS):
            ends = [end * x + x for end in ends]
        return sum(ends)

    programs = {"bytes": lambda x: -x, "operations": chains}
    calls = {name: compiled(f, x, options=compiler_options())[0] for name, f in programs.items()}
    for call in calls.values():
        call()
    seconds = seconds_of(calls)
    return {
        "bytes": 2 * x.nbytes / seconds["bytes"],
        "operations": 2.0 * CHAINS * LINKS * numbers / seconds["operations"],
    }


def compiled(function, *arguments, options=None):
    """(the program called with these arguments, the operations in it)"""
    program = jax.jit(function).lower(*arguments).compile(options)
    costs = program.cost_analysis() or {}
    return lambda: program(*arguments), costs.get("flops", 0.0)


def seconds_of(calls):
    """{name: seconds} of calls that have run once."""

    def several(call):
        for _ in range(AT_ONCE):
            results = call()
        jax.block_until_ready(results)

    seconds = in_turns({name: lambda call=call: several(call) for name, call in calls.items()}, PATIENCE, ROUNDS)
    return {name: s / AT_ONCE for name, s in seconds.items()}


def bounding(m, count, dtype):
    """Records of the programs of `bounds` for m contacts, with the `call` of each."""
    theta = np.random.default_rng(0).uniform(bounds.LEAST_ANGLE, bounds.GREATEST_ANGLE, count).astype(dtype)
    theta = jnp.asarray(theta)

    def record(program):
        name, function = program
        call, operations = compiled(jax.vmap(function), theta, options=compiler_options())
        results = jax.tree.leaves(call())
        failed = float(jnp.any(jnp.isnan(jnp.stack(results)), axis=0).mean())
        moved = theta.nbytes + sum(x.nbytes for x in results)
        return recorded(name, m, count, failed, moved, operations, call)

    wanted = [(name, f) for name, f in bounds.programs(m).items() if not name.endswith(bounds.PLAIN)]
    return side_by_side(record, wanted)


def solving(m, count, dtype):
    """Records of the methods of `solvers` for problems of m contacts, with the `call` of each."""
    M, q = solvers.problems(m, min(count, DISTINCT), np.dtype(dtype))
    chosen = np.arange(count) % len(q)
    M, q = jnp.asarray(M)[chosen], jnp.asarray(q)[chosen]

    def record(named):
        name, answer_of = named

        def answers(M, q):
            answer = answer_of(LCP(M, q))
            return answer.attempt, answer.status, answer.residual, answer.steps

        call, _ = compiled(jax.vmap(answers), M, q)
        results = call()
        _, status, residual, steps = results
        failed, moved = float(jnp.mean(status != Status.SOLVED)), sum(x.nbytes for x in (M, q, *results))
        row = recorded(name, m, count, failed, moved, 2.0 * m**2 * float(jnp.sum(steps)), call)
        return row | {
            "residual_worst": float(residual.max()),
            "steps": float(steps.mean()),
            "steps_most": int(steps.max()),
        }

    ways = {name: solvers.METHODS[name] for name in METHODS}
    ways = {name: lambda p, method=method: solve(p, method) for name, (method, most) in ways.items() if m <= most}
    if dtype == "float64":
        ways[TWO_PRECISIONS] = lambda p: solve_in_two_precisions(p, PrincipalPivoting()).solution
    return side_by_side(record, ways.items())


def recorded(name, m, count, failed, moved, operations, call):
    return {
        "program": name, "contacts": m, "batch": count, "failed": failed, "bytes": moved, "operations": operations,
        "call": call,
    }  # fmt: skip


def side_by_side(record, wanted):
    """The records of all that is wanted, compiled by several threads."""
    with ThreadPoolExecutor() as threads:
        return list(threads.map(record, wanted))


def measured(records, dtype, limit):
    """The rows of records that share a machine's mood, printed."""
    seconds = seconds_of({r["program"]: r.pop("call") for r in records})
    rows = []
    for r in records:
        s = seconds[r["program"]]
        floor = max(r["bytes"] / limit["bytes"], r["operations"] / limit["operations"])
        rows.append(shown({"dtype": dtype} | r | {"per_second": r["batch"] / s, "to_floor": s / floor}))
    return rows


def shown(r):
    """The row, printed."""
    rates = [r[what] * r["per_second"] / r["batch"] / 1e9 for what in ("bytes", "operations")]
    print(
        f"{r['contacts']:3d}  {r['dtype']:8} {r['program']:34} {r['batch']:9d}  {r['per_second'] / 1e6:9.4g}"
        f"  {r['failed']:6.4f}  {rates[0]:7.1f}  {rates[1]:7.1f}  {r['to_floor']:8.2f}",
        flush=True,
    )
    return r
