"""Compiled kernels for batches on a CPU, where they were built: methods, and what the judge measures.

They are an alternative to code in JAX, never a requirement: the same steps in the same order, with the same statuses,
but that rows of a few contacts take turns in principal pivoting.
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

KERNELS = ("principal", "lemke", "direct", "gauss_seidel", "measure", "classify", "condition", "pairs")

REALS = {"float64": "double", "float32": "float"}

DATA_FINITE, POINT_FINITE, PROVED, SMALL, TELLING, CLOSE, MODERATE = 1, 2, 4, 16, 32, 64, 128
"""Bits of the flags: the data are finite, the point is; the certificate excludes a feasible point; eta is small, rho
telling, eta close, the condition moderate, as `complementarity.bars` says. A certificate is looked at where eta
and rho are not small, the condition where eta is and rho does not tell."""

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


class Measures(NamedTuple):
    """What is measured of a point z of a problem, as in `complementarity.residuals`."""

    eta: jax.Array
    """backward error"""
    rho: jax.Array
    """residual"""
    flags: jax.Array
    """int32, the bits above"""


class Classes(NamedTuple):
    """The slacks of an LCP at a point z, and which of its pairs press."""

    w: jax.Array
    """(m,) M z + q"""
    active: jax.Array
    """(m,) bool"""
    degenerate: jax.Array
    """(m,) bool"""


class Judged(NamedTuple):
    """What is said of an answer."""

    eta: jax.Array
    """backward error"""
    rho: jax.Array
    """residual"""
    status: jax.Array
    """int32 `Status`, by the truth table of `complementarity.judge`"""


class Answers(NamedTuple):
    """What a method says, judged in the same pass over the data."""

    z: jax.Array
    """(m,) >= 0"""
    certificate: jax.Array
    """(m,) as in `complementarity.method.Answer`, or (0,) where it is not asked for"""
    steps: jax.Array
    """int32"""
    judged: Judged
    """where the certificate is asked for, its `status` is the outcome that the method claims, not judged"""


class Pairs(NamedTuple):
    """The best candidate of one or two pairs in horizontal form, and all that the judge asks of it."""

    z: jax.Array
    """(m,) >= 0"""
    w: jax.Array
    """(m,) >= 0, zero where z is not"""
    condition: jax.Array
    """of the equations of its mode, inf if they are singular"""
    active: jax.Array
    """(m,) bool"""
    degenerate: jax.Array
    """(m,) bool"""
    judged: Judged


def principal(M, q, wanted, budget: int, certified: bool = False) -> Answers:
    """Principal pivoting, `complementarity.principal`.

    M (m, m), q (m,); wanted (m,) bool or (0,): rows to make active first; certified: the certificate and the method's
    own outcome are given, to be judged elsewhere. Leading axes are batches here and below. Up to eight contacts without
    `wanted` the rows take turns, as then several problems pivot the same row at once; what that does not solve is
    solved as in JAX.

    >>> principal(jnp.eye(1), -jnp.ones(1), jnp.ones(0, bool), 10).z     # 1
    """
    return _answered("principal", certified, M, q, wanted, budget=np.int64(budget))


def lemke(M, q, covering, budget: int, certified: bool = False) -> Answers:
    """Lemke's method, `complementarity.lemke`; covering (m,), or (0,) for ones.

    >>> lemke(jnp.eye(1), -jnp.ones(1), jnp.ones(0), 10).judged.status     # SOLVED
    """
    return _answered("lemke", certified, M, q, covering, budget=np.int64(budget))


def direct(M, q, certified: bool = False) -> Answers:
    """Every mode of up to four contacts, `complementarity.direct`, which refuses more.

    >>> direct(jnp.eye(1), -jnp.ones(1)).z     # 1
    """
    return _answered("direct", certified, M, q)


def gauss_seidel(M, q, start, sweeps: int, relaxation: float, target: float, certified: bool = False) -> Answers:
    """Projected Gauss-Seidel, `complementarity.gauss_seidel`; start (m,), or (0,) for zeros.

    A problem rests once its backward error is at most `target`.

    >>> gauss_seidel(jnp.eye(1), -jnp.ones(1), jnp.ones(0), 10, 1.0, 1e-15).z     # 1
    """
    options = {"sweeps": np.int64(sweeps), "relaxation": np.float64(relaxation), "target": np.float64(target)}
    return _answered("gauss_seidel", certified, M, q, start, **options)


def measure(M, q, z, certificate) -> Measures:
    """`Measures` of a point z (m,) and a certificate (m,) from elsewhere.

    >>> measure(jnp.eye(1), -jnp.ones(1), jnp.ones(1), jnp.zeros(1)).eta     # 0
    """
    return Measures(*_call("measure", _measures_like(q), M, q, z, certificate))


def classify(M, q, z) -> Classes:
    """`Classes` of a point z (m,).

    >>> classify(jnp.eye(1), -jnp.ones(1), jnp.ones(1)).active     # True
    """
    return Classes(*_call("classify", [_like(q), _like(q, bool), _like(q, bool)], M, q, z))


def condition(M, held):
    """|K| |K^-1| of the balanced mode matrix K = M diag(held) + I diag(1 - held), row-sum norms; inf if singular.

    >>> condition(jnp.eye(2), jnp.ones(2, bool))     # 1
    """
    return _call("condition", _like(M[..., 0, 0]), M, held)


def pairs(P, N, q) -> Pairs:
    """The best candidate of P z - N w + q = 0 for one or two pairs, `complementarity.pairs`; (m, m), (m, m), (m,).

    >>> pairs(jnp.eye(1), jnp.eye(1), -jnp.ones(1)).z     # 1
    """
    results = [_like(q), _like(q), _like(q[..., 0]), _like(q, bool), _like(q, bool), *_measures_like(q)]
    *found, eta, rho, status = _call("pairs", results, P, N, q)
    return Pairs(*found, Judged(eta, rho, status))


def _answered(name, certified, M, q, *more, **options) -> Answers:
    results = [_like(q), _like(q if certified else q[..., :0]), _like(q[..., 0], jnp.int32), *_measures_like(q)]
    z, certificate, steps, *judged = _call(name, results, M, q, *more, **options)
    return Answers(z, certificate, steps, Judged(*judged))


def _measures_like(q):
    return [_like(q[..., 0]), _like(q[..., 0]), _like(q[..., 0], jnp.int32)]


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
        try:
            jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(getattr(kernels, name)), platform="cpu")
        except RuntimeError as error:  # pip compiles for the newest jaxlib there is
            return f"they were built for another jaxlib; write `jaxcontact kernels --build` ({error})"
    return ""
