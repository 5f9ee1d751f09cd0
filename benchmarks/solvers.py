"""Solves per second, failures and worst residual of every method for one to sixty-four contacts, beside peers.

`python -m benchmarks solvers --sizes 1 2 4 8 --json solvers.json`. Problems are sliding contacts at half the friction
where the matrix first fails to be positive definite, the same for every method. Compilation is timed apart.
"""

import argparse
import importlib.util
import json
import time

import jax
import jax.numpy as jnp
import numpy as np

from jaxcontact.complementarity import LCP, Banach, Direct, Lemke, ProjectedGaussSeidel, Status, solve

METHODS = {
    "direct": (Direct(), 2),
    "lemke": (Lemke(), 64),
    "gauss-seidel 50": (ProjectedGaussSeidel(sweeps=50), 64),
    "gauss-seidel 1000": (ProjectedGaussSeidel(sweeps=1000), 8),
    "banach 200": (Banach(iterations=200), 8),
}
"""Name, method and the largest size at which it is worth waiting for."""

WORK = 2**20
"""The batch holds about WORK / m^3 problems, between the two limits below."""

LEAST, MOST = 64, 65536

REPEATS = 5
"""The median of this many runs is reported."""


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

    batch = jax.jit(jax.vmap(answers))
    began = time.perf_counter()
    compiled = batch.lower(M, q).compile()
    compilation = time.perf_counter() - began
    _, status, residual = jax.block_until_ready(compiled(M, q))
    seconds = median_seconds(lambda: jax.block_until_ready(compiled(M, q)))
    return row(name, M, seconds, np.mean(np.asarray(status) != Status.SOLVED), residual, compilation)


def measured_quantecon(M, q):
    """QuantEcon's lcp_lemke, one problem after another, if it is installed."""
    from quantecon.optimize import lcp_lemke

    M, q = np.asarray(M, float), np.asarray(q, float)
    lcp_lemke(M[0], q[0])  # numba compiles here
    results = [lcp_lemke(*data) for data in zip(M, q, strict=True)]
    seconds = median_seconds(lambda: [lcp_lemke(*data) for data in zip(M, q, strict=True)])
    z = np.array([result.z for result in results])
    w = np.einsum("bij,bj->bi", M, z) + q
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    residual = np.abs(np.minimum(diagonal * z, w)).max(axis=1) / np.abs(q).max(axis=1)
    return row("quantecon", M, seconds, np.mean([not result.success for result in results]), residual, 0.0)


def median_seconds(run):
    """The median wall time of REPEATS runs."""
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


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


def main(argv: list[str]) -> None:
    """Print the table; `--sizes`, `--json FILE`."""
    parser = argparse.ArgumentParser(prog="benchmarks solvers", description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 2, 3, 4, 8, 16, 32, 64])
    parser.add_argument("--json", metavar="FILE")
    options = parser.parse_args(argv)
    jax.config.update("jax_enable_x64", True)
    rows = []
    heads = "  m  dtype    method              solves/s   failed   rho 99%    rho max  compile s"
    print(heads)
    for m in options.sizes:
        for dtype in (np.float64, np.float32):
            M, q = map(jnp.asarray, problems(m, int(np.clip(WORK // m**3, LEAST, MOST)), dtype))
            fitting = [(name, method) for name, (method, largest) in METHODS.items() if m <= largest]
            found = [measured(name, method, M, q) for name, method in fitting]
            if dtype is np.float64 and importlib.util.find_spec("quantecon"):
                found.append(measured_quantecon(M, q))
            for r in found:
                print(
                    f"{m:3d}  {r['dtype']:8} {r['method']:18} {r['per_second']:9.3g}  {r['failed']:7.4f}"
                    f"  {r['residual_99_percent']:8.1e}  {r['residual_worst']:8.1e}  {r['compile_seconds']:9.2f}"
                )
            rows += found
    if options.json:
        with open(options.json, "w") as file:
            json.dump(rows, file, indent=1)
