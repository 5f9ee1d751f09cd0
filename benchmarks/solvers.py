"""Solves per second, failures and residuals of every method for one to sixty-four contacts, beside peers.

`python -m benchmarks solvers --sizes 1 2 4 8 --json solvers.json`. Problems are sliding contacts at half the friction
where the matrix first fails to be positive definite, the same for every method. Compilation is timed apart. Peers
(QuantEcon, Drake, Siconos) are measured where they are installed; they work in float64. Methods with a compiled kernel
are measured with and without it.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks._machine import machine
from benchmarks._peers import available
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
"""A time is the median of as many runs as fit in so many seconds, at least one: what a sweep sees, with threads and
memory at hand."""

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
            for name, (method, largest) in METHODS.items():
                if m > largest:
                    continue
                rows.append(shown(measured(name, method, M, q)))
                if native.serve(dtype) and hasattr(method, "compiled"):
                    with native.unused():
                        rows.append(shown(measured(name + ALONE, method, M, q)))
            if dtype is np.float64:
                rows += [shown(measured_peer(name, loop, M, q)) for name, loop in peers.items()]
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


def measured(name, method, M, q):
    """One row of the table: rates in problems per second, residuals over all lanes, failed ones included."""

    def answers(M, q):
        answer = solve(LCP(M, q), method)
        return answer.attempt, answer.status, answer.residual

    M, q = jnp.asarray(M), jnp.asarray(q)
    batch = jax.jit(jax.vmap(answers))
    began = time.perf_counter()
    compiled = batch.lower(M, q).compile()
    compilation = time.perf_counter() - began
    (_, status, residual), seconds = timed(lambda: jax.block_until_ready(compiled(M, q)))
    return row(name, M, seconds, np.mean(np.asarray(status) != Status.SOLVED), residual, compilation)


def measured_peer(name, loop, M, q):
    """One row for a solver of somebody else: `failed` is what it says of itself, the residual is ours."""
    began = time.perf_counter()
    loop(M[:1], q[:1])  # compiled here, where it is
    compilation = time.perf_counter() - began
    (z, solved), seconds = timed(lambda: loop(M, q))
    w = np.einsum("bij,bj->bi", M, z) + q
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    residual = np.abs(np.minimum(diagonal * z, w)).max(axis=1) / np.abs(q).max(axis=1)
    return row(name, M, seconds, np.mean(~solved), residual, compilation)


def timed(run):
    """(result, median seconds) after one run that does not count."""
    result, times = run(), []
    while sum(times) < PATIENCE:
        began = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - began)
    return result, float(np.median(times))


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
