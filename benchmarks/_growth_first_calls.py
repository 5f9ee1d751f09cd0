"""First calls, timed in fresh processes: what tracing and compiling cost before the first answer.

Every quantity is timed three times, each time with JAX's own caches cleared: called as it is on what it takes
(operators, a state, a problem); under `jax.jit` from the numbers of the mechanism on, tracing apart from compiling; and
so for a batch of LANES problems, or states, or mechanisms where a state has no coordinate. The persistent compilation
cache has a folder for each, so that nothing is found that another left there. Seconds of the processor stand beside
those of the clock: they are what the clock says on an idle machine, or more, since XLA compiles with several threads.
"""

import gc
import inspect
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

import jaxcontact as jc
from benchmarks import solvers
from jaxcontact.complementarity import LCP, Banach, Direct, Lemke, PrincipalPivoting, ProjectedGaussSeidel, solve
from jaxcontact.mechanisms import all_mechanisms

AT, SPEED, FRICTION = 0.9, 1.0, 0.2
"""Coordinates without a default, the speed of what slides, and its friction."""

METHODS = (Direct(), PrincipalPivoting(), Lemke(), ProjectedGaussSeidel(), Banach())
SIZES = (2, 4, 8)
DIRECT_LIMIT = 4

LANES = 1000

PROBLEMS = "solve"
"""The group of the solvers; the others are mechanisms."""

AS_CALLED, JIT, BATCH = "as called", "jit", "batch"
KINDS = [f"{kind} {clock}" for clock in ("s", "cpu s") for kind in (AS_CALLED, JIT, BATCH)]


def measured(quick):
    """Rows: without the cache (while it is filled), then with it."""
    groups = ["PainleveKlein"] if quick else [*all_mechanisms(), PROBLEMS]
    with tempfile.TemporaryDirectory() as folder:
        for cache in ("none", "warm"):
            for group in groups:
                yield from in_a_process(group, folder, cache, quick)


def in_a_process(group, folder, cache, quick):
    """The rows of one group, by a fresh interpreter."""
    command = [sys.executable, "-m", __name__, group, folder, *["--quick"] * quick]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, stderr=subprocess.DEVNULL) as run:
        for line in run.stdout:
            yield {"cache": cache} | json.loads(line)
    if run.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {run.returncode}")


def quantities(group):
    """{name: (numbers, prepare, quantity)}: quantity(prepare(*numbers)) is what is timed."""
    return of_solvers() if group == PROBLEMS else of_mechanism(group)


def of_mechanism(name):
    """Operators, every bound, all solutions, and forces where it slides."""
    mechanism = all_mechanisms()[name]()
    arguments = inspect.signature(mechanism.state).parameters
    at = {name: AT for name, a in arguments.items() if a.default is inspect.Parameter.empty}
    sliding = at | {"speed": SPEED} if "speed" in arguments else at
    mu = FRICTION * np.array([contact.frictional for contact in mechanism.contacts], float)

    def state(mechanism, at):
        return mechanism, mechanism.state(**at)

    def operators(mechanism, at):
        return jc.delassus(mechanism, mechanism.state(**at))

    made = {"delassus": ((mechanism, at), state, lambda here: jc.delassus(*here))}
    made |= {name: ((mechanism, at), operators, bound) for name, bound in jc.bounds.by_name().items()}
    made["solutions"] = (mechanism, at), operators, lambda here: jc.solutions(here, mu, np.ones_like(mu))
    made["contact_forces"] = (mechanism, sliding), state, lambda here: jc.contact_forces(*here, mu)
    return made


def of_solvers():
    """Every method at every size."""
    made = {}
    for m in SIZES:
        M, q = solvers.problems(m, 1, np.float64)
        for method in METHODS:
            if m <= DIRECT_LIMIT or not isinstance(method, Direct):
                name = f"{type(method).__name__}, {m} contacts"
                made[name] = (M[0], q[0]), LCP, lambda problem, method=method: solve(problem, method)
    return made


def first_call(numbers, prepare, quantity, folder):
    """Seconds until the first answer."""
    numbers = jax.tree.map(jnp.asarray, numbers)
    thing = jax.block_until_ready(prepare(*numbers))
    forget(folder / AS_CALLED)
    began = clocks()
    jax.block_until_ready(quantity(thing))
    stages = {AS_CALLED: clocks() - began}
    stages |= compiled(JIT, lambda *numbers: quantity(prepare(*numbers)), numbers, folder)
    axes = axes_of(numbers)
    many = [x if axis is None else jax.tree.map(stacked, x) for x, axis in zip(numbers, axes, strict=True)]
    stages |= compiled(BATCH, jax.vmap(lambda *numbers: quantity(prepare(*numbers)), axes), many, folder)
    return {f"{stage} s": wall for stage, (wall, _) in stages.items()} | {
        f"{stage} cpu s": cpu for stage, (_, cpu) in stages.items()
    }


def compiled(kind, function, numbers, folder):
    """{kind: seconds, and of tracing and compiling}."""
    forget(folder / kind)
    began = clocks()
    lowered = jax.jit(function).lower(*numbers)
    traced = clocks()
    lowered.compile()
    ended = clocks()
    return {kind: ended - began, f"{kind} tracing": traced - began, f"{kind} compiling": ended - traced}


def stacked(x):
    """The same number in every lane."""
    return jnp.broadcast_to(x, (LANES, *x.shape))


def axes_of(numbers):
    """The batch: all of a problem, the coordinates of a state, or the mechanism where it needs none."""
    _, at = numbers
    if not isinstance(at, dict):
        return 0, 0
    return (None, 0) if at else (0, None)


def clocks():
    """Seconds: of the clock, and of the processor for all threads of this process, which other work changes less."""
    return np.array([time.perf_counter(), time.process_time()])


def forget(folder):
    """Clear what JAX holds in memory; what it compiles from now on is kept in the folder. What earlier calls left is
    put aside, or the garbage collector would go through it within the time of a later one."""
    jax.clear_caches()
    compilation_cache.reset_cache()
    gc.collect()
    gc.freeze()
    jax.config.update("jax_compilation_cache_dir", str(folder))


def main(group, folder, quick):
    """Print a row of JSON for each quantity of the group."""
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jax.block_until_ready(jax.jit(jnp.sin)(1.0))  # starts the backend
    made = quantities(group)
    for name in ("norm_ratio", "critical") if quick else made:
        row = first_call(*made[name], Path(folder) / group / name)
        print(json.dumps({"what": f"{group}: {name}"} | row), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:3], "--quick" in sys.argv)
