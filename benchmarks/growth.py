"""How time and memory grow with the batch, the contacts and the grid, and what a first call costs.

`python -m benchmarks growth --json growth.json`; `docs/first_calls.json` is its part `first_calls`. Bounds of
`PainleveKlein` over the angle; complementarity problems of sliding contacts; scenes that are columns of boxes side by
side, without friction, whose forces are the weights above. Every row is written as it comes. First calls, without and
with JAX's persistent compilation cache, and peak memory are measured in processes of their own. `--parts` names some of
the parts, `--quick` takes a minute.
"""

import argparse
import json
import os
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks import _growth_first_calls, _growth_memory, bounds, solvers
from benchmarks._machine import machine
from jaxcontact import native
from jaxcontact.complementarity import LCP, Lemke, PrincipalPivoting, Status, solve
from jaxcontact.linalg import compiler_options

GRAVITY = 9.81
TALLEST = 8
"""Boxes in a column."""

DISTINCT = 4096
"""Larger batches repeat this many problems."""

BATCHES = {4: 10**6, 16: 10**5}
"""Contacts and the largest batch of problems."""

TOGETHER, ENTRIES = 256, 2**20
"""Scenes in a batch: TOGETHER, or as many as hold ENTRIES numbers."""

SMALL = (1, 2, 4, 8, 16, 32, 64)
LARGE = (128, 256, 512, 1024)
"""Contacts of scenes that are solved in a batch too, and of those solved alone."""

STEEPEST, LONGEST = 8, 30.0
"""A method stops where twice the contacts, at STEEPEST times the seconds, would take longer than LONGEST."""

RUNS, PATIENCE = 1000, 0.5
"""A time is the median of as many runs as fit in PATIENCE seconds, at least one and at most RUNS."""

COLD, WARM = 3.0, 0.5
"""A first call is slow beyond this many seconds, without and with the compilation cache."""


def main(argv: list[str]) -> None:
    """Print the rows; `--parts`, `--quick`, `--json FILE`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks growth", description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=PARTS)
    parser.add_argument("--quick", action="store_true", help="smaller sizes, first calls of one mechanism")
    parser.add_argument("--json", metavar="FILE", help="write the measurements to this file")
    options = parser.parse_args(argv)
    jax.config.update("jax_enable_x64", True)
    record = Record(options.json)
    for name in options.parts:
        for row in PARTS[name](options.quick):
            record.add({"part": name} | row)


class Record:
    """The machine, with whether the compiled kernels are in use, and the rows so far, printed and written as they
    come."""

    def __init__(self, path):
        self.path, self.rows = path and Path(path), []
        self.machine = machine() | {"kernels": native.reason() or "in use"}
        print(self.machine, flush=True)

    def add(self, row):
        """One more row; the file is replaced as a whole, so that there is always a complete one."""
        row["load average"] = round(os.getloadavg()[0], 2)
        self.rows.append(row)
        print("  ".join(f"{key} {shown(value)}" for key, value in row.items()), flush=True)
        if self.path:
            fresh = self.path.with_suffix(".part")
            fresh.write_text(json.dumps({"machine": self.machine, "rows": self.rows}, indent=1) + "\n")
            fresh.replace(self.path)


def shown(value):
    """A value for the terminal."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def batch(quick):
    """Rows: microseconds per configuration of a bound, and of a problem, over the size of the batch."""
    programs = bounds.programs(2)
    for name in (bounds.BASE, bounds.BASE + bounds.PLAIN):
        options = {} if name.endswith(bounds.PLAIN) else compiler_options()
        for count in powers(10**4 if quick else 10**6):
            theta = np.linspace(bounds.LEAST_ANGLE, bounds.GREATEST_ANGLE, count)
            call, compilation = bounds.compiled(programs[name], theta, options)
            yield timing(name, 2, count, call, compilation)
    for m, largest in BATCHES.items():
        for count in powers(10**2 if quick else largest):
            few = solvers.problems(m, min(count, DISTINCT), np.float64)
            yield solving(PrincipalPivoting(), *(np.resize(part, (count, *part.shape[1:])) for part in few))


def powers(largest):
    """1, 10, ... up to the largest."""
    return [10**k for k in range(round(np.log10(largest)) + 1)]


def contacts(quick):
    """Rows: one scene and a batch of scenes over the number of contacts."""
    small, large = (SMALL[:3:2], LARGE[:1]) if quick else (SMALL, LARGE)
    for method in (PrincipalPivoting(), Lemke()):
        for m in small:
            yield solving(method, *columns(1, m))
            yield solving(method, *columns(int(np.clip(ENTRIES // m**2, 1, TOGETHER)), m))
        last = 0.0
        for m in large:
            if STEEPEST * last < LONGEST:
                row = solving(method, *columns(1, m))
                last = row["us per configuration"] / 1e6
                yield row


def columns(count, m):
    """(M (count, m, m), q (count, m), forces (count, m)) of boxes of one, two or four kilograms in columns, each on the
    one below or on the floor: M = J inv(mass) J', q = -J g; a force is the weight above."""
    mass = 2.0 ** np.random.default_rng(m).integers(0, 3, (count, m))
    on_a_box = np.arange(1, m) % TALLEST != 0
    J = np.eye(m) - np.diag(on_a_box, -1)
    forces = np.linalg.solve(J.T, mass[:, :, None] * GRAVITY)[:, :, 0]
    return J @ (J.T / mass[:, :, None]), np.tile(-GRAVITY * J.sum(axis=1), (count, 1)), forces


def solving(method, M, q, forces=None):
    """A row: the problems solved in a batch; a single one without vmap."""

    def answers(M, q):
        answer = solve(LCP(M, q), method)
        return answer.attempt, answer.status, answer.residual, answer.backward_error

    count, m = q.shape
    M, q, function = (M[0], q[0], answers) if count == 1 else (M, q, jax.vmap(answers))
    M, q = jnp.asarray(M), jnp.asarray(q)
    began = time.perf_counter()
    program = jax.jit(function).lower(M, q).compile()
    compilation = time.perf_counter() - began
    z, status, residual, error = (np.asarray(part) for part in program(M, q))
    found = {
        "solved": float(np.mean(status == Status.SOLVED)),
        "statuses": sorted({Status(s).name for s in np.ravel(status).tolist()}),
        "residual": float(residual.max()),
        "backward error": float(error.max()),
    }
    if forces is not None:
        found["error of a force"] = float(np.max(abs(z / np.reshape(forces, z.shape) - 1)))
    call = lambda: jax.block_until_ready(program(M, q))  # noqa: E731
    return timing(type(method).__name__, m, count, call, compilation) | found


def timing(what, m, count, call, compilation):
    """A row: microseconds per configuration."""
    return {
        "what": what,
        "contacts": m,
        "batch": count,
        "us per configuration": 1e6 * seconds(call) / count,
        "compile s": compilation,
    }


def seconds(call):
    """Median seconds, after one run that does not count."""
    call()
    times = []
    while not times or (len(times) < RUNS and sum(times) < PATIENCE):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def grid(quick):
    """Rows: a whole sweep, with tracing and compilation, which every sweep pays for."""
    guides = bounds.mechanism(2)

    def bound(guides, theta):
        return jc.bounds.norm_ratio(jc.delassus(guides, guides.state(theta=theta)))

    for count in (10**3, 10**4) if quick else (10**3, 10**4, 10**5, 10**6):
        theta = np.linspace(bounds.LEAST_ANGLE, bounds.GREATEST_ANGLE, 1000)
        length = np.linspace(0.5, 2.0, count // 1000)
        began = time.perf_counter()
        jc.sweep({"mu_max": bound}, guides, theta=theta, length=length, progress=False)
        took = time.perf_counter() - began
        yield {"what": "sweep", "contacts": 2, "grid": count, "s": took, "us per configuration": 1e6 * took / count}


def first_calls(quick):
    """Rows: first calls, and which of them are slow."""
    rows = []
    for row in _growth_first_calls.measured(quick):
        rows.append(row)
        yield row
    for cache, limit in (("none", COLD), ("warm", WARM)):
        for kind in _growth_first_calls.KINDS:
            slow = [r["what"] for r in rows if r["cache"] == cache and r[kind] > limit]
            of = sum(r["cache"] == cache for r in rows)
            yield {"cache": cache, "kind": kind, "limit s": limit, "of": of, "slow": len(slow), "names": slow}


PARTS = {
    "batch": batch,
    "contacts": contacts,
    "grid": grid,
    "first_calls": first_calls,
    "memory": _growth_memory.measured,
}
