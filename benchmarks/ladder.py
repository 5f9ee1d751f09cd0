"""The ladder of friction bounds: how tight each rung is, and what it costs; an atlas of critical friction in batch."""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks._ladder_picture import draw_ladder
from benchmarks._machine import machine
from jaxcontact import atlas as maps
from jaxcontact import bounds
from jaxcontact.bounds.critical import count_of_vertices

BILATERAL = ("norm_ratio", "operator_norm", "perron", "best_scaling")
ANY = ("direct", "sharper_direct", "positive_definite_radius")
ATLAS_CONTACTS = (2, 4, 8)
LARGEST_SIGNATURES = 2**8
"""`positive_definite_radius` is measured up to this many signatures; it enumerates them as `critical` does."""

SINGLE = (2, 4)
"""Numbers of contacts that are measured in float32 too: its times, and that the shares are the same."""

PATIENCE = 2.0
"""A time is the least of several runs, as many as fit in this many seconds, at most REPEATS."""
REPEATS = 5


def main(arguments: list[str]) -> None:
    """`python -m benchmarks ladder --contacts 1 2 3 --batch 1000 --json ladder.json --picture ladder.png`"""
    parser = argparse.ArgumentParser(prog="python -m benchmarks ladder", description=__doc__)
    parser.add_argument("--contacts", type=int, nargs="+", default=list(range(1, 11)), help="numbers of contacts")
    parser.add_argument("--batch", type=int, default=4096, help="random systems; fewer from 4 contacts on")
    parser.add_argument(
        "--exact", type=int, default=3**6, help="beyond this many vertices bracket instead of `critical`"
    )
    parser.add_argument("--atlas", type=int, default=64, help="points along each axis of the atlas; 0: none")
    parser.add_argument("--json", metavar="FILE", help="write the measurements to this file")
    parser.add_argument("--read", metavar="FILE", help="measure nothing, take this file")
    parser.add_argument("--picture", metavar="FILE", help="draw tightness over cost")
    given = parser.parse_args(arguments)
    measured = json.loads(Path(given.read).read_text()) if given.read else measure(given)
    if given.json:
        Path(given.json).write_text(json.dumps(measured, indent=1) + "\n")
    if given.picture:
        maps.save(draw_ladder(measured), given.picture)


def measure(given: argparse.Namespace) -> dict:
    """{"machine", "rows", "atlas"}, printed as it comes."""
    jax.config.update("jax_enable_x64", True)
    here = machine()
    print(here, flush=True)
    started, rows = time.perf_counter(), []
    for m in given.contacts:
        batch = max(given.batch >> 2 * min(max(m - 3, 0), 2), 1)
        for dtype in (np.float64, np.float32) if m in SINGLE else (np.float64,):
            for kind in ("bilateral", "unilateral"):
                rows += ladder(kind, m, batch, dtype, given.exact)
    maps_of_contacts = [atlas(m, given.atlas) for m in ATLAS_CONTACTS] if given.atlas else []
    print(f"{time.perf_counter() - started:.0f} s")
    return {"machine": here, "rows": rows, "atlas": maps_of_contacts}


def ladder(kind: str, m: int, batch: int, dtype, most: int) -> list[dict]:
    """Every rung over the exact threshold on random systems of m contacts, and its time."""
    contacts = tuple(jc.Contact(str(i), kind, True) for i in range(m))
    factors = random_factors(m, batch, dtype)
    few = count_of_vertices(operators(*(part[0] for part in factors), contacts)) <= most
    rungs = {name: bounds.by_name()[name] for name in (BILATERAL if kind == "bilateral" else ANY)}
    if 2**m > LARGEST_SIGNATURES:
        rungs.pop("positive_definite_radius", None)
    rungs |= {"critical": bounds.critical} if few else {"bracket": bracket_ends}
    results = {name: timed(bound, contacts, factors) for name, bound in rungs.items()}
    if few:
        reference = results["critical"][0]
    else:
        (lower, reference), *times = results["bracket"][0].T, *results["bracket"][1:]
        results["bracket"] = (lower, *times)
    lost = np.isfinite(reference)  # uniqueness is lost somewhere
    return [
        row(kind, m, dtype, name, values[lost] / reference[lost], few, *times)
        for name, (values, *times) in results.items()
    ]


def bracket_ends(here: jc.Delassus) -> jax.Array:
    """(2,) the ends of `critical_bracket`."""
    ends = bounds.critical_bracket(here)
    return jnp.stack([ends.lower, ends.upper])


def row(kind, m, dtype, name, share, exact, microseconds, compilation) -> dict:
    """A record of one measurement, printed."""
    record = {
        "kind": kind,
        "contacts": m,
        "dtype": np.dtype(dtype).name,
        "bound": name,
        "systems": len(share),
        "share of": "critical" if exact else "upper end of the bracket",
        "least": float(share.min()),
        "lowest percent": float(np.quantile(share, 0.01)),
        "median": float(np.median(share)),
        "99th percentile": float(np.quantile(share, 0.99)),
        "us per configuration": microseconds,
        "compile s": compilation,
    }
    print(
        "{kind:<11}{contacts:>3} {dtype:8} {bound:<25} median {median:6.4f}  1 % {lowest percent:6.4f}  "
        "99 % {99th percentile:6.4f}  {us per configuration:10.2f} us  compile {compile s:6.1f} s"
        "  of {share of}".format(**record),
        flush=True,
    )
    return record


def atlas(m: int, points: int) -> dict:
    """Critical friction over two parameters of a rail with m contacts: configurations per second."""
    contacts = tuple(jc.Contact(str(i), "bilateral", True) for i in range(m))
    offset, spread = jnp.meshgrid(jnp.linspace(0.1, 1.0, points), jnp.linspace(0.5, 2.0, points))

    def at(offset, spread):
        N, T = rail(m, offset, spread)
        return bounds.critical(operators(N, T, contacts))

    arguments = offset.ravel(), spread.ravel()
    compiled = jax.jit(jax.vmap(at)).lower(*arguments).compile()
    answered = float(np.isfinite(compiled(*arguments)).mean())
    record = {
        "contacts": m,
        "configurations": points * points,
        "answered": answered,
        "configurations per second": points * points / best_time(compiled, *arguments),
    }
    print("atlas of {contacts} contacts: {configurations per second:,.0f} configurations per second".format(**record))
    return record


def rail(m: int, offset, spread):
    """Whitened factors of an elastic carriage on m shoes: heave, pitch and one bending mode for each further shoe."""
    places = spread * jnp.linspace(-1.0, 1.0, m)
    modes = jnp.arange(m, dtype=places.dtype)
    N = jnp.cos(0.5 * jnp.pi * modes[:, None] * (1 + places[None, :] / 2.2)) / (1 + modes[:, None])
    T = offset * jnp.sin(0.5 * jnp.pi * modes[:, None] * (1 + places[None, :] / 2.2)) / (1 + modes[:, None])
    return N, T


def random_factors(m: int, batch: int, dtype) -> tuple[jax.Array, jax.Array]:
    """(N, T), each (batch, m + 1, m), standard normal, reproducible."""
    N, T = np.random.default_rng(m).normal(size=(2, batch, m + 1, m))
    return jnp.asarray(N, dtype), jnp.asarray(T, dtype)


def operators(N, T, contacts) -> jc.Delassus:
    """Delassus operators that are their factors."""
    return jc.Delassus(N=N, T=T, w=jnp.zeros(N.shape[1], N.dtype), L=None, terms=None, contacts=contacts)


def timed(bound, contacts, factors) -> tuple[np.ndarray, float, float]:
    """(values, microseconds per configuration, seconds to compile)."""
    start = time.perf_counter()
    compiled = jax.jit(jax.vmap(lambda N, T: bound(operators(N, T, contacts)))).lower(*factors).compile()
    compilation = time.perf_counter() - start
    values = np.asarray(compiled(*factors), float)
    return values, 1e6 * best_time(compiled, *factors) / len(values), compilation


def best_time(compiled, *arguments) -> float:
    """The shortest of several runs, s."""
    times = []
    while len(times) < REPEATS and sum(times) < PATIENCE:
        start = time.perf_counter()
        jax.block_until_ready(compiled(*arguments))
        times.append(time.perf_counter() - start)
    return min(times)
