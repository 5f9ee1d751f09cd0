"""At the ends of every range: what is promised there, against closed forms, 60 digits and exact fractions.

`notebooks/extremes.py` prints the same measurements as tables and says where each promise ends.
"""

import dataclasses
from fractions import Fraction
from itertools import product

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.mechanisms import GuidedRod, LinearBearing, PainleveKlein, PainleveRod

DTYPES = (np.float64, np.float32)
SINGULAR = 64
"""W counts as singular where its contacts depend on each other up to this many roundings."""


def eps_of(dtype):
    return float(np.finfo(dtype).eps)


def with_dtype(mechanism, dtype):
    return jax.tree.map(dtype, mechanism)


def over(quantity, values):
    """A function of one number over a row, compiled once; a list of arrays."""
    return [np.asarray(part) for part in jax.jit(jax.vmap(quantity))(jnp.asarray(values))]


def thresholds(here):
    return jc.bounds.critical(here), jc.bounds.norm_ratio(here)


@jc.mechanism
class TippedRod(PainleveKlein):
    """The rod between two guides with a point mass at its upper tip."""

    tip: float = 1.0  # kg

    def kinetic_energy(self, q, v):
        rise = 0.5 * self.length * v[2]
        x, y = v[0] - rise * jnp.sin(q[2]), v[1] + rise * jnp.cos(q[2])
        return PainleveKlein.kinetic_energy(self, q, v) + 0.5 * self.tip * (x**2 + y**2)


@jc.mechanism
class TwoPins:
    """A block, mass and inertia one, pressed by 2 N on two pins a distance apart: W = [[1 + d²/4, 1 - d²/4], [., .]].

    The slips see the pins' rotation by 1/4 m, so that Wt = -(d/8) u u^T with u = (1, -1): critical = norm_ratio = 2 d.
    """

    distance: float = 1.0  # m
    kind: str = jc.static("bilateral")

    @property
    def contacts(self):
        return (jc.Contact("left", self.kind, True), jc.Contact("right", self.kind, True))

    def mass_matrix(self, q):
        return jnp.eye(3, dtype=q.dtype)

    def applied_force(self, q, v, t):
        return jnp.array([0.0, -2.0, 0.0], q.dtype)

    def gaps(self, q):
        rise = 0.5 * self.distance * q[2]
        return jnp.stack([q[1] - rise, q[1] + rise])

    def slips(self, q, v):
        return jnp.stack([v[0] + 0.25 * v[2], v[0] - 0.25 * v[2]])

    def state(self, dtype):
        return jc.State(jnp.zeros(3, dtype), jnp.asarray([1.0, 0.0, 0.0], dtype))


def zigzag(blocks, lean=0.05, mu=0.05, gravity=9.81):
    """(M, q) of a stack of unit blocks whose contacts lean to and fro and slide to and fro: W - Wt [mu xi], w."""
    side = (-1.0) ** np.arange(blocks)
    normal = np.stack([np.sin(lean * side), np.cos(lean * side)])
    tangent = np.stack([np.cos(lean * side), -np.sin(lean * side)])
    G, H = np.zeros((2, 2, blocks, blocks))
    for i in range(blocks):
        G[:, i, i], H[:, i, i] = normal[:, i], tangent[:, i]
        if i:
            G[:, i - 1, i], H[:, i - 1, i] = -normal[:, i], -tangent[:, i]
    G, H = G.reshape(2 * blocks, blocks), H.reshape(2 * blocks, blocks)
    weight = np.repeat([0.0, gravity], blocks)
    return G.T @ G - G.T @ H * (mu * side), -G.T @ weight


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_from_flat_to_upright_the_thresholds_keep_their_digits_until_the_gaps_are_one(dtype):
    near = 10.0 ** -np.arange(1.0, 13.0)
    theta = np.concatenate([near, np.pi / 2 - near]).astype(dtype)
    rod = with_dtype(PainleveKlein(), dtype)
    critical, bound = over(lambda t: thresholds(jc.delassus(rod, rod.state(theta=t))), theta)
    with mpmath.workdps(40):
        angle = [mpmath.mpf(float(t)) for t in theta]
        exact = np.array([float(abs(mpmath.cot(t))) for t in angle])
        steep = np.array([float(abs(1 / (3 * mpmath.sin(t) * mpmath.cos(t)))) for t in angle])
    # The angle is taken as it is rounded; what is left is a handful of roundings.
    np.testing.assert_allclose(bound, np.minimum(exact, steep), rtol=8 * eps_of(dtype))
    apart = exact > SINGULAR * eps_of(dtype)
    np.testing.assert_allclose(critical[apart], exact[apart], rtol=8 * eps_of(dtype))
    # Nearer to upright it may say that the gaps depend on each other, which never claims too much.
    assert np.all((critical[~apart] == 0) | (abs(critical[~apart] / exact[~apart] - 1) < 8 * eps_of(dtype)))


@pytest.mark.parametrize(("rod", "dtype"), [(GuidedRod(), np.float32), (PainleveRod(), np.float64)])
def test_one_contact_is_judged_rightly_down_to_the_last_digit_beside_its_critical_friction(rod, dtype):
    rod, eps = with_dtype(rod, dtype), eps_of(dtype)
    state = rod.state(theta=dtype(0.9), speed=dtype(-1.0))
    here = jc.delassus(rod, state)
    last = 15 if dtype == np.float64 else 7
    steps = np.array([sign * 10.0**-k for k in range(1, last + 1) for sign in (-1, 1)])
    friction = (float(jc.bounds.critical(here)) * (1 + steps)).astype(dtype)

    def answers(mu):
        found = jc.contact_forces(rod, state, mu[None])
        every = jc.solutions(here, mu[None], -jnp.ones(1, dtype))
        return found.status, found.normal[0], every.count, every.undecided

    status, normal, count, undecided = over(answers, friction)
    N, T = ([Fraction(float(x)) for x in np.asarray(part)[:, 0]] for part in (here.N, here.T))
    A, At = sum(x * x for x in N), sum(x * y for x, y in zip(N, T))
    for mu, ended, force, solutions, doubtful in zip(friction, status, normal, count, undecided):
        slope = A + At * Fraction(float(mu))  # xi = -1; the load pushes, w < 0
        assert solutions == (1 if slope > 0 else 0)
        assert not doubtful
        assert ended == (jc.Status.SOLVED if slope > 0 else jc.Status.INFEASIBLE)
        if slope > 0:
            exact = float(-Fraction(float(here.w[0])) / slope)
            # The slope is a difference of numbers A / slope times as large, each of them off by a few roundings.
            assert abs(force / exact - 1) <= 8 * eps * float(A / slope)


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_beside_the_friction_where_solutions_multiply_the_count_is_exact_but_for_the_last_digits(dtype):
    rod = with_dtype(PainleveKlein(gravity=9.81, lower_pull=1.0), dtype)
    here = jc.delassus(rod, rod.state(theta=dtype(0.9)))
    leftwards = -jnp.ones(2, dtype)
    # From k = 14 (float32: 5) on the two new solutions are nearer to each other and to the border than rounding can
    # tell; there two may be counted where there are one or three.
    last = 13 if dtype == np.float64 else 4
    steps = np.array([sign * 10.0**-k for k in range(1, last + 1) for sign in (-1, 1)])
    friction = (float(jc.bounds.critical_for_load(here, leftwards)) * (1 + steps)).astype(dtype)
    (count,) = over(lambda mu: (jc.solutions(here, jnp.stack([mu, mu]), leftwards).count,), friction)
    np.testing.assert_array_equal(count, [exact_count(here, -mu) for mu in friction])
    assert set(count) == {1, 3}


def exact_count(here, pull):
    """How many solutions two bilateral contacts have, in rational arithmetic from the floats; pull = mu xi of both."""
    N, T = ([[Fraction(float(x)) for x in column] for column in np.asarray(part).T] for part in (here.N, here.T))
    w, pull = [Fraction(float(x)) for x in here.w], Fraction(float(pull))
    found = set()
    for s in product((1, -1), repeat=2):
        (a, b), (c, d) = (
            [sum(x * (y - pull * s[j] * z) for x, y, z in zip(N[i], N[j], T[j])) for j in range(2)] for i in range(2)
        )
        force = ((b * w[1] - d * w[0]) / (a * d - b * c), (c * w[0] - a * w[1]) / (a * d - b * c))
        if all(sign * x >= 0 for sign, x in zip(s, force)):
            found.add(force)
    return len(found)


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_mass_ratios_to_ten_to_the_twelve_leave_the_critical_friction_its_digits_and_take_those_of_the_bound(dtype):
    largest = 12 if dtype == np.float64 else 4  # beyond, float32 has rounded the rod away beside its tip
    tip = (10.0 ** np.arange(-12, largest + 1)).astype(dtype)
    rod, theta = with_dtype(TippedRod(), dtype), dtype(0.9)

    def at(mass):
        loaded = dataclasses.replace(rod, tip=mass)
        return thresholds(jc.delassus(loaded, loaded.state(theta=theta)))

    critical, bound = over(at, tip)
    exact_critical, exact_bound = np.array([tipped_rod_in_sixty_digits(theta, mass) for mass in tip]).T
    np.testing.assert_allclose(critical, exact_critical, rtol=8 * eps_of(dtype))
    # M itself is rounded: its smallest eigenvalue, and with it the bound, is known to eps times the ratio of masses.
    assert np.all(abs(bound / exact_bound - 1) <= 8 * eps_of(dtype) * (1 + tip))


def tipped_rod_in_sixty_digits(theta, tip):
    """(critical, norm_ratio) of `TippedRod` with m = l = 1, from its matrices by hand."""
    with mpmath.workdps(60):
        p, s, c = mpmath.mpf(float(tip)), mpmath.sin(mpmath.mpf(float(theta))), mpmath.cos(mpmath.mpf(float(theta)))
        half = mpmath.mpf(1) / 2
        inertia = mpmath.mpf(1) / 12 + p / 4
        M = mpmath.matrix([[1 + p, 0, -p * half * s], [0, 1 + p, p * half * c], [-p * half * s, p * half * c, inertia]])
        G = mpmath.matrix([[0, 0], [1, 1], [-half * c, half * c]])
        H = mpmath.matrix([[1, 1], [0, 0], [half * s, -half * s]])
        W, Wt = G.T * M**-1 * G, G.T * M**-1 * H
        X = W**-1 * Wt
        d = X[1, 1] if X[0, 1] * X[1, 0] >= 0 else -X[1, 1]
        root = mpmath.sqrt((X[0, 0] - d) ** 2 + 4 * abs(X[0, 1] * X[1, 0]))
        singular = [mpmath.svd_r(part, compute_uv=False) for part in (W, Wt)]
        return float(2 / (abs(X[0, 0] + d) + root)), float(min(singular[0]) / max(singular[1]))


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_a_bearing_jams_at_half_its_length_over_the_offset_whatever_their_ratio(dtype):
    offset = (10.0 ** np.arange(-12, 13)).astype(dtype)
    bearing = with_dtype(LinearBearing(), dtype)

    def at(y):
        here = dataclasses.replace(bearing, offset=y)
        return thresholds(jc.delassus(here, here.state(dtype(0.0))))

    critical, bound = over(at, offset)
    exact = 0.5 / offset.astype(float)
    apart = exact > SINGULAR * eps_of(dtype)
    np.testing.assert_allclose(critical[apart], exact[apart], rtol=8 * eps_of(dtype))
    # Seen from so far away the drive and the shaft hold the same thing: then it may say so, and claims nothing.
    assert np.all((critical[~apart] == 0) | (abs(critical[~apart] / exact[~apart] - 1) < 8 * eps_of(dtype)))
    assert np.all(bound[apart] <= critical[apart] * (1 + 8 * eps_of(dtype)))


@pytest.mark.parametrize(("kind", "dtype"), [("bilateral", np.float64), ("unilateral", np.float32)])
def test_pins_that_coincide_are_redundant_and_those_that_nearly_do_lose_digits_but_never_in_silence(kind, dtype):
    eps = eps_of(dtype)
    distance = np.append(10.0 ** -np.arange(0.0, 17.0), 0.0).astype(dtype)
    pins = with_dtype(TwoPins(kind=kind), dtype)
    state = pins.state(dtype)

    def at(d):
        here = dataclasses.replace(pins, distance=d)
        found = jc.contact_forces(here, state, jnp.stack([d, d]))
        return *thresholds(jc.delassus(here, state)), found.status, found.normal, found.acceleration

    critical, bound, status, normal, acceleration = over(at, distance)
    np.testing.assert_allclose(bound, 2 * distance, rtol=8 * eps)
    apart = distance > SINGULAR * eps
    np.testing.assert_allclose(critical[apart], 2 * distance[apart], rtol=8 * eps)
    assert np.all((critical[~apart] == 0) | (abs(critical[~apart] - 2 * distance[~apart]) < 1e-3 * distance[~apart]))
    # W is known to eps, its smaller eigenvalue is d^2 / 2.
    solved = status == jc.Status.SOLVED
    lost = eps / np.where(solved, distance, 1).astype(float) ** 2
    assert np.all(abs(normal - 1).max(axis=1)[solved] <= 8 * lost[solved])
    assert np.all(solved[distance**2 > 1e3 * eps])
    assert np.all(status[~solved] == jc.Status.REDUNDANT)
    assert status[-1] == jc.Status.REDUNDANT
    # However the forces are shared, their sum holds the block. A torque that redundant pins leave free moves them by
    # d^2 / 2 of a difference of forces, and they count as redundant only where d^2 is below 1e3 roundings.
    np.testing.assert_allclose(normal.sum(axis=1), 2, rtol=64 * eps)
    np.testing.assert_allclose(acceleration[:, 1], 0, atol=64 * eps)
    assert np.all(abs(distance * acceleration[:, 2]) <= 2e3 * eps)


UNITS = {np.float64: (-100, -75, -50, 0, 50, 75, 100), np.float32: (-12, -9, -6, 0, 6, 9, 12)}
"""Powers of ten for kilogram and metre at once, as far as the inertia m l^2 stays within the numbers."""
WIDE = {np.float64: 150, np.float32: 18}
"""Power of ten for one of them alone, either way."""


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_tiny_and_huge_units_change_no_threshold_no_count_and_no_force(dtype):
    alone = (-WIDE[dtype], WIDE[dtype])
    mass = [*UNITS[dtype], *alone, 0, 0]
    length = [*UNITS[dtype], 0, 0, *alone]
    units = np.array([[float(f"1e{a}"), float(f"1e{b}")] for a, b in zip(mass, length)]).astype(dtype)
    rod, mu = with_dtype(PainleveKlein(), dtype), jnp.full(2, 0.5, dtype)

    def at(unit):
        kilogram, metre = unit
        newton = kilogram * metre
        here = dataclasses.replace(
            rod, mass=kilogram, length=metre, gravity=dtype(9.81) * metre, lower_pull=dtype(1.0) * newton
        )
        state = here.state(theta=dtype(0.9), speed=-metre)
        operators, found = jc.delassus(here, state), jc.contact_forces(here, state, mu)
        count = jc.solutions(operators, 4 * mu, -jnp.ones(2, dtype)).count
        return *thresholds(operators), found.normal / newton, found.status, count

    critical, bound, normal, status, count = over(at, units)
    one = UNITS[dtype].index(0)
    for measured in (critical, bound, normal):
        np.testing.assert_allclose(measured, np.broadcast_to(measured[one], measured.shape), rtol=16 * eps_of(dtype))
    assert np.all(status == jc.Status.SOLVED)
    assert np.all(count == 3)


@pytest.mark.slow
def test_one_support_counted_four_times_carries_the_load_once_whatever_ties():
    """M of ones, every q of zeros and minus ones: the forces add up to one if anything is to be carried."""
    q = -np.array(list(product((0.0, 1.0), repeat=4)))
    for dtype in DTYPES:

        def answer(q, dtype=dtype):
            found = jc.solve(jc.LCP(jnp.ones((4, 4), dtype), q), jc.Lemke())
            return found.status, found.z, found.w

        status, z, w = over(answer, q.astype(dtype))
        assert set(status) <= {jc.Status.SOLVED, jc.Status.REDUNDANT}
        assert np.all(z >= 0)
        total = -q.min(axis=1)
        np.testing.assert_allclose(z.sum(axis=1), total, rtol=4 * eps_of(dtype))
        np.testing.assert_allclose(w, total[:, None] + q, atol=4 * eps_of(dtype))


@pytest.mark.slow
def test_a_hundred_contacts_are_solved_and_what_looks_at_every_vertex_says_that_it_cannot():
    M, q = zigzag(100)
    exact = np.linalg.solve(M, -q)
    assert exact.min() > 0  # every contact presses, so this is the solution: sym M is positive definite
    assert np.linalg.eigvalsh(M + M.T).min() > 0
    condition = np.linalg.cond(M)
    for dtype in DTYPES:
        found = jc.solve(jc.LCP(jnp.asarray(M, dtype), jnp.asarray(q, dtype)), jc.Lemke())
        assert found.status == jc.Status.SOLVED
        np.testing.assert_allclose(found.z, exact, atol=8 * eps_of(dtype) * condition * exact.max())
        # Relative to the load, and the forces at the bottom are a hundred loads.
        assert float(found.residual) <= 8 * eps_of(dtype) * exact.max() / abs(q).max()
    contacts = tuple(jc.Contact(str(i), "unilateral", True) for i in range(100))
    here = jc.Delassus(N=jnp.eye(100), T=jnp.eye(100), w=jnp.asarray(q), L=None, terms=None, contacts=contacts)
    with pytest.raises(ValueError, match="critical_bracket"):
        jc.bounds.critical(here)
    with pytest.raises(ValueError, match="at most 10 pairs"):
        jc.solutions(here, jnp.ones(100), jnp.ones(100))


@pytest.mark.slow
def test_a_thousand_contacts_are_solved():
    M, q = zigzag(1000)
    exact = np.linalg.solve(M, -q)
    found = jc.solve(jc.LCP(jnp.asarray(M), jnp.asarray(q)), jc.Lemke())
    assert found.status == jc.Status.SOLVED
    np.testing.assert_allclose(found.z, exact, atol=8 * eps_of(np.float64) * np.linalg.cond(M) * exact.max())


def boxes(tall, side_by_side):
    """(M, q, forces) of columns of boxes without friction: M = J inv(mass) J', q = -J g; a force is the weight above.

    One, two, one, two ... kilograms from the floor up, so that M has no rounding; J takes a gap from the one below.
    """
    mass = np.tile(2.0 ** (np.arange(tall) % 2), side_by_side)
    J = np.eye(mass.size) - np.diag(np.arange(1, mass.size) % tall != 0, -1)
    above = np.cumsum(mass.reshape(side_by_side, tall)[:, ::-1], axis=1)[:, ::-1]
    return J @ (J.T / mass[:, None]), -9.81 * J.sum(axis=1), 9.81 * above.ravel()


@pytest.mark.parametrize(
    ("tall", "side_by_side", "method", "roundings"),
    [
        pytest.param(1000, 1, jc.PrincipalPivoting(), 1000, id="one column, pivoting"),
        pytest.param(5, 200, jc.PrincipalPivoting(), 5, id="many columns, pivoting"),
        # It stops at a backward error of four roundings; the condition of a column of five is 49.
        pytest.param(5, 200, jc.ProjectedGaussSeidel(), 4 * 49, id="many columns, Gauss-Seidel"),
    ],
)
def test_a_thousand_contacts_without_friction_carry_the_weight_above(tall, side_by_side, method, roundings):
    """Promised of a thousand contacts, in one column or in many: SOLVED, with a backward error below 1e-13, and every
    force the weight above it. Pivoting loses at most one rounding of the greatest force for each box of a column;
    Gauss-Seidel, as it comes with its thousand sweeps, manages columns of five boxes."""
    M, q, forces = boxes(tall, side_by_side)
    found = jc.solve(jc.LCP(jnp.asarray(M), jnp.asarray(q)), method)
    assert found.status == jc.Status.SOLVED
    assert float(found.backward_error) <= 1e-13
    np.testing.assert_allclose(found.z, forces, rtol=0, atol=roundings * eps_of(np.float64) * forces.max())
    assert np.all(found.active)


def test_a_column_of_a_thousand_boxes_is_beyond_a_thousand_sweeps_and_they_say_so():
    """Promised: MAX_STEPS and NaN, never a wrong force. Of equal boxes the slowest part of the error shrinks by
    cos^2(pi / (2 tall)) in a sweep: six digits take 14 / (pi / 2000)^2, some six million sweeps."""
    M, q, _ = boxes(1000, 1)
    found = jc.solve(jc.LCP(jnp.asarray(M), jnp.asarray(q)), jc.ProjectedGaussSeidel())
    assert found.status == jc.Status.MAX_STEPS
    assert np.all(np.isnan(found.z))
    assert np.all(np.isfinite(found.attempt))
