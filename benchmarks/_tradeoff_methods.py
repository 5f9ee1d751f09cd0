"""The methods in batch, one precision or two, as a user would call them.

Mixed precision is float32 first and float64 again where that is doubtful, or float64 started from float32 everywhere.
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
    Status,
    solve,
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

DOUBTFUL_ERROR = 1e-6
"""A backward error of float32 above this is doubtful."""

DOUBTFUL_CONDITION = 1e3
"""So is a condition number of the active equations above this: float32 keeps four digits up to there."""

PARTS = 16
"""Doubtful lanes are solved again in pieces of this part of the batch, so that one compiled program does."""


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
    began = time.perf_counter()
    method, first = methods[PIVOTING][0], calls[PIVOTING, "float32"]
    again = compiled(method, m, -(-lanes // PARTS), "float64")
    warm = compiled(method, m, lanes, "float64", started=True)
    compilation = time.perf_counter() - began
    for name, call in {
        "again if in doubt": partial(twice, first, again, np.inf),
        "again if ill-conditioned": partial(twice, first, again, DOUBTFUL_CONDITION),
        "float64 from float32": partial(continued, first, warm),
    }.items():
        yield f"{PIVOTING}, {name}", "mixed", lanes, call, compilation


def compiled(method, m, lanes, dtype, started=False):
    """A function from M (lanes, m, m), q (lanes, m) and, if `started`, z (lanes, m) to what the method found."""

    def answers(M, q, *start):
        problem = LCP(M, q)
        answer = solve(problem, method, *start)
        proposed = jnp.matmul(M, answer.attempt, precision=jax.lax.Precision.HIGHEST) + q
        w = jnp.where(answer.answered, answer.w, proposed)
        return Found(answer.attempt, w, answer.status, answer.backward_error, answer.condition)

    shapes = [jax.ShapeDtypeStruct((lanes, *shape), dtype) for shape in ((m, m), (m,)) + ((m,),) * started]
    program = jax.jit(jax.vmap(answers)).lower(*shapes).compile()
    return lambda *data: jax.tree.map(np.asarray, program(*(part.astype(dtype) for part in data)))


def once(call, M, q):
    """One solve of every lane."""
    return call(M, q), 0


def twice(first, again, condition, M, q):
    """float32 first; float64 for the lanes that are not solved, or less well than wanted."""
    M, q = np.asarray(M), np.asarray(q)
    found = jax.tree.map(lambda part: part.astype(np.float64) if part.dtype == np.float32 else part.copy(), first(M, q))
    fine = (found.status == Status.SOLVED) & (found.backward_error <= DOUBTFUL_ERROR) & (found.condition <= condition)
    doubtful = np.flatnonzero(~fine)
    piece = -(-len(q) // PARTS)
    for begin in range(0, len(doubtful), piece):
        lanes = doubtful[begin : begin + piece]
        padded = np.resize(lanes, piece)
        for part, better in zip(found, again(M[padded], q[padded]), strict=True):
            part[lanes] = better[: len(lanes)]
    return found, len(doubtful)


def continued(first, warm, M, q):
    """float64 in every lane, from the answer of float32 where that is finite."""
    M, q = np.asarray(M), np.asarray(q)
    start = first(M, q).z
    return warm(M, q, np.where(np.isfinite(start), start, 0)), len(q)
