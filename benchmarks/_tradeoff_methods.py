"""The methods in batch, one precision or two, as a user would call them.

Mixed precision is float32 first and float64 again where that is doubtful (`solve_in_two_precisions`), or float64
started from float32 everywhere.
"""

import time
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxcontact.complementarity import (
    LCP,
    Banach,
    Direct,
    Lemke,
    PrincipalPivoting,
    ProjectedGaussSeidel,
    solve,
    solve_in_two_precisions,
)

PIVOTING = "principal pivoting"

METHODS = {
    "direct": (Direct(), 4),
    PIVOTING: (PrincipalPivoting(), 64),
    "lemke": (Lemke(), 64),
    **{f"gauss-seidel {n}": (ProjectedGaussSeidel(sweeps=n), 64) for n in (10, 50, 200, 1000)},
    **{f"banach {n}": (Banach(iterations=n), 8) for n in (50, 1000)},
}
"""Name, method and the largest size at which it is worth waiting for."""

ACCURACY = 1e-3
"""A lane whose answer in float32 may be wrong by more than this is ill-conditioned."""


class Found(NamedTuple):
    """What a method found, lane by lane."""

    z: np.ndarray
    w: np.ndarray
    status: np.ndarray
    backward_error: np.ndarray
    condition: np.ndarray


def programs(m, lanes, methods):
    """Yields name, dtype, lanes, function (M, q) -> (Found, how many were solved again), seconds to compile."""
    calls = {}
    for name, (method, largest) in methods.items():
        if m <= largest:
            for dtype in ("float64", "float32"):
                began = time.perf_counter()
                calls[name, dtype] = compiled(method, m, lanes, dtype)
                yield name, dtype, lanes, partial(once, calls[name, dtype]), time.perf_counter() - began
    method, first = methods[PIVOTING][0], calls[PIVOTING, "float32"]
    for name, accuracy in {"again if in doubt": np.inf, "again if ill-conditioned": ACCURACY}.items():
        began = time.perf_counter()
        call = twice(method, m, lanes, accuracy)
        yield f"{PIVOTING}, {name}", "mixed", lanes, call, time.perf_counter() - began
    began = time.perf_counter()
    warm = compiled(method, m, lanes, "float64", started=True)
    call = partial(continued, first, warm)
    yield f"{PIVOTING}, float64 from float32", "mixed", lanes, call, time.perf_counter() - began


def compiled(method, m, lanes, dtype, started=False):
    """A function from M (lanes, m, m), q (lanes, m) and, if `started`, z (lanes, m) to what the method found."""

    def answers(M, q, *start):
        return found_of(M, q, solve(LCP(M, q), method, *start))

    shapes = [jax.ShapeDtypeStruct((lanes, *shape), dtype) for shape in ((m, m), (m,)) + ((m,),) * started]
    program = jax.jit(jax.vmap(answers)).lower(*shapes).compile()
    return lambda *data: jax.tree.map(np.asarray, program(*(part.astype(dtype) for part in data)))


def twice(method, m, lanes, accuracy):
    """A function (M, q) -> (Found, how many were solved again): float32, and float64 where that is in doubt."""

    def answers(M, q):
        solution, redone = solve_in_two_precisions(LCP(M, q), method, accuracy=accuracy)
        return found_of(M, q, solution), redone

    shapes = [jax.ShapeDtypeStruct((lanes, *shape), "float64") for shape in ((m, m), (m,))]
    program = jax.jit(jax.vmap(answers)).lower(*shapes).compile()

    def call(M, q):
        found, redone = jax.tree.map(np.asarray, program(M, q))
        return found, int(redone.sum())

    return call


def found_of(M, q, answer):
    """`Found` of a solution; what failed with what it proposes."""
    proposed = jnp.matmul(M, answer.attempt, precision=jax.lax.Precision.HIGHEST) + q
    w = jnp.where(answer.answered, answer.w, proposed)
    return Found(answer.attempt, w, answer.status, answer.backward_error, answer.condition)


def once(call, M, q):
    """One solve of every lane."""
    return call(M, q), 0


def continued(first, warm, M, q):
    """float64 in every lane, from the answer of float32 where that is finite."""
    M, q = np.asarray(M), np.asarray(q)
    start = first(M, q).z
    return warm(M, q, np.where(np.isfinite(start), start, 0)), len(q)
