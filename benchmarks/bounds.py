"""Friction bounds per second: derived terms through the public API against NumPy, Numba and C, checked, then timed.

One angle per configuration, from 0.05 to 1.5. One contact: `GuidedRod`; two: `PainleveKlein`; more: a chain of hinged
rods with every joint in a rough guide. Ours is `jit(vmap(fused(f, final=True)), compiler_options=compiler_options())`,
as `sweep` does it, and where it says "plain" `jit(vmap(f))`. All of a size are called in turns, so that they share the
machine's moods.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks._bounds_peers import available, by_numpy, couplings
from benchmarks._chain import GuidedChain
from benchmarks._machine import machine
from benchmarks._timing import in_turns
from jaxcontact.linalg import compiler_options, fused

LEAST_ANGLE, GREATEST_ANGLE = 0.05, 1.5

SHARE = {1: 1, 2: 1, 4: 4, 8: 64}
"""The batch is divided by this: the slowest peer needs about a second."""

ROUNDINGS = 64
"""Two programs agree when they differ by this many roundings times the condition of W; slopes, times as many again."""

NEAR_A_KINK = 0.01
"""The share of lanes that may lie next to a kink of the bound, where slopes differ."""

ROUNDS, PATIENCE = 7, 1.0
"""Each program is called ROUNDS times, or fewer: it gets PATIENCE seconds."""

BASE, PLAIN, NUMPY, C = "norm_ratio", ", plain", "numpy", "C loop"

NO_LESS = ("operator_norm", "critical")
"""Other quantities than the bound, which it must not exceed."""

HEADS = "  m  dtype    program                                           batch  million/s  failed  compile s   to value"


def main(argv: list[str]) -> None:
    """Print the table; `--contacts`, `--batch`, `--json FILE`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks bounds", description=__doc__.splitlines()[0])
    parser.add_argument("--contacts", type=int, nargs="+", default=[1, 2, 4, 8], choices=SHARE)
    parser.add_argument("--batch", type=int, default=1_000_000, help="configurations; fewer for 4 and 8 contacts")
    parser.add_argument("--dtypes", nargs="+", default=["float64", "float32"], choices=["float64", "float32"])
    parser.add_argument("--json", metavar="FILE", help="write the measurements to this file")
    options = parser.parse_args(argv)
    jax.config.update("jax_enable_x64", True)
    here, rows = machine(), []
    print(here)
    for m in options.contacts:
        for dtype in options.dtypes:
            print(HEADS + "   to numpy  to C loop")
            rows += measured(m, max(options.batch // SHARE[m], 2), dtype)
    if options.json:
        Path(options.json).write_text(json.dumps({"machine": here, "rows": rows}, indent=1) + "\n")


def mechanism(contacts):
    """The mechanism with this many contacts whose terms `_bounds_peers` states by hand."""
    if contacts > 2:
        return GuidedChain(rods=contacts - 1)
    return jc.mechanisms.GuidedRod() if contacts == 1 else jc.mechanisms.PainleveKlein(gravity=9.81)


def programs(contacts):
    """{name: function of one angle}"""
    guides = mechanism(contacts)

    def of(quantity):
        return lambda theta: quantity(jc.delassus(guides, guides.state(theta=theta)))

    bound = of(jc.bounds.norm_ratio)

    def with_tangent(theta):
        return jax.jvp(bound, (theta,), (jnp.ones_like(theta),))

    functions = {
        BASE: bound,
        "norm_ratio, jvp": with_tangent,
        "norm_ratio, value_and_grad": jax.value_and_grad(bound),
        "operator_norm": of(jc.bounds.operator_norm),
        "critical": of(jc.bounds.critical),
    }
    plain = {f"{name}{PLAIN}": functions[name] for name in (BASE, "norm_ratio, jvp")}
    return {name: fused(f, final=True) for name, f in functions.items()} | plain


def measured(contacts, count, dtype):
    """The rows of one size and dtype, printed."""
    theta = np.random.default_rng(0).uniform(LEAST_ANGLE, GREATEST_ANGLE, count).astype(dtype)
    calls, compilation = {}, {}
    for name, function in programs(contacts).items():
        options = {} if name.endswith(PLAIN) else compiler_options()
        calls[name], compilation[name] = compiled(function, theta, options)
    calls |= {name: lambda call=call: call(theta) for name, call in available(contacts, dtype).items()}
    results = {name: jax.tree.map(np.asarray, call()) for name, call in calls.items()}
    refuse_disagreement(contacts, theta, results)
    seconds = in_turns(calls, PATIENCE, ROUNDS)
    rates = {name: count / s for name, s in seconds.items()}
    numpy = next(rate for name, rate in rates.items() if name.startswith(NUMPY))
    c = next((rate for name, rate in rates.items() if name.startswith(C)), np.nan)
    return [
        shown(
            {
                "contacts": contacts,
                "dtype": dtype,
                "program": name,
                "batch": count,
                "per_second": rate,
                "failed": int(np.isnan(np.stack(jax.tree.leaves(results[name]))).any(axis=0).sum()),
                "compile_seconds": compilation.get(name),
                "to_value": rate / rates[BASE],
                "to_numpy": rate / numpy,
                "to_c": rate / c,
            }
        )
        for name, rate in rates.items()
    ]


def compiled(function, theta, options):
    """(call without arguments, seconds of tracing and compiling)"""
    theta = jnp.asarray(theta)
    began = time.perf_counter()
    program = jax.jit(jax.vmap(function)).lower(theta).compile(options)
    return lambda: jax.block_until_ready(program(theta)), time.perf_counter() - began


def refuse_disagreement(contacts, theta, results):
    """Raise ValueError where a bound is not NumPy's in float64, `critical` is less, or a slope is not the difference
    quotient's."""
    theta, eps = theta.astype(np.float64), float(np.finfo(theta.dtype).eps)
    expected = by_numpy(theta, contacts)
    sizes = np.linalg.svd(couplings(theta, contacts)[0], compute_uv=False)
    rounding = ROUNDINGS * eps * sizes[:, 0] / sizes[:, -1]
    step = np.finfo(np.float64).eps ** (1 / 3)
    slope = (by_numpy(theta + step, contacts) - by_numpy(theta - step, contacts)) / (2 * step)
    for name, found in results.items():
        value = found[0] if isinstance(found, tuple) else found
        error = (expected - value) / expected
        wrong = (error if name in NO_LESS else abs(error)) > rounding
        if wrong.any():
            worst = abs(error[wrong]).max()
            raise ValueError(f"{name}, {contacts} contacts: {wrong.sum()} lanes off by up to {worst:.1e}")
        if isinstance(found, tuple):
            off = abs(found[1] - slope) > ROUNDINGS * (rounding + step) * (abs(slope) + expected)
            if not np.mean(off) <= NEAR_A_KINK:
                raise ValueError(f"{name}, {contacts} contacts: {np.mean(off):.1%} of the slopes are off")


def shown(r):
    """The record, printed."""
    waited = "        -" if r["compile_seconds"] is None else f"{r['compile_seconds']:9.2f}"
    print(
        f"{r['contacts']:3d}  {r['dtype']:8} {r['program']:44} {r['batch']:10d}  {r['per_second'] / 1e6:9.3f}"
        f"  {r['failed']:6d}  {waited}  {r['to_value']:9.3f}  {r['to_numpy']:9.2f}  {r['to_c']:9.3f}",
        flush=True,
    )
    return r
