"""Solves per second, failures and residuals of every method for one to sixty-four contacts, beside peers.

`python -m benchmarks solvers --sizes 1 2 4 8 --json solvers.json`. Problems are sliding contacts at half the friction
where the matrix first fails to be positive definite, the same for every method. Compilation is timed apart. Peers
(QuantEcon, Drake, Siconos) are measured where they are installed; they work in float64. Methods with a compiled kernel
are measured with and without it.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks._machine import machine
from benchmarks._peers import available
from benchmarks._timing import in_turns
from jaxcontact import native
from jaxcontact.complementarity import (
    LCP,
    Banach,
    Direct,
    Lemke,
    PrincipalPivoting,
    ProjectedGaussSeidel,
    Status,
    solve,
)

METHODS = {
    "direct": (Direct(), 4),
    "principal pivoting": (PrincipalPivoting(), 64),
    "lemke": (Lemke(), 64),
    "gauss-seidel 10": (ProjectedGaussSeidel(sweeps=10), 64),
    "gauss-seidel 50": (ProjectedGaussSeidel(sweeps=50), 64),
    "gauss-seidel 320": (ProjectedGaussSeidel(sweeps=320), 8),
    "banach 200": (Banach(iterations=200), 8),
}
"""Name, method and the largest size at which it is worth waiting for."""

SIZES = (1, 2, 4, 8, 16, 32, 64)

ALONE = ", JAX alone"
"""What is added to the name of a method that is measured without the compiled kernels too."""

WORK = 2**22
"""The batch holds WORK / m^2 problems, between the two limits below."""

LEAST, MOST = 256, 100_000

PATIENCE = 0.7
"""A time is the median of as many runs as fit in so many seconds, at least one, taken in turns: what a sweep sees, with
threads and memory at hand."""

HEADS = "  m  dtype    method                                 batch   solves/s   failed   rho 99%    rho max  compile s"


def main(argv: list[str]) -> None:
    """Print the table; `--sizes`, `--work`, `--json FILE`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks solvers", description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of contacts")
    parser.add_argument("--work", type=int, default=WORK, help="the batch holds about this / m^2 problems")
    parser.add_argument("--json", metavar="FILE", help="write the measurements to this file")
    options = parser.parse_args(argv)
    jax.config.update("jax_enable_x64", True)
    here, peers, rows = machine(), available(), []
    print(here)
    print(HEADS)
    for m in options.sizes:
        count = int(np.clip(options.work // m**2, min(LEAST, options.work), MOST))
        for dtype in (np.float64, np.float32):
            M, q = problems(m, count, dtype)
            methods = {name: method for name, (method, largest) in METHODS.items() if m <= largest}
            rows += measured(methods, peers if dtype is np.float64 else {}, M, q)
    if options.json:
        Path(options.json).write_text(json.dumps({"machine": here, "rows": rows}, indent=1) + "\n")


def problems(m, count, dtype, seed=0):
    """Stacked M (count, m, m), q (count, m): W - Wt diag(mu xi) with positive definite symmetric part."""
    rng = np.random.default_rng(seed)
    N, T = rng.normal(size=(2, count, m + 2, m))
    W, Y = N.swapaxes(1, 2) @ N, N.swapaxes(1, 2) @ T * rng.choice([-1.0, 1.0], (count, 1, m))
    inverse = np.linalg.inv(np.linalg.cholesky(W))
    largest = np.linalg.eigvalsh(inverse @ (Y + Y.swapaxes(1, 2)) @ inverse.swapaxes(1, 2) / 2)[:, -1]
    mu = 0.5 / np.maximum(largest, 1e-3)
    return (W - mu[:, None, None] * Y).astype(dtype), rng.normal(size=(count, m)).astype(dtype)


def measured(methods, peers, M, q, alone=True):
    """Rows of methods {name: method} and of peers {name: function of (M, q)}, called in turns; alone: those with a
    compiled kernel also without it."""
    runs = {}
    for name, method in methods.items():
        runs[name] = ours(method, M, q)
        if alone and native.serve(M.dtype) and hasattr(method, "compiled"):
            with native.unused():
                runs[name + ALONE] = ours(method, M, q)
    runs |= {name: theirs(loop, M, q) for name, loop in peers.items()}
    seconds = in_turns({name: run.call for name, run in runs.items()}, PATIENCE)
    return [shown(row(name, M, seconds[name], *run[1:])) for name, run in runs.items()]


class Run(NamedTuple):
    """What is timed, and what its first run showed."""

    call: Callable
    failed: float
    """share of the problems that it says it did not solve"""
    residual: np.ndarray
    """rho of every problem, failed ones included"""
    compilation: float
    """seconds"""


def ours(method, M, q):
    """The `Run` of a method of ours."""

    def answers(M, q):
        answer = solve(LCP(M, q), method)
        return answer.attempt, answer.status, answer.residual

    M, q = jnp.asarray(M), jnp.asarray(q)
    began = time.perf_counter()
    compiled = jax.jit(jax.vmap(answers)).lower(M, q).compile()
    compilation = time.perf_counter() - began
    _, status, residual = compiled(M, q)
    failed = np.mean(np.asarray(status) != Status.SOLVED)
    return Run(lambda: jax.block_until_ready(compiled(M, q)), failed, np.asarray(residual), compilation)


def theirs(loop, M, q):
    """That of a solver of somebody else: `failed` is what it says of itself, the residual is ours."""
    began = time.perf_counter()
    loop(M[:1], q[:1])  # compiled here, where it is
    compilation = time.perf_counter() - began
    z, solved = loop(M, q)
    w = np.einsum("bij,bj->bi", M, z) + q
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    residual = np.abs(np.minimum(diagonal * z, w)).max(axis=1) / np.abs(q).max(axis=1)
    return Run(lambda: loop(M, q), np.mean(~solved), residual, compilation)


def row(name, M, seconds, failed, residual, compilation):
    """A record of one measurement."""
    residual = np.asarray(residual, float)
    return {
        "method": name,
        "contacts": M.shape[-1],
        "dtype": str(M.dtype),
        "batch": len(M),
        "per_second": len(M) / seconds,
        "failed": float(failed),
        "residual_99_percent": float(np.quantile(residual, 0.99)),
        "residual_worst": float(residual.max()),
        "compile_seconds": compilation,
    }


def shown(r):
    """The record, printed."""
    print(
        f"{r['contacts']:3d}  {r['dtype']:8} {r['method']:36} {r['batch']:7d}  {r['per_second']:9.3g}"
        f"  {r['failed']:7.4f}  {r['residual_99_percent']:8.1e}  {r['residual_worst']:8.1e}"
        f"  {r['compile_seconds']:9.2f}",
        flush=True,
    )
    return r
