"""The compiled kernels: the same answers as the same methods in JAX, lane by lane, and nothing lost without them."""

import os
import shutil
import subprocess
import sys
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from families import FAMILIES, UNIQUE, beyond_critical, fathi, infeasible_semidefinite, murty, near_critical, sliding

from jaxcontact import native
from jaxcontact.complementarity import (
    LCP,
    Direct,
    HorizontalLCP,
    Lemke,
    PrincipalPivoting,
    ProjectedGaussSeidel,
    Status,
    judge,
    solve,
)
from jaxcontact.complementarity.bars import CONDITION_BOUND, backward_error_bound, close, small, telling
from jaxcontact.complementarity.judge import Claim
from jaxcontact.native import build

COMPILER = shutil.which(os.environ.get("CXX", "c++"))

EXPONENTIAL = (sliding, near_critical, beyond_critical, murty, fathi)
EXPONENTIAL_UP_TO = 9
"""Families that take 2^m steps to draw or to solve are left out beyond this size."""

TURNS = 8
"""Up to this many contacts rows take turns in the kernel of principal pivoting."""

built = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler here, so no kernels")


def problems(m, dtype, seed=5, each=3, families=FAMILIES):
    """M (n, m, m), q (n, m) from every family, in no order, and a number of them that fills no group of lanes."""
    rng = np.random.default_rng(seed)
    families = [f for f in families if m <= EXPONENTIAL_UP_TO or f not in EXPONENTIAL]
    drawn = [f(m, rng) for f in families for _ in range(1 if f in (murty, fathi) else each)]
    drawn = [drawn[k] for k in rng.permutation(len(drawn))][: len(drawn) // 8 * 8 - 3]
    return tuple(jnp.asarray(np.array(part), dtype) for part in zip(*drawn, strict=True))


def batch(method):
    return jax.jit(jax.vmap(lambda M, q: solve(LCP(M, q), method)))


def both(method, M, q):
    """The solutions by kernel and by JAX, as NumPy arrays."""
    by_kernel = jax.tree.map(np.asarray, batch(method)(M, q))
    with native.unused():
        return by_kernel, jax.tree.map(np.asarray, batch(method)(M, q))


@built
def test_where_a_compiler_is_the_kernels_are_in_use():
    if os.environ.get("JAXCONTACT_NATIVE") == "0":
        pytest.skip("switched off from outside")
    assert native.reason() == ""
    assert native.serve(jnp.float32)
    assert native.serve(jnp.float64)
    assert not native.serve(jnp.float16)
    with native.unused():
        assert "unused" in native.reason()
    assert native.reason() == ""


CASES = [
    (PrincipalPivoting(), 1, np.float64),
    (PrincipalPivoting(), 3, np.float32),
    (PrincipalPivoting(), 6, np.float64),
    (PrincipalPivoting(), 11, np.float64),
    (Lemke(), 2, np.float64),
    (Lemke(), 5, np.float64),
    (Lemke(), 10, np.float64),
    (Direct(), 1, np.float64),
    (Direct(), 2, np.float64),
    (Direct(), 4, np.float64),
]
SLOW = [
    *((PrincipalPivoting(), m, np.float32) for m in (2, 4, 5, 7, 8, 9, 17, 33)),
    *((PrincipalPivoting(), m, np.float64) for m in (2, 4, 7, 8, 16, 24, 40)),
    *((Lemke(), m, dtype) for m in (1, 3, 4, 7, 8, 9, 16, 24, 33) for dtype in (np.float64, np.float32)),
    *((Direct(), m, np.float32) for m in (1, 2, 3, 4)),
]


@built
@pytest.mark.parametrize(
    ("method", "m", "dtype"), [*CASES, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)]
)
def test_kernel_and_jax_agree_on_every_family(method, m, dtype):
    """Status for status, pivot for pivot; numbers to eight times the rounding of the equations (bar 4). Where rows take
    turns the path is another one, so only what has one solution can be compared."""
    turns = isinstance(method, PrincipalPivoting) and m <= TURNS
    M, q = problems(m, dtype, families=UNIQUE if turns else FAMILIES)
    kernel, reference = both(method, M, q)
    eps = np.finfo(dtype).eps
    # where more than half of the digits are gone the two may decide differently, and each says so in `condition`
    clear = np.maximum(kernel.condition, reference.condition) < eps**-0.5
    assert clear.sum() > len(q) // 2
    assert (kernel.status == reference.status)[clear].all()
    assert turns or (kernel.steps == reference.steps)[clear].all()
    solved = clear & (reference.status == Status.SOLVED)
    assert solved.any()
    scale = np.abs(reference.z[solved]).max(1) + np.abs(q[solved]).max(1)
    assert (np.abs(kernel.z - reference.z)[solved].max(1) <= 8 * eps * reference.condition[solved] * scale).all()
    assert (kernel.active == reference.active)[solved].all()
    assert (kernel.degenerate == reference.degenerate)[solved].all()
    assert (np.isnan(kernel.z).any(1) == ~np.isin(kernel.status, (Status.SOLVED, Status.REDUNDANT))).all()


@built
def test_what_turns_do_not_solve_ends_as_in_jax():
    """Some families have several solutions, or none: turns may solve more, and never less."""
    M, q = map(np.asarray, problems(4, np.float64, each=20))
    kernel, reference = both(PrincipalPivoting(), M, q)
    left = kernel.status != Status.SOLVED
    z, M, q = kernel.z[~left], M[~left], q[~left]
    w = np.einsum("bij,bj->bi", M, z) + q
    sizes = (np.einsum("bij,bj->bi", np.abs(M), z) + np.abs(q)).max(1)
    assert (z >= 0).all()
    # the judge's bound for eta, once more
    assert (np.abs(np.minimum(z / z.max(1, initial=1e-300, keepdims=True), w / sizes[:, None])) <= 256 * 2.0**-52).all()
    assert left.sum() > 20
    assert (kernel.status == reference.status)[left].all()
    assert (kernel.steps == reference.steps)[left].all()
    assert (kernel.status == Status.INFEASIBLE).any()


@built
@pytest.mark.parametrize(("m", "start"), [(3, False), (10, True)])
def test_sweeps_are_those_of_the_code_in_jax(m, start):
    """Ten sweeps, relaxed: the iterate to the rounding of its sums where it stays of moderate size."""
    M, q = problems(m, np.float64)
    guess = (jnp.abs(q) if start else None,)
    method = ProjectedGaussSeidel(sweeps=10, relaxation=1.2)

    def answer(M, q, *start):
        return solve(LCP(M, q), method, *start)

    given = (M, q, *(guess if start else ()))
    kernel = jax.vmap(answer)(*given)
    with native.unused():
        reference = jax.vmap(answer)(*given)
    assert np.array_equal(kernel.status, reference.status)
    assert (np.asarray(kernel.status) == Status.MAX_STEPS).any()
    moderate = np.abs(reference.attempt).max(1) < 1e3 * (1 + np.abs(q).max(1))
    scale = np.abs(reference.attempt).max(1, keepdims=True) + 1
    # sweeps that enlarge an iterate a thousandfold enlarge its rounding, of some ten sums of m terms, as much
    rounding = 1e3 * 10 * m * np.finfo(np.float64).eps
    assert (np.abs(kernel.attempt - reference.attempt) <= rounding * scale)[moderate].all()
    # the last backward error may fall on either side of the target
    assert (np.abs(kernel.steps - reference.steps) <= 1)[moderate].all()


@built
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("m", [1, 2])
def test_pairs_in_horizontal_form_agree(m, dtype):
    """P z - N w + q = 0 of small integers, where modes are singular and nothing or much solves, and of any numbers, in
    units up to 2^20 apart; statuses are those of the code in JAX, and the answers solve the equations."""
    rng = np.random.default_rng(7)
    n = 150
    P, N = rng.integers(-2, 3, (2, n, m, m)).astype(float)
    q = rng.integers(-2, 3, (n, m)).astype(float)
    P[: n // 3], N[: n // 3], q[: n // 3] = (rng.normal(size=x[: n // 3].shape) for x in (P, N, q))
    rows, columns = 2.0 ** rng.integers(-10, 11, (n, m)), 2.0 ** rng.integers(-10, 11, (2, n, 1, m))
    P, N, q = rows[:, :, None] * P * columns[0], rows[:, :, None] * N * columns[1], rows * q
    P[5, 0, 0], q[6, 0], P[7], N[7], q[7] = np.nan, np.inf, 0, 0, 0
    P, N, q = (x.astype(dtype) for x in (P, N, q))
    answers = jax.vmap(lambda N, P, q: solve(HorizontalLCP(N, P, q), Direct()))
    kernel = jax.tree.map(np.asarray, answers(N, P, q))
    with native.unused():
        reference = jax.tree.map(np.asarray, answers(N, P, q))
    assert np.array_equal(kernel.status, reference.status)
    assert {Status.SOLVED, Status.REDUNDANT, Status.INFEASIBLE, Status.BAD_INPUT} <= set(kernel.status.tolist())
    solved = np.isin(kernel.status, (Status.SOLVED, Status.REDUNDANT))
    z, w = kernel.z[solved], kernel.w[solved]
    assert min(z.min(), w.min()) >= 0
    assert not (z * w).any()
    sums = np.einsum("bij,bj->bi", P[solved], z) - np.einsum("bij,bj->bi", N[solved], w) + q[solved]
    terms = np.einsum("bij,bj->bi", abs(P[solved]), z) + np.einsum("bij,bj->bi", abs(N[solved]), w) + abs(q[solved])
    # eta <= 256 eps (16 eps in float32) of the largest row is what SOLVED says (numerics 4, bar 3)
    bound = backward_error_bound(dtype)
    assert (np.abs(sums).max(1) <= bound * np.maximum(terms.max(1), 1e-30)).all()
    same = (kernel.active == reference.active).all(1)  # of several solutions rounding chooses one
    regular = same & (kernel.status == Status.SOLVED) & (reference.condition < 1e3)
    assert regular.sum() > n // 3
    np.testing.assert_allclose(kernel.condition[regular], reference.condition[regular], rtol=1e3 * np.finfo(dtype).eps)


@built
@pytest.mark.parametrize("m", [2, 5, 9])
def test_proofs_of_infeasibility_are_those_of_the_judge(m):
    """Contacts that push against one another: Lemke's rays prove it, by a kernel as in JAX."""
    rng = np.random.default_rng(m)
    M, q = (np.array(part) for part in zip(*(infeasible_semidefinite(m, rng) for _ in range(60)), strict=True))
    kernel, reference = both(Lemke(), jnp.asarray(M), jnp.asarray(q))
    assert np.array_equal(kernel.status, reference.status)
    assert 10 < (kernel.status == Status.INFEASIBLE).sum() < 60


@built
@pytest.mark.parametrize("m", [2, 5, 9])
def test_the_judges_measures_are_those_of_its_own_code(m):
    """At points that solve nothing, zero and negative ones too: eta and rho are far from rounding there."""
    M, q = problems(m, np.float64, each=2)
    z = jnp.asarray(np.random.default_rng(0).normal(size=q.shape))
    z = z.at[::3].set(0).at[1, 0].set(jnp.nan).at[2, 0].set(jnp.inf)

    def verdict(M, q, z, kernels):
        return judge(LCP(M, q), Claim(q[:0], z, z, jnp.int32(Status.SOLVED), 0 * z), kernels)

    by_kernel, by_jax = (jax.jit(jax.vmap(partial(verdict, kernels=k)))(M, q, z) for k in (True, False))
    good = np.isfinite(z).all(1)
    for name in ("w", "residual", "backward_error"):  # the two add up the terms of a row in different orders
        np.testing.assert_allclose(getattr(by_kernel, name)[good], getattr(by_jax, name)[good], rtol=1e-12, atol=1e-12)
        assert not np.isfinite(np.asarray(getattr(by_kernel, name))[~good].reshape(2, -1)).all(1).any()
    for name in ("active", "degenerate"):
        assert np.array_equal(getattr(by_kernel, name)[good], getattr(by_jax, name)[good]), name
    assert np.array_equal(by_kernel.status, by_jax.status)


@built
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("m", [3, 12])
def test_what_a_kernel_tells_by_its_flags_is_what_the_judge_says_of_the_same_numbers(m, dtype):
    """Points near solutions z of matrices that nearly map z to zero, M z = t z: the terms of a row are about one, the
    load is about t and the condition about 1/t, so that eta, rho and the condition spread over all bounds."""
    assert native.serve(dtype)
    rng = np.random.default_rng(m)
    n = 4000
    A, z = rng.normal(size=(n, m, m)), rng.uniform(0.5, 1, (n, m))
    t = 10.0 ** -rng.uniform(0, 17, (n, 1))
    M = A - np.einsum("bij,bj,bk->bik", A, z, z) / np.sum(z * z, 1)[:, None, None] + t[:, :, None] * np.eye(m)
    z *= 1 + 10.0 ** -rng.uniform(0, 18, (n, 1)) * rng.normal(size=(n, m))
    M, q, z = (jnp.asarray(x, dtype) for x in (M, -t * z, z))
    eta, rho, flags = jax.jit(jax.vmap(native.measure))(M, q, z, 0 * z)
    for bit, expected in ((native.SMALL, small(eta)), (native.TELLING, telling(rho)), (native.CLOSE, close(eta))):
        assert np.array_equal(flags & bit != 0, expected)
        assert 0.02 < np.mean(expected) < 0.98
    asked = np.asarray(small(eta) & ~telling(rho))
    held = np.logical_or(*jax.jit(jax.vmap(native.classify))(M, q, z)[1:])
    condition = np.asarray(jax.jit(jax.vmap(native.condition))(M, held))
    limit = CONDITION_BOUND / np.finfo(dtype).eps
    near = np.abs(np.log(condition / limit)) < 0.1  # so large a condition is itself known to some per cent
    assert np.array_equal((flags & native.MODERATE != 0)[asked & ~near], condition[asked & ~near] <= limit)


@built
@pytest.mark.parametrize("m", [3, 8, 12])
def test_the_condition_is_that_of_the_library(m):
    rng = np.random.default_rng(m)
    M = rng.normal(size=(40, m, m)) + m * np.eye(m)
    held = rng.random((40, m)) < 0.6
    K = np.where(held[:, None, :], M, np.eye(m))
    K[3], M[3], held[3] = 0, 0, True
    found = np.asarray(native.condition(jnp.asarray(M), jnp.asarray(held)))
    rows = 2.0 ** -np.frexp(np.abs(K).max(2))[1]
    B = K * rows[:, :, None]
    B = B * (2.0 ** -np.frexp(np.abs(B).max(1))[1])[:, None, :]
    regular = np.arange(40) != 3
    expected = np.abs(B).sum(2).max(1)[regular] * np.abs(np.linalg.inv(B[regular])).sum(2).max(1)
    np.testing.assert_allclose(found[regular], expected, rtol=1e-12)
    assert found[3] == np.inf


@built
@pytest.mark.parametrize("method", [PrincipalPivoting(), Lemke(), Direct()])
def test_no_lane_of_a_group_changes_another(method):
    """Lane 5 is poisoned, lane 6 has no solution, and the others keep every bit, alone or in any company."""
    m, n = 4, 21
    rng = np.random.default_rng(1)
    A = rng.normal(size=(n, m, m))
    M, q = A @ A.transpose(0, 2, 1) + np.eye(m), rng.normal(size=(n, m))
    clean = jax.tree.map(np.asarray, batch(method)(M, q))
    M[5, 1, 2], M[6], q[6] = np.nan, 0, -1
    spoilt = jax.tree.map(np.asarray, batch(method)(M, q))
    others = ~np.isin(np.arange(n), (5, 6))
    assert spoilt.status[5] == Status.BAD_INPUT
    assert spoilt.status[6] != Status.SOLVED
    assert np.isnan(spoilt.z[[5, 6]]).all()
    for before, after in zip(jax.tree.leaves(clean), jax.tree.leaves(spoilt), strict=True):
        assert np.array_equal(before[others], after[others])
    alone = jax.tree.map(np.asarray, batch(method)(M[9:10], q[9:10]))
    assert np.array_equal(alone.z[0], clean.z[9])


@built
def test_batches_of_batches_of_none_and_of_shared_matrices():
    rng = np.random.default_rng(2)
    M, q = np.eye(3) + 0.1, rng.normal(size=(2, 3, 3))
    one = partial(solve, method=PrincipalPivoting())
    nested = jax.vmap(jax.vmap(lambda q: one(LCP(M, q)).z))(q)
    assert np.array_equal(nested, [[one(LCP(M, b)).z for b in row] for row in q])
    assert jax.vmap(lambda q: one(LCP(M, q)).z)(q[0, :0]).shape == (0, 3)


@built
def test_a_warm_start_takes_the_pivots_of_the_code_in_jax():
    m = 6
    rng = np.random.default_rng(3)
    A = rng.normal(size=(19, m, m))
    M, q = jnp.asarray(A @ A.transpose(0, 2, 1) + np.eye(m)), jnp.asarray(rng.normal(size=(19, m)))
    start = jnp.asarray(rng.random((19, m)))
    warm = jax.vmap(lambda M, q, start: solve(LCP(M, q), PrincipalPivoting(), start=start))
    by_kernel = warm(M, q, start)
    with native.unused():
        by_jax = warm(M, q, start)
    assert np.array_equal(by_kernel.steps, by_jax.steps)
    np.testing.assert_allclose(by_kernel.z, by_jax.z, atol=1e-12)


def test_without_kernels_everything_works_and_the_reason_is_named(tmp_path):
    """In a process of its own, as the choice is made when the library is loaded."""
    script = (
        "import jax.numpy as jnp, jaxcontact as jc; from jaxcontact import native;"
        "print(native.reason()); print(float(jc.solve(jc.LCP(jnp.eye(1), -jnp.ones(1)), jc.Lemke()).z[0]))"
    )
    environment = {**os.environ, "JAXCONTACT_NATIVE": "0"}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.split("\n")[:2] == ["JAXCONTACT_NATIVE=0 is set", "1.0"]


@built
def test_kernels_for_another_jaxlib_are_left_alone(monkeypatch):
    """jaxlib refuses a library with a newer interface for foreign functions than its own."""

    def refuse(*_, **__):
        raise jax.errors.JaxRuntimeError("INVALID_ARGUMENT: API version (0.3) is incompatible")

    native._loaded.cache_clear()
    monkeypatch.setattr(jax.ffi, "register_ffi_target", refuse)
    try:
        assert native.reason().startswith("they were built for another jaxlib; write `jaxcontact kernels --build`")
        assert float(solve(LCP(jnp.eye(1), -jnp.ones(1)), Lemke()).z[0]) == 1
    finally:
        native._loaded.cache_clear()


def test_no_compiler_is_said_so(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CXX", "")
    with pytest.raises(build.CannotBuild, match="compiler"):
        build.build()


@built
def test_a_compiler_that_fails_is_quoted(monkeypatch, tmp_path):
    compiler = tmp_path / "broken"
    compiler.write_text("#!/bin/sh\necho no such option >&2\nexit 1\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CXX", str(compiler))
    with pytest.raises(build.CannotBuild, match="no such option"):
        build.build()
    assert native.build.library().exists()
