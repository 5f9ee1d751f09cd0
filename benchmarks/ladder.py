"""The ladder of friction bounds: how tight each rung is, and what it costs; an atlas of critical friction in batch."""

import argparse
import json
import time

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from jaxcontact import bounds

BILATERAL = ("norm_ratio", "operator_norm", "perron", "best_scaling", "critical")
ANY = ("direct", "sharper_direct", "positive_definite_radius", "critical")
ATLAS_CONTACTS = (2, 4, 8)


def main(arguments: list[str]) -> None:
    """`python -m benchmarks ladder --contacts 1 2 3 --batch 1000 --json ladder.json`"""
    parser = argparse.ArgumentParser(prog="benchmarks ladder", description=__doc__)
    parser.add_argument("--contacts", type=int, nargs="+", default=list(range(1, 11)), help="numbers of contacts")
    parser.add_argument(
        "--batch", type=int, default=1000, help="random systems of each size, halved per contact from 6"
    )
    parser.add_argument("--atlas", type=int, default=64, help="points along each axis of the atlas; 0: none")
    parser.add_argument("--double", action="store_true", help="float64 instead of float32")
    parser.add_argument("--json", help="write the rows to this file")
    given = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", given.double)
    rows = [row for m in given.contacts for row in ladder(m, max(given.batch >> max(m - 5, 0), 1))]
    if given.atlas:
        rows += [atlas(m, given.atlas) for m in ATLAS_CONTACTS]
    if given.json:
        with open(given.json, "w") as file:
            json.dump(rows, file, indent=1)


def ladder(m: int, batch: int) -> list[dict]:
    """Every rung over the exact threshold on random systems of m contacts, and its time."""
    rows = []
    for kind, names in (("bilateral", BILATERAL), ("unilateral", ANY)):
        contacts = tuple(jc.Contact(str(i), kind, True) for i in range(m))
        factors = random_factors(m, batch)
        results = {name: measured(bounds.by_name()[name], contacts, factors) for name in names}
        exact = results["critical"][0]
        for name, (values, seconds, compile_seconds) in results.items():
            tight = (values / exact)[np.isfinite(exact)]
            rows.append(
                {
                    "kind": kind,
                    "contacts": m,
                    "bound": name,
                    "median": float(np.median(tight)),
                    "lowest percent": float(np.quantile(tight, 0.01)),
                    "99th percentile": float(np.quantile(tight, 0.99)),
                    "highest": float(tight.max()),
                    "us per configuration": 1e6 * seconds / batch,
                    "compile s": compile_seconds,
                }
            )
            print(
                "{kind:<11}{contacts:>3}  {bound:<26}median {median:7.4f}  1 % {lowest percent:7.4f}  99 % "
                "{99th percentile:7.4f}  {us per configuration:10.2f} us  compile {compile s:6.1f} s".format(
                    **rows[-1]
                ),
                flush=True,
            )
    return rows


def atlas(m: int, points: int) -> dict:
    """Critical friction over two parameters of a rail with m contacts: configurations per second."""
    contacts = tuple(jc.Contact(str(i), "bilateral", True) for i in range(m))
    offset, spread = jnp.meshgrid(jnp.linspace(0.1, 1.0, points), jnp.linspace(0.5, 2.0, points))

    def at(offset, spread):
        N, T = rail(m, offset, spread)
        return bounds.critical(operators(N, T, contacts))

    compiled = jax.jit(jax.vmap(at)).lower(offset.ravel(), spread.ravel()).compile()
    seconds = best_time(compiled, offset.ravel(), spread.ravel())
    row = {"kind": "atlas", "contacts": m, "configurations per second": points * points / seconds}
    print("atlas of {contacts} contacts: {configurations per second:,.0f} configurations per second".format(**row))
    return row


def rail(m: int, offset, spread):
    """Whitened factors of an elastic carriage on m shoes: heave, pitch and one bending mode for each further shoe."""
    places = spread * jnp.linspace(-1.0, 1.0, m)
    modes = jnp.arange(m, dtype=places.dtype)
    N = jnp.cos(0.5 * jnp.pi * modes[:, None] * (1 + places[None, :] / 2.2)) / (1 + modes[:, None])
    T = offset * jnp.sin(0.5 * jnp.pi * modes[:, None] * (1 + places[None, :] / 2.2)) / (1 + modes[:, None])
    return N, T


def random_factors(m: int, batch: int) -> tuple[jax.Array, jax.Array]:
    """(N, T), each (batch, m + 1, m), standard normal, reproducible."""
    N, T = np.random.default_rng(m).normal(size=(2, batch, m + 1, m))
    return jnp.asarray(N, float), jnp.asarray(T, float)


def operators(N, T, contacts) -> jc.Delassus:
    """Delassus operators that are their factors."""
    return jc.Delassus(N=N, T=T, w=jnp.zeros(N.shape[1], N.dtype), L=None, terms=None, contacts=contacts)


def measured(bound, contacts, factors) -> tuple[np.ndarray, float, float]:
    """(values, seconds for the batch, seconds to compile)."""
    start = time.perf_counter()
    compiled = jax.jit(jax.vmap(lambda N, T: bound(operators(N, T, contacts)))).lower(*factors).compile()
    compile_seconds = time.perf_counter() - start
    return np.asarray(compiled(*factors), float), best_time(compiled, *factors), compile_seconds


def best_time(compiled, *arguments, repeats: int = 3) -> float:
    """The shortest of several runs, s."""
    jax.block_until_ready(compiled(*arguments))
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*arguments))
        times.append(time.perf_counter() - start)
    return min(times)
