"""Contact forces of random scenes against brute force over all modes, for every mixture of contact kinds."""

import jax
import numpy as np
import pytest
from scenes import brute_force, gauss_projection, lane, random_scenes

import jaxcontact as jc
from jaxcontact.complementarity import Status
from jaxcontact.contact import contact_forces, solutions

COUNT = 150
SEED = 20261121
CLEAR = 1e-12  # relative margin of a mode test below which rounding may decide otherwise
CLOSE = 1e-8  # relative; the condition of a clear scene is below 1e9, eps times that is 2e-7, typically 1e-12


def contact(word):
    """ "b": bilateral, "u": unilateral; "~" behind it: frictional."""
    return jc.Contact(word, {"b": "bilateral", "u": "unilateral"}[word[0]], word.endswith("~"))


KINDS = {
    "linear": "b b",
    "absolute value": "b~ b b~",
    "complementarity": "u~ u",
    "both": "u~ b b~",
    "three to pivot": "u~ b~ b u",
}


LONG = "three to pivot"
"""A minute to compile."""


@pytest.fixture(
    scope="module",
    params=[pytest.param(kind, marks=pytest.mark.slow) if kind == LONG else kind for kind in KINDS],
)
def answered(request):
    contacts = tuple(contact(word) for word in KINDS[request.param].split())
    scenes, mu = random_scenes(contacts, COUNT, seed=SEED)

    @jax.jit
    @jax.vmap
    def both(scene, mu):
        forces = contact_forces(scene, scene.state(), mu)
        here = jc.delassus(scene, scene.state())
        return forces, solutions(here, mu, scene.slip)

    forces, every = jax.tree.map(np.asarray, both(scenes, mu))
    exact = [brute_force(contacts, lane(scenes, i), np.asarray(mu[i])) for i in range(COUNT)]
    return request.param, contacts, scenes, forces, every, exact


def test_what_is_answered_is_a_solution(answered):
    kind, _, _, forces, _, exact = answered
    for i in range(COUNT):
        found, margin = exact[i]
        if margin < CLEAR:
            continue
        if forces.status[i] == Status.SOLVED:
            assert any(np.allclose(forces.normal[i], lam, rtol=CLOSE, atol=CLOSE) for lam in found), (kind, i)
        else:
            assert np.isnan(forces.normal[i]).all()
            assert np.isnan(forces.acceleration[i]).all()


def test_nothing_solvable_is_missed_in_closed_form(answered):
    kind, _, _, forces, _, exact = answered
    if kind == "three to pivot":
        pytest.skip("Lemke may end on a ray beyond the bound")
    solvable = np.array([len(found) > 0 for found, _ in exact])
    clear = np.array([margin >= CLEAR for _, margin in exact])
    assert ((forces.status == Status.SOLVED) == solvable)[clear].all()
    assert clear.mean() > 0.9  # otherwise the test looks at too little


def test_all_solutions_are_found_once(answered):
    kind, _, _, _, every, exact = answered
    counts = np.array([len(found) for found, _ in exact])
    for i, (found, margin) in enumerate(exact):
        if margin < CLEAR:
            continue
        rows = every.normal[i][every.valid[i]]
        assert len(rows) == every.count[i] == len(found), (kind, i)
        assert all(np.isclose(rows, lam, rtol=CLOSE, atol=CLOSE).all(axis=1).any() for lam in found)
    if kind in ("absolute value", "both"):
        assert {0, 1, 2} <= set(counts)  # the family holds what can go wrong


def test_certified_uniqueness_holds(answered):
    _, _, _, forces, _, exact = answered
    counts = np.array([len(found) for found, _ in exact])
    assert (counts[forces.unique] == 1).all()
    assert forces.unique.any()


def test_the_equations_of_motion_hold(answered):
    """(36), Coulomb's law and the sign conditions, each from the scene's own terms."""
    _, contacts, scenes, forces, _, _ = answered
    for i in np.flatnonzero(forces.status == Status.SOLVED):
        s = lane(scenes, i)
        a, normal, tangential = forces.acceleration[i], forces.normal[i], forces.tangential[i]
        size = np.abs(s["M"]) @ np.abs(a) + np.abs(s["G"]) @ np.abs(normal) + np.abs(s["F"])
        miss = s["M"] @ a + s["F"] - s["G"] @ normal - s["H"] @ tangential
        assert np.abs(miss).max() <= 1e-12 * size.max()  # rounding of five terms, conditions to 1e3
        moved = s["G"].T @ a + s["c"]
        for k, kind in enumerate(contacts):
            if kind.bilateral:
                assert abs(moved[k]) <= 1e-11 * max(1.0, np.abs(a).max())
            else:
                assert normal[k] >= 0
                assert moved[k] >= -1e-11 * max(1.0, np.abs(a).max())
                assert forces.open[i, k] == (normal[k] == 0)
            if not kind.frictional:
                assert tangential[k] == 0


@pytest.mark.parametrize("words", [pytest.param("u u u", marks=pytest.mark.slow), "b u u"])
def test_gauss_principle_of_least_constraint(words):
    """Without friction the acceleration is the projection (16), (28), (29)."""
    contacts = tuple(contact(word) for word in words.split())
    scenes, mu = random_scenes(contacts, 60, n=4, seed=SEED + 1)
    forces = jax.jit(jax.vmap(lambda scene, mu: contact_forces(scene, scene.state(), mu)))(scenes, mu)
    assert (np.asarray(forces.status) == Status.SOLVED).all()
    assert np.asarray(forces.open).any()
    for i in range(60):
        np.testing.assert_allclose(
            forces.acceleration[i], gauss_projection(contacts, lane(scenes, i)), rtol=1e-9, atol=1e-9
        )  # conditions to 1e5 times eps
