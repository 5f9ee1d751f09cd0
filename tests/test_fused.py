"""Programs on scalars: the same values and derivatives, structure folded, one kernel over a batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_invariance import SCENES

import jaxcontact as jc
from jaxcontact import linalg
from jaxcontact.linalg import fused
from jaxcontact.linalg.survey import LOOP_LIMIT
from jaxcontact.linalg.unrolled import milestone

X = jnp.array([0.3, -1.2, 2.5])

of_xla_cpu = pytest.mark.skipif(jax.default_backend() != "cpu", reason="walls are for what XLA does on a CPU")


def mixed(x):
    """Vectors, matrices, sums, selections and quotients, as a user writes them."""
    A = jnp.stack([x, jnp.sin(x), jnp.ones_like(x)])
    y = jnp.where(x > 0, jnp.sqrt(jnp.abs(x)), x**3)
    return (A @ y) / (1 + jnp.sum(x * x)) + A.T[0] * jnp.cos(y)[::-1]


@pytest.mark.parametrize("final", [False, True])
def test_values_are_those_of_the_function(final):
    np.testing.assert_allclose(fused(mixed, final=final)(X), mixed(X), rtol=1e-15)
    np.testing.assert_allclose(jax.jit(jax.vmap(fused(mixed, final=final)))(X[None]), mixed(X)[None], rtol=1e-15)


def test_derivatives_of_both_modes_and_second_order_are_those_of_the_function():
    for mode in (jax.jacfwd, jax.jacrev, jax.hessian):
        np.testing.assert_allclose(mode(fused(mixed))(X), mode(mixed)(X), rtol=1e-13, atol=1e-14)


def test_custom_derivatives_are_kept():
    @jax.custom_jvp
    def odd(x):
        return x * x

    odd.defjvp(lambda primals, tangents: (odd(*primals), 7.0 * tangents[0]))
    assert jax.grad(fused(lambda x: odd(x) * 1.0))(2.0) == 7.0


def test_a_structural_zero_times_an_undefined_direction_stays_undefined():
    """The slip direction of a puck at rest, v / |v| at v = 0, must not fold to zero: no friction would be claimed."""

    def direction(speed):
        return jax.jvp(lambda v: jnp.sqrt(v**2), (jnp.zeros_like(speed),), (speed,))[1]

    assert jnp.isnan(direction(1.0))
    for final in (False, True):
        assert jnp.isnan(jax.jit(fused(fused(direction), final=final))(1.0))


def test_zeros_ones_and_repetitions_fall_away():
    def wasteful(x):
        return jnp.exp(x) * 0.0 + (jnp.exp(x) + 0.0) * 1.0 + jnp.exp(x)

    program = str(jax.make_jaxpr(fused(wasteful, final=True))(1.0))
    assert program.count("exp") == 1
    assert "mul" not in program


def test_programs_with_loops_are_left_alone():
    def loop(x):
        return jax.lax.fori_loop(0, 3, lambda i, y: y + x * 0.0, x)

    assert str(jax.make_jaxpr(fused(loop))(1.0)) == str(jax.make_jaxpr(loop)(1.0))


def test_precision_is_kept():
    assert fused(mixed)(X.astype("float32")).dtype == jnp.float32


@pytest.mark.parametrize(("mechanism", "chart"), SCENES, ids=lambda x: type(x).__name__)
def test_the_bound_of_every_mechanism_is_one_kernel_without_library_calls(mechanism, chart):
    """Losing the fusion costs a factor of 5 to 50 and changes no value."""

    def bound(values):
        return jc.bounds.norm_ratio(jc.delassus(mechanism, mechanism.state(**values)))

    values = {name: jnp.full((1000,), value) for name, value in chart.items()} or {"t": jnp.zeros(1000)}
    program = jax.jit(jax.vmap(fused(bound, final=True))).lower(values).compile().as_text()
    assert program.count(" fusion(") <= 1
    assert "custom-call" not in program
    assert "while(" not in program


def test_what_two_programs_hand_over_is_not_stored():
    """Plain jit(vmap): the factors between `delassus` and the bound fall away, and so do their cotangents."""
    guides = jc.mechanisms.PainleveKlein()

    def bound(theta):
        return jc.bounds.norm_ratio(jc.delassus(guides, guides.state(theta=theta)))

    theta = jnp.zeros(1000)
    for function, most in ((bound, 1), (jax.grad(bound), 2)):
        program = jax.jit(jax.vmap(function)).lower(theta).compile().as_text()
        assert program[program.index("ENTRY") :].count(" fusion(") <= most
        assert "custom-call" not in program


def test_a_long_program_is_cut_at_its_milestones():
    """Two milestones, two by two before the rest: what comes after is one more loop, with the same values."""

    def long(x):
        first = milestone(jnp.sin(x))
        second = milestone(first + x)
        for _ in range(LOOP_LIMIT // 2):
            x = x * second + first
        return x

    x = jnp.linspace(0.1, 0.2, 8)
    traced = jax.make_jaxpr(jax.vmap(fused(long, final=True)))(x)
    assert str(traced).count("branches=") == 1
    np.testing.assert_allclose(jax.vmap(fused(long, final=True))(x), jax.vmap(long)(x), rtol=1e-14)
    assert "branches=" not in str(jax.make_jaxpr(fused(milestone, final=True))(x[0]))


@pytest.mark.parametrize("shape", [(3, 4), (1, 4), (4, 1), (0, 3)])
def test_extrema_quantifiers_running_sums_and_counters_are_those_of_the_arrays(shape):
    def function(x):
        largest = jnp.max(x, axis=0, initial=0.25) if shape[0] else jnp.zeros(shape[1])
        return (
            largest,
            jnp.min(x, axis=1),
            jnp.all(x > 0, axis=0),
            jnp.any(x > 0.5, axis=1),
            jnp.cumsum(x, axis=1),
            jax.lax.cumsum(x, axis=0, reverse=True),
            jnp.where(jnp.eye(*shape, dtype=bool), jnp.arange(shape[1], dtype=float)[None, :], x),
        )

    x = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, shape))
    jax.tree.map(np.testing.assert_array_equal, fused(function)(x), function(x))
    if x.size:
        poisoned = x.at[0, 0].set(jnp.nan)
        jax.tree.map(np.testing.assert_array_equal, fused(function)(poisoned), function(poisoned))


@of_xla_cpu
def test_a_value_with_its_derivative_is_one_loop_and_three_numbers_are_two():
    """Each further loop over the batch costs as much as the bound itself."""
    guides = jc.mechanisms.PainleveKlein()

    def bound(theta):
        return jc.bounds.norm_ratio(jc.delassus(guides, guides.state(theta=theta)))

    def both(theta):
        return jax.jvp(bound, (theta,), (jnp.ones_like(theta),))

    theta = jnp.linspace(0.1, 1.4, 1000)
    for function, loops in ((both, 1), (jax.value_and_grad(bound), 1), (lambda x: (bound(x), x, jnp.sin(x)), 2)):
        program = jax.jit(jax.vmap(fused(function, final=True))).lower(theta).compile()
        computed = [line for line in program.as_text().splitlines() if " fusion(" in line and "complex" not in line]
        branches = [line for line in program.as_text().splitlines() if " conditional(" in line]
        assert len(branches) == loops, computed
        for found, expected in zip(program(theta), jax.vmap(function)(theta), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_parts_and_paddings_are_those_of_the_arrays():
    def function(x):
        padded = jax.lax.pad(x, jnp.zeros((), x.dtype), [(1, -1, 2), (-1, 2, 0)])
        first, second = jax.lax.split(x, (1, 2), axis=1)
        return padded, first, second, *jnp.unstack(x, axis=1)

    x = jnp.arange(12.0).reshape(4, 3)
    jax.tree.map(np.testing.assert_array_equal, fused(function)(x), function(x))


def looks(x, M):
    """Numbers and truth values of several shapes, none among them."""
    return {"sign": x > 0, "sums": M.sum(1), "none": x[:0] > 0, "largest": jnp.abs(M).max(), "finite": jnp.isfinite(M)}


@pytest.mark.parametrize("lanes", [0, 1, 7])
def test_what_is_packed_is_what_the_function_returns(lanes):
    rng = np.random.default_rng(lanes)
    x, M = rng.normal(size=(lanes, 4)), rng.normal(size=(lanes, 4, 4))
    M[M > 1.5] = np.nan
    packed = jax.vmap(linalg.packed(looks))(x, M)
    for name, expected in jax.vmap(looks)(x, M).items():
        assert packed[name].shape == expected.shape
        np.testing.assert_allclose(packed[name], expected, rtol=1e-15)
        assert packed[name].dtype == expected.dtype


def test_more_truth_values_than_bits_of_a_number():
    x = np.random.default_rng(0).normal(size=(5, 70))
    assert np.array_equal(jax.vmap(linalg.packed(lambda x: x > 0))(x), x > 0)


@of_xla_cpu
def test_what_is_packed_takes_few_loops():
    """Five numbers two by two, and twenty truth values in one, behind one wall."""
    x, M = jnp.ones((64, 4)), jnp.ones((64, 4, 4))
    text = jax.jit(jax.vmap(linalg.packed(looks))).lower(x, M).compile().as_text()
    assert text.count(" conditional(") == 1
    assert sum(" fusion(" in line and "/branch_1_fun/" in line for line in text.splitlines()) == 3 + 1


@of_xla_cpu
@pytest.mark.parametrize("constant", [False, True])
def test_a_wall_stands_though_its_branches_are_cheap_and_an_argument_is_constant(constant):
    """XLA makes a select of a branch of cheap operations, and takes a branch whose choice it knows."""

    def twice(length, x):
        shared = linalg.walled(lambda length, x: jnp.sin(length * x[0]) + x[1])(length, x)
        return shared + 1, shared * 2

    x, length = jnp.ones((64, 2)), 2.0 if constant else jnp.ones(64)
    program = jax.jit(jax.vmap(lambda x, a: twice(jnp.float64(length) if constant else a, x)))
    text = program.lower(x, jnp.ones(64)).compile().as_text()
    assert text.count(" conditional(") == 1
    found = program(x, jnp.ones(64))
    np.testing.assert_allclose(found[0], np.sin(2.0 if constant else 1.0) + 2, rtol=1e-15)
