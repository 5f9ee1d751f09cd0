"""Compiled kernels for batches on a CPU, where they were built: methods, and what the judge measures.

They are an alternative to code in JAX, never a requirement: the same steps in the same order, with the same statuses.
JAX lowers all loops of a batch to one thread, and short vectors to loops of their own; here a problem stays in the
nearest cache, up to eight contacts are solved several problems to an instruction, and XLA's own threads share a batch.

`reason()` says why there are none. JAXCONTACT_NATIVE=0 in the environment leaves them alone.
"""

import ctypes
import functools
import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxcontact.native.build import library

KERNELS = ("principal", "lemke", "direct", "gauss_seidel", "findings", "condition")

REALS = {"float64": "double", "float32": "float"}

DATA_FINITE, POINT_FINITE = 1, 2
"""Bits of the flags in `findings`."""

_wanted = True


def reason() -> str:
    """Why the kernels are not used on this machine; empty if they are."""
    if os.environ.get("JAXCONTACT_NATIVE") == "0":
        return "JAXCONTACT_NATIVE=0 is set"
    if not _wanted:
        return "inside `native.unused()`"
    if jax.default_backend() != "cpu":
        return f"the default backend is {jax.default_backend()}"
    return _loaded()


def serve(dtype) -> bool:
    """Whether the kernels are here, and take numbers of this dtype.

    >>> serve(jnp.float32)
    """
    return jnp.dtype(dtype).name in REALS and not reason()


@contextmanager
def unused() -> Iterator[None]:
    """Code traced inside uses JAX alone: for tests and measurements of the one against the other.

    >>> with unused(): solve(problem, Lemke())
    """
    global _wanted
    before, _wanted = _wanted, False
    try:
        yield
    finally:
        _wanted = before


class Findings(NamedTuple):
    """What is measured of a point z of an LCP, as in `complementarity.residuals`."""

    w: jax.Array
    """(m,) M z + q"""
    eta: jax.Array
    """backward error"""
    rho: jax.Array
    """residual"""
    active: jax.Array
    """(m,) bool"""
    degenerate: jax.Array
    """(m,) bool"""
    flags: jax.Array
    """int32, bits DATA_FINITE and POINT_FINITE"""


class Answers(NamedTuple):
    """What a method says, and what is measured of it in the same pass over the data."""

    z: jax.Array
    """(m,) >= 0"""
    certificate: jax.Array
    """(m,) as in `complementarity.method.Answer`"""
    outcome: jax.Array
    """int32 `Status`"""
    steps: jax.Array
    """int32"""
    found: Findings


def principal(M, q, wanted, budget: int) -> Answers:
    """Principal pivoting, `complementarity.principal`.

    M (m, m), q (m,); wanted (m,) bool or (0,): rows to make active first. Leading axes are batches here and below.

    >>> principal(jnp.eye(1), -jnp.ones(1), jnp.ones(0, bool), 10).z     # 1
    """
    return _answers(_call("principal", [*_answer_like(q), *_findings_like(q)], M, q, wanted, budget=np.int64(budget)))


def lemke(M, q, covering, budget: int) -> Answers:
    """Lemke's method, `complementarity.lemke`; covering (m,), or (0,) for ones.

    >>> lemke(jnp.eye(1), -jnp.ones(1), jnp.ones(0), 10).outcome     # SOLVED
    """
    return _answers(_call("lemke", [*_answer_like(q), *_findings_like(q)], M, q, covering, budget=np.int64(budget)))


def direct(M, q) -> Answers:
    """Every mode of up to four contacts, `complementarity.direct`, which refuses more.

    >>> direct(jnp.eye(1), -jnp.ones(1)).z     # 1
    """
    return _answers(_call("direct", [*_answer_like(q), *_findings_like(q)], M, q))


def gauss_seidel(M, q, start, sweeps: int, relaxation: float, target: float) -> Answers:
    """Projected Gauss-Seidel, `complementarity.gauss_seidel`; start (m,), or (0,) for zeros.

    A problem rests once its backward error is at most `target`.

    >>> gauss_seidel(jnp.eye(1), -jnp.ones(1), jnp.ones(0), 10, 1.0, 1e-15).z     # 1
    """
    options = {"sweeps": np.int64(sweeps), "relaxation": np.float64(relaxation), "target": np.float64(target)}
    return _answers(_call("gauss_seidel", [*_answer_like(q), *_findings_like(q)], M, q, start, **options))


def findings(M, q, z) -> Findings:
    """`Findings` of a point z (m,) from elsewhere.

    >>> findings(jnp.eye(1), -jnp.ones(1), jnp.ones(1)).eta     # 0
    """
    return Findings(*_call("findings", _findings_like(q), M, q, z))


def condition(M, held):
    """|K| |K^-1| of the balanced mode matrix K = M diag(held) + I diag(1 - held), row-sum norms; inf if singular.

    >>> condition(jnp.eye(2), jnp.ones(2, bool))     # 1
    """
    return _call("condition", _like(M[..., 0, 0]), M, held)


def _answers(results) -> Answers:
    answer = len(Answers._fields) - 1
    return Answers(*results[:answer], Findings(*results[answer:]))


def _answer_like(q):
    number = _like(q[..., 0], jnp.int32)
    return [_like(q), _like(q), number, number]


def _findings_like(q):
    scalar, mask = _like(q[..., 0]), _like(q, bool)
    return [_like(q), scalar, scalar, mask, mask, _like(q[..., 0], jnp.int32)]


def _like(x, dtype=None):
    return jax.ShapeDtypeStruct(x.shape, dtype or x.dtype)


def _call(name, results, *arguments, **attributes):
    target = f"jaxcontact_{name}_{REALS[arguments[0].dtype.name]}"
    return jax.ffi.ffi_call(target, results, vmap_method="broadcast_all")(*arguments, **attributes)


@functools.cache
def _loaded() -> str:
    """Load and register the kernels; what went wrong, or nothing."""
    path = library()
    if not path.exists():
        return "they were not built for this machine; write `jaxcontact kernels --build`"
    try:
        kernels = ctypes.CDLL(str(path))
    except OSError as error:
        return str(error)
    for kernel, real in itertools.product(KERNELS, REALS.values()):
        name = f"jaxcontact_{kernel}_{real}"
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(getattr(kernels, name)), platform="cpu")
    return ""
