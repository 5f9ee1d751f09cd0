"""Certificates, and every erratum B1 to B14: the printed statement fails, the corrected one holds."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference import table, tables
from scipy.optimize import linprog
from systems import operators_of, random_factors, solutions_of

import jaxcontact as jc
from jaxcontact.bounds import Verdict, certify, critical, explain, prop10, redundancy
from jaxcontact.bounds.redundancy import determined_by_constraints, missed
from jaxcontact.mechanisms import (
    ArticulatedPainleveKlein,
    FlexiblePainleveKlein,
    GuidedRod,
    GuidedRodUnderCeiling,
    PainleveKlein,
    PainleveRod,
)

YES, NO = int(Verdict.YES), int(Verdict.NO)


def at(mechanism, **chart):
    return jc.delassus(mechanism, mechanism.state(**chart))


def stated(kinds, G, c, H=None, M=None):
    """Operators of a system that is its gradients and their drift."""
    G = jnp.asarray(G, float)
    n, m = G.shape
    terms = jc.Terms(
        M=jnp.eye(n) if M is None else jnp.asarray(M),
        F=jnp.zeros(n),
        G=G,
        H=jnp.zeros((n, m)) if H is None else jnp.asarray(H),
        c=jnp.asarray(c, float),
        slip=jnp.ones(m),
        gap=jnp.zeros(m),
        gap_rate=jnp.zeros(m),
    )
    L = jnp.linalg.cholesky(terms.M)
    N, T = jnp.linalg.solve(L, terms.G), jnp.linalg.solve(L, terms.H)
    plain = operators_of(N, T, kinds, terms.c)
    return jc.Delassus(N=N, T=T, w=terms.c, L=L, terms=terms, contacts=plain.contacts)


PARABOLAS = ("Bu", [[1.0, 1.0], [0.0, 0.0]], [-1.0, -2.0])
"""Erratum B2: h_b = x - y^2/2, h_u = x - y^2 at the origin, velocity (0, 1): gradients (1, 0), c = (-1, -2)."""


def test_b1_the_difference_of_coefficients_does_not_decide_under_gravity():
    guides = PainleveKlein(gravity=9.81)
    here = at(guides, theta=np.pi / 4)
    mu, xi = np.array([1.5, 1.5]), np.array([-1.0, -1.0])
    assert abs(mu[0] - mu[1]) < 2  # printed: unique, since |mu_1 - mu_2| < 2 cot theta
    found = solutions_of(np.asarray(here.W), np.asarray(here.Wt), np.asarray(here.w), mu * xi, "bb")
    np.testing.assert_allclose(
        sorted(x[0] for x in found), [row[0] for row in tables()["pk_three_solutions"]["lambdas"]]
    )
    assert int(certify(here, jnp.asarray(mu))["exact"][1]) == NO
    assert int(certify(here, jnp.array([0.9, 1.0]))["exact"][1]) == YES  # corrected: mu_1 + mu_2 < 2 cot theta


@pytest.mark.parametrize("key", ["prop7", "prop8", "cor1"])
def test_b2_b3_b4_two_parabolas_satisfy_the_printed_conditions_and_have_no_solution(key):
    kinds, G, c = PARABOLAS
    # Printed 7(v): lambda >= 0 with G_u lambda = 0 is lambda = 0 alone, and then lambda c_u >= 0. 7(vii): MFCQ of h_u.
    assert np.linalg.matrix_rank(np.asarray(G)[:, 1:]) == 1
    # Printed 8: a free z with G_u^T z + c_u >= 0 exists, z = (2, 0).
    # The contact LCP: A_c = 0, w_c = c_u - c_b = -1 < 0, so 0 <= lambda, 0 lambda - 1 >= 0 has no solution.
    _, holds, margin = certify(stated(kinds, G, c), jnp.zeros(2))[key]
    assert int(holds) == NO
    # The two gaps cannot both be kept: half of the unit drift is missed at best by each.
    assert 0.4 < -float(margin) < 1.1
    assert int(certify(stated(kinds, G, [-1.0, -0.5]), jnp.zeros(2))[key][1]) == YES


def test_b5_some_mode_is_regular_whatever_the_friction():
    """det(A - A_t D) is multi-affine with mean det A > 0 over the modes: some mode is positive."""
    N, T = random_factors("bbb", 20, seed=1)
    for n, t in zip(N, T):
        modes = [np.linalg.det(n.T @ (n - 100 * t * np.array(s))) for s in itertools.product((1, -1), repeat=3)]
        assert max(modes) > 0
        np.testing.assert_allclose(np.mean(modes), np.linalg.det(n.T @ n), rtol=1e-6, atol=1e-9 * max(modes))


def test_b6_the_bound_of_9b_holds_where_the_system_is_singular():
    """M^-1 = [[1, 4], [4, 17]], G = (1, 0), H = (0, 1): (39) allows mu < 1; 1 - 4 mu vanishes at 1/4."""
    inverse = np.array([[1.0, 4.0], [4.0, 17.0]])
    here = stated("b", [[1.0], [0.0]], [0.0], H=[[0.0], [1.0]], M=np.linalg.inv(inverse))
    certificate = certify(here, jnp.array([0.5]))
    assert int(certificate["prop9b"][1]) == YES
    assert int(certificate["exact"][1]) == NO
    np.testing.assert_allclose(critical(here), 0.25, rtol=1e-12)


def test_b7_a_third_of_the_bound_is_not_needed():
    """(I - X)^-1 (I + X) is positive definite exactly when |X| < 1."""
    rng = np.random.default_rng(2)
    one = np.eye(3)
    for _ in range(50):
        X = rng.normal(size=(3, 3))
        for size in (0.999, 1.001):
            Y = X * size / np.linalg.norm(X, 2)
            K = np.linalg.solve(one - Y, one + Y)
            assert (np.linalg.eigvalsh(K + K.T)[0] > 0) == (size < 1)
    certificate = certify(at(PainleveKlein(), theta=0.9), jnp.array([0.6, 0.6]))
    assert (int(certificate["prop11"][1]), int(certificate["exact"][1])) == (NO, YES)


def test_b8_every_force_leaves_w_in_the_range_of_the_delassus_matrix():
    """Two equal gaps, F = (0, 1) outside the range of their gradients: G^T M^-1 F is in that of A_nu all the same."""
    G, F = np.array([[1.0, 1.0], [0.0, 0.0]]), np.array([0.0, 1.0])
    A = G.T @ G
    assert np.linalg.matrix_rank(np.column_stack([G, F])) > np.linalg.matrix_rank(G)
    for force in (F, np.array([3.0, 1.0])):
        w = -G.T @ force
        np.testing.assert_allclose(A @ np.linalg.lstsq(A, w, rcond=None)[0], w, atol=1e-14)


def test_b9_trivial_common_kernel_does_not_make_the_sizes_equal():
    M, F = np.eye(2), np.array([[1.0], [0.0]])
    assert M.shape[0] != F.shape[1]
    assert np.linalg.matrix_rank(np.block([[M, -F], [F.T, np.zeros((1, 1))]])) == 3
    assert int(certify(stated("B", F, [0.0]), jnp.zeros(1))["prop1i"][1]) == YES


@pytest.mark.parametrize(("w", "count"), [(1.0, 2), (0.0, 1), (-1.0, 0)])
def test_b10_a_negative_contact_matrix_still_has_solutions_for_some_loads(w, count):
    """theta = pi/4, mu = 2 > 5/3, xi = -1: A = -1/2 (table painleve_59)."""
    here = at(PainleveRod(), theta=np.pi / 4)
    W, Wt = np.asarray(here.W), np.asarray(here.Wt)
    np.testing.assert_allclose(W - Wt * -2.0, -0.5, rtol=1e-12)
    assert len(solutions_of(W, Wt, np.array([w]), np.array([-2.0]), "u")) == count


@pytest.mark.parametrize("xi", [1.0, -1.0])
def test_b11_which_load_has_no_solution_depends_on_the_sign_of_sliding(xi):
    """A_t < 0 here; above the threshold none for w < 0 and two for w > 0 if A_t xi > 0, reversed otherwise."""
    here = at(GuidedRod(), theta=np.pi / 4)
    W, Wt = np.asarray(here.W), np.asarray(here.Wt)
    assert Wt < 0
    counts = [len(solutions_of(W, Wt, np.array([w]), np.array([2.0 * xi]), "b")) for w in (-1.0, 1.0)]
    assert counts == ([0, 2] if Wt * xi > 0 else [2, 0])


def test_b12_redundant_consistent_constraints_leave_a_solution_exactly_when_the_kernels_meet_in_zero():
    M, G = np.diag([0.0, 1.0]), np.array([[1.0, 2.0], [0.0, 0.0]])
    contacts = operators_of(jnp.eye(2), jnp.zeros((2, 2)), "BB").contacts
    K = np.block([[M, -G], [G.T, np.zeros((2, 2))]])
    right = np.array([0.3, -0.7, 1.0, 2.0])
    np.testing.assert_allclose(K @ np.linalg.lstsq(K, right, rcond=None)[0], right, atol=1e-14)
    assert determined_by_constraints(M, G, contacts) == (True, True)
    across = np.array([[0.0, 0.0], [1.0, 2.0]])
    assert determined_by_constraints(M, across, contacts) == (False, False)


def test_b13_a_closed_contact_may_carry_no_force():
    """Lifted by more than its weight, the closed contact of the rod has normal force zero."""
    here = at(PainleveRod(gravity=-1.0), theta=0.9)
    (normal,) = solutions_of(np.asarray(here.W), np.asarray(here.Wt), np.asarray(here.w), np.array([0.1]), "u")
    assert normal[0] == 0.0


def test_b14_the_bound_of_proposition_10_is_exact_where_it_was_called_conservative():
    cases = [at(PainleveKlein(), theta=t) for t in (0.96, 1.2, 1.5)]
    cases += [at(ArticulatedPainleveKlein(), theta1=t) for t in (0.3, 1.0)]
    cases += [at(FlexiblePainleveKlein(), theta=0.8, d=-1.2)]
    for here in cases:
        np.testing.assert_allclose(prop10(here), critical(here), rtol=1e-12)
    assert prop10(at(PainleveKlein(), theta=0.9)) < 0.95 * critical(at(PainleveKlein(), theta=0.9))


# --- certificates


def test_a_batch_of_certificates_agrees_with_the_tables():
    rows = table("rod_bilateral_unilateral_friction")
    rod = GuidedRodUnderCeiling()
    mu = 0.5
    batch = jax.jit(jax.vmap(lambda t: certify(at(rod, theta=t), jnp.full(2, mu))))(jnp.asarray(rows["theta"]))
    for key, column in (("direct", "direct_mixed"), ("exact", "exact_box"), ("prop14", "prop14_min_over_xi")):
        _, holds, margin = batch[key]
        np.testing.assert_array_equal(holds, (rows[column] > mu).astype(int))
        np.testing.assert_allclose(margin, rows[column] / mu - 1, rtol=1e-9)
    assert np.isnan(batch["prop10"][2]).all()


def test_appendix_e_without_friction_is_about_ranks_and_compatibility():
    """One gap twice: compatible if the drift is twice too. Acceleration and G lambda stay unique (erratum B9)."""
    G = np.array([[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]])
    for c, verdict in (([1.0, 2.0], YES), ([1.0, 1.0], NO)):
        found = certify(stated("BB", G, c), jnp.zeros(2))
        assert [int(found[key][1]) for key in ("e2", "e3", "e4")] == [YES, NO, verdict]
    apart = certify(stated("Bb", [[1.0, 0.0], [0.0, 1.0]], [1.0, 1.0]), jnp.zeros(2))
    assert [int(apart[key][1]) for key in ("e2", "e3", "e4")] == [YES, YES, YES]


def test_appendix_e_with_friction_says_yes_only_where_the_matrices_have_the_rank():
    """(v): -F + P of full rank; (vi): [[M, -F + P], [F^T, 0]] regular; in every mode of signs."""
    rng = np.random.default_rng(4)
    said = np.zeros(2, int)
    judge = jax.jit(lambda G, H, mu: certify(stated("bb", G, jnp.zeros(2), H=H), mu))
    for _ in range(40):
        G, H = rng.normal(size=(2, 3, 2))
        mu = rng.uniform(0, 0.6, size=2)
        found = judge(G, H, mu)
        for i, key in enumerate(("e5", "e6")):
            if int(found[key][1]) == YES:
                said[i] += 1
                for D in itertools.product((-1.0, 1.0), repeat=2):
                    N = -G + H * mu * np.array(D)
                    whole = np.block([[np.eye(3), N], [G.T, np.zeros((2, 2))]])
                    assert np.linalg.matrix_rank(N if key == "e5" else whole) == (2 if key == "e5" else 5)
        assert int(found["e5"][1]) == int(found["prop9b"][1])
        assert int(found["e6"][1]) == int(found["prop9a"][1])
    assert np.all(said > 3)
    assert np.all(said < 40)


def test_appendix_e_looks_at_the_bilateral_contacts_of_a_mixed_system_alone():
    """The guided tip of the rod under a ceiling bears (1 + 3 c^2) / (3 s c) by itself."""
    here = at(GuidedRodUnderCeiling(), theta=0.9)
    s, c = np.sin(0.9), np.cos(0.9)
    margin = certify(here, jnp.array([0.5, 9.0]))["e6"][2]
    np.testing.assert_allclose(margin, (1 + 3 * c * c) / (3 * s * c) / 0.5 - 1, rtol=1e-12)


def test_verdicts_change_at_the_bound_and_are_undecided_on_it():
    here = at(PainleveKlein(), theta=0.9)
    r = float(critical(here))
    judge = jax.jit(lambda mu: certify(here, mu)["exact"][1])
    for share, verdict in ((1 - 1e-12, YES), (1 + 1e-12, NO), (1.0, int(Verdict.UNDECIDED))):
        assert int(judge(jnp.full(2, share * r))) == verdict


def test_friction_of_smooth_contacts_is_ignored():
    here = at(PainleveKlein(upper_frictional=False), theta=0.9)
    one, other = (certify(here, jnp.array([0.4, x])) for x in (jnp.nan, 3.0))
    np.testing.assert_array_equal(one.margin, other.margin)


def test_corollary_2_is_the_harmless_direction_of_the_painleve_rod():
    """(59): sliding with xi = +1 is harmless for theta in (0, pi/2) whatever the friction, with xi = -1 it is not."""
    here = at(PainleveRod(), theta=0.9)
    for xi, verdict in ((1.0, YES), (-1.0, NO)):
        assert int(certify(here, jnp.array([50.0]), jnp.array([xi]))["cor2"][1]) == verdict
    with pytest.raises(ValueError, match="one sign per contact"):
        certify(here, jnp.array([1.0]), jnp.ones(3))


def test_constraints_can_be_met_exactly_when_a_linear_program_says_so():
    rng = np.random.default_rng(3)
    verdicts = []
    for _ in range(60):
        # Rank two, small integers: six gaps of which one is bilateral, often contradicting one another.
        G = rng.integers(-2, 3, (3, 2)) @ rng.integers(-1, 2, (2, 5))
        c = rng.integers(-2, 4, 5)
        lp = linprog(np.zeros(3), A_ub=-G[:, 1:].T, b_ub=c[1:], A_eq=G[:, :1].T, b_eq=-c[:1], bounds=(None, None))
        if not np.all(np.any(G, axis=0)):
            continue
        miss, rounding = missed(stated("BUUUU", G, c))
        assert (miss <= rounding) == (lp.status == 0)
        verdicts.append(lp.status == 0)
    assert 0.1 < np.mean(verdicts) < 0.9


def test_a_fourth_leg_is_the_sum_of_two_less_the_third():
    """A table on four legs at the corners of a square: heave, roll and pitch; h_4 = h_1 + h_3 - h_2 in order around."""
    corners = np.array([[1, 1, -1, -1], [1, -1, -1, 1]])
    G = np.vstack([np.ones(4), corners])
    here = stated("UUUU", G, np.zeros(4), M=np.diag([2.0, 0.3, 0.7]))
    found = redundancy(here)
    assert int(found.rank) == 3
    np.testing.assert_array_equal(found.dependent, [False, False, False, True])
    np.testing.assert_allclose(found.combination[3], [1, -1, 1, 0], atol=1e-13)
    text = explain(certify(here, jnp.zeros(4)))
    assert "redundant" in text
    assert "U3 = +1 U0 -1 U1 +1 U2" in text


def test_a_tangent_cone_that_meets_the_kernel_is_seen():
    """M = diag(0, 1): floor and ceiling hold the massless direction, the floor alone does not."""
    M = np.diag([0.0, 1.0])
    both = operators_of(jnp.eye(2), jnp.zeros((2, 2)), "UU").contacts
    assert determined_by_constraints(M, np.array([[1.0, -1.0], [0.0, 0.0]]), both) == (False, True)
    assert determined_by_constraints(M, np.array([[1.0, 1.0], [0.0, 0.0]]), both) == (False, False)


def test_the_explanation_speaks_to_an_engineer_and_refuses_a_batch():
    here = at(PainleveKlein(), theta=0.9)
    safe, unsafe = (explain(certify(here, jnp.full(2, mu))) for mu in (0.3, 1.5))
    assert "Safe" in safe
    assert "grow by the factor 2.645" in " ".join(safe.split())
    assert "Not safe: the friction is 1.89 times" in unsafe
    assert max(map(len, safe.splitlines())) <= 100
    batch = jax.vmap(lambda mu: certify(here, jnp.stack([mu, mu])))(jnp.array([0.1, 0.2]))
    with pytest.raises(ValueError, match="one certificate"):
        explain(batch)
