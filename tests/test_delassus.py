"""Blocks and Schur complements against their definitions, in one precision above the one tested."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import table

import jaxcontact as jc
from jaxcontact.dynamics import bilateral_schur, whitened, without_frictionless_bilateral
from jaxcontact.mechanisms import GuidedRodUnderCeiling, PainleveKlein


def random_operators(contacts, n=6, seed=0):
    """Operators of random M, G, H, F, c through a mechanism that states its terms."""
    m = len(contacts)
    keys = jax.random.split(jax.random.key(seed), 5)
    R, G, H = (jax.random.normal(k, s) for k, s in zip(keys, ((n, n), (n, m), (n, m))))
    F, c = jax.random.normal(keys[3], (n,)), jax.random.normal(keys[4], (m,))
    M = R @ R.T + jnp.eye(n)

    @jc.mechanism
    class Stated:
        mass_matrix = lambda self, q: M  # noqa: E731
        bias = lambda self, q, v, t: F  # noqa: E731
        gap_gradients = lambda self, q: G  # noqa: E731
        slip_directions = lambda self, q: H  # noqa: E731
        gap_curvature = lambda self, q, v: c  # noqa: E731
        gaps = lambda self, q: 0.0 * q[:m]  # noqa: E731
        slips = lambda self, q, v: v[:m]  # noqa: E731

    Stated.contacts = contacts
    return jc.delassus(Stated(), jc.State(jnp.zeros(n))), np.asarray(M), np.asarray(G), np.asarray(H)


MIXED = (
    jc.Contact("u0", "unilateral", False),
    jc.Contact("b0", "bilateral", False),
    jc.Contact("u1", "unilateral", True),
    jc.Contact("b1", "bilateral", True),
    jc.Contact("b2", "bilateral", False),
)
B, U = [1, 3, 4], [0, 2]
# W has condition number of about 1e2 here.
ROUNDINGS = 1e-13


def test_the_named_blocks_are_the_products_of_section_1_2():
    here, M, G, H = random_operators(MIXED)
    H = H * np.array([0, 0, 1, 1, 0])
    W, Wt = G.T @ np.linalg.solve(M, G), G.T @ np.linalg.solve(M, H)
    expected = {
        "A_nb": W[np.ix_(B, B)],
        "A_tb": Wt[np.ix_(B, B)],
        "A_nu": W[np.ix_(U, U)],
        "A_tu": Wt[np.ix_(U, U)],
        "A_nbnu": W[np.ix_(B, U)],
        "A_nbtu": Wt[np.ix_(B, U)],
        "A_nutb": Wt[np.ix_(U, B)],
        "W": W,
        "Wt": Wt,
    }
    for name, block in expected.items():
        np.testing.assert_allclose(getattr(here, name), block, rtol=ROUNDINGS, atol=ROUNDINGS, err_msg=name)


def test_the_free_acceleration_is_minus_the_whitened_force_plus_curvature():
    here, M, G, _ = random_operators(MIXED)
    expected = -G.T @ np.linalg.solve(M, here.terms.F) + here.terms.c
    np.testing.assert_allclose(here.w, expected, rtol=ROUNDINGS, atol=ROUNDINGS)


def test_eliminating_frictionless_bilateral_contacts_is_the_schur_complement_of_3_2_3():
    here, *_ = random_operators(MIXED)
    gone, kept = [1, 4], [0, 2, 3]
    W, Wt, w = (np.asarray(x) for x in (here.W, here.Wt, here.w))
    back = W[np.ix_(kept, gone)] @ np.linalg.inv(W[np.ix_(gone, gone)])
    rest = without_frictionless_bilateral(here)
    assert [contact.name for contact in rest.contacts] == ["u0", "u1", "b1"]
    for found, expected in (
        (rest.W, W[np.ix_(kept, kept)] - back @ W[np.ix_(gone, kept)]),
        (rest.Wt, Wt[np.ix_(kept, kept)] - back @ Wt[np.ix_(gone, kept)]),
        (rest.w, w[kept] - back @ w[gone]),
    ):
        np.testing.assert_allclose(found, expected, rtol=ROUNDINGS, atol=ROUNDINGS)


def test_the_bilateral_distortion_is_that_of_section_2_3_2():
    here, M, G, _ = random_operators(MIXED)
    F, c = np.asarray(here.terms.F), np.asarray(here.terms.c)
    Gb, Gu, Minv = G[:, B], G[:, U], np.linalg.inv(M)
    A_inv = np.linalg.inv(Gb.T @ Minv @ Gb)
    P = np.eye(6) - Gb @ A_inv @ Gb.T @ Minv
    found = bilateral_schur(here)
    Mc_inverse = Minv @ P
    w_c = -Gu.T @ Mc_inverse @ F - Gu.T @ Minv @ Gb @ A_inv @ c[B] + c[U]  # (34) with erratum A4
    for value, expected in (
        (found.P, P),
        (found.Mc_inverse, Mc_inverse),
        (found.A_c, Gu.T @ Mc_inverse @ Gu),
        (found.w_c, w_c),
    ):
        np.testing.assert_allclose(value, expected, rtol=ROUNDINGS, atol=ROUNDINGS)


def test_the_rod_of_section_2_3_has_the_tabled_constrained_operators():
    """Erratum A5: the printed w_c has the sign of c_u flipped, invisible when theta' = 0; at theta = pi/2, A_c = 0."""
    rows = table("rod_one_bilateral_one_unilateral_frictionless")
    for i in range(len(rows["theta"])):
        theta, rate = rows["theta"][i], rows["thetadot"][i]
        rod = GuidedRodUnderCeiling(
            guide_pull=rows["f_b"][i], ceiling_pull=rows["f_u"][i], guide_frictional=False, ceiling_frictional=False
        )
        q = rod.state(theta=theta).q
        v = jnp.array([0.0, 0.5 * np.cos(theta) * rate, rate])
        parts = jax.jit(lambda rod, q, v: bilateral_schur(jc.delassus(rod, jc.State(q, v))))(rod, q, v)
        np.testing.assert_allclose(parts.A_c[0, 0], rows["A_c"][i], rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(parts.w_c[0], rows["w_c"][i], rtol=1e-12, atol=1e-14)


def test_operators_keep_their_digits_where_the_guides_nearly_coincide():
    """theta = pi/2 - 1e-5: sigma_min(W) = 6 cos^2 theta / m is 6e-10, far below the entries of W."""
    guides = PainleveKlein()
    theta = np.pi / 2 - 1e-5
    here = jc.delassus(guides, guides.state(theta=theta))
    np.testing.assert_allclose(jc.linalg.singular_value_min(here.N) ** 2, 6 * np.cos(theta) ** 2, rtol=1e-12)


def test_at_rest_the_state_reads_zero_velocity_and_says_so():
    guides = PainleveKlein()
    still, moving = guides.state(theta=0.5), guides.state(theta=0.5, speed=0.0)
    assert still.at_rest
    assert not moving.at_rest
    np.testing.assert_array_equal(still.v, np.zeros(3))
    np.testing.assert_array_equal(jax.jit(lambda s: s.v)(still), np.zeros(3))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_operators_follow_the_precision_of_the_state(dtype):
    guides = PainleveKlein()
    here = jc.delassus(guides, guides.state(theta=jnp.asarray(0.9, dtype)))
    assert {leaf.dtype.name for leaf in jax.tree.leaves(here)} == {dtype}
    without = PainleveKlein(lower_frictional=False)
    assert jc.bounds.norm_ratio(jc.delassus(without, without.state(theta=jnp.asarray(0.9, dtype)))).dtype == dtype


@pytest.mark.parametrize(
    ("dtype", "size", "tip"), [(jnp.float64, 1e150, 0.0), (jnp.float32, 1e17, 0.0), (jnp.float32, 1.0, 1e10)]
)
def test_a_mass_matrix_beyond_the_number_format_makes_every_bound_nan(dtype, size, tip):
    """m l^2 overflows, or a tip mass hides the rod: what is lost in rounding must not come back as a bound."""
    M = np.diag([1 + tip, 1 + tip, 1 / 12 + tip / 4])
    M[0, 2] = M[2, 0] = -tip * np.sin(0.9) / 2
    M[1, 2] = M[2, 1] = tip * np.cos(0.9) / 2
    with np.errstate(over="ignore"):
        M = (M * np.outer([1, 1, size], [1, 1, size]) * size).astype(dtype)
    guides = PainleveKlein()
    parts = jc.terms(guides, guides.state(theta=0.9))
    parts = jax.tree.map(lambda x: x.astype(dtype), parts)
    here = jax.jit(lambda M: whitened(replace(parts, M=M), guides.contacts))(M)
    assert jnp.isnan(jc.bounds.norm_ratio(here))
    assert jnp.isnan(jc.bounds.critical(here))
