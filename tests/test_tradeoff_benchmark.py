"""The benchmark of speed against accuracy: its exact answers, its families, its records, its picture."""

import json
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from benchmarks import _tradeoff_methods, _tradeoff_problems, tradeoff
from benchmarks._tradeoff_picture import GREATEST, drawn, front
from benchmarks._tradeoff_reference import eliminated, exact, reference

CONTACTS, COUNT = 2, 16


@pytest.fixture(scope="module")
def made():
    return _tradeoff_problems.families(CONTACTS, COUNT)


@pytest.fixture(scope="module")
def measured():
    name = _tradeoff_methods.PIVOTING
    return tradeoff.measured([CONTACTS], COUNT, {name: _tradeoff_methods.METHODS[name]})


@pytest.mark.parametrize("active", [(False, False), (True, False), (False, True), (True, True)])
def test_exact_answers_do_not_depend_on_where_the_pivoting_begins(active):
    """Cottle, Pang, Stone, section 1.1: M = (2 1; 1 2), q = (-5, -6) has z = (4/3, 7/3)."""
    z, w = exact(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0]), active)
    assert z == [4 / 3, 7 / 3]
    assert w == [0, 0]


def test_elimination_without_fractions_is_elimination():
    """The Hilbert matrix times 420, of determinant 420^4 / 6048000; the solution of a system made of (1, 2, 3, 4)."""
    K = [[420 // (i + j + 1) for j in range(4)] for i in range(4)]
    numerators, determinant = eliminated([[*row, sum(a * x for a, x in zip(row, (1, 2, 3, 4)))] for row in K])
    assert determinant == Fraction(420**4, 6048000)
    assert [Fraction(x, determinant) for x in numerators] == [1, 2, 3, 4]


def test_exact_answers_are_those_the_problem_was_made_of():
    """Murty's triangular P-matrices, dyadic data: M z + q = w without rounding."""
    rng = np.random.default_rng(0)
    M = np.eye(5) + 2 * np.tril(rng.integers(-16, 17, (COUNT, 5, 5)) / 16, -1)
    closed = rng.random((COUNT, 5)) < 0.5
    size = rng.integers(1, 64, (COUNT, 5)) / 16
    z, w = np.where(closed, size, 0), np.where(closed, 0, size)
    found = reference(M, w - np.einsum("bij,bj->bi", M, z))
    np.testing.assert_array_equal(found, (z, w))


def test_a_matrix_that_is_no_p_matrix_has_no_reference():
    """z = -1 / -1 would have to be exchanged on a negative diagonal entry."""
    assert np.isnan(reference(-np.ones((1, 1, 1)), -np.ones((1, 1)))).all()


@pytest.mark.parametrize("m", [2, 6])
def test_near_critical_problems_are_at_their_distance_from_a_vanishing_minor(m):
    """Every principal minor of W - r Y is positive up to the threshold, and one is negative right after it."""
    W, Y, threshold, critical = _tradeoff_problems.critical_systems(m, COUNT)
    assert len(W) == COUNT
    sets = [list(s) for k in range(1, m + 1) for s in combinations(range(m), k)]
    least = {
        factor: np.min([np.linalg.det((W - (factor * threshold)[:, None, None] * Y)[:, s][:, :, s]) for s in sets], 0)
        for factor in (0.5, 1 - 1e-6, 1 + 1e-6)
    }
    assert (least[0.5] > 0).all()
    assert (least[1 - 1e-6] > 0).all()
    assert (least[1 + 1e-6] < 0).all()
    for lane, members in enumerate(critical):
        part = np.ix_(members, members)
        det = [
            np.linalg.det(W[lane][part] - factor * threshold[lane] * Y[lane][part]) for factor in (1 - 1e-6, 1 + 1e-6)
        ]
        assert det[0] > 0 > det[1]


def test_families_are_what_their_names_say(made):
    symmetric = made["well conditioned"].M + made["well conditioned"].M.swapaxes(1, 2)
    assert np.linalg.eigvalsh(symmetric).min() > 0
    assert np.linalg.det(made["redundant"].M) == pytest.approx(0, abs=1e-9)  # small integers
    for name, ratio in (("stacks", 1), ("mass ratio 1e4", 1e4), ("mass ratio 1e8", 1e8)):
        M = made[name].M  # 1 / mass of the first box, and that with 1 / mass of the second, which rests on it
        masses = 1 / M[:, 0, 0], 1 / (M[:, 1, 1] - M[:, 0, 0])
        # 1 / mass of the heavy box is the difference of numbers of size one.
        np.testing.assert_allclose(np.max(masses, 0) / np.min(masses, 0), ratio, rtol=1e-15 * ratio + 1e-15)
    for problems in made.values():
        assert len(problems.q) == COUNT
        assert (problems.w >= 0).all()


def test_a_perfect_answer_has_no_error_and_a_missing_one_an_infinite_one(made):
    for name in ("stacks", "redundant"):
        problems = made[name]
        z = np.nan_to_num(problems.z)
        w = problems.w.copy()
        found = _tradeoff_methods.Found(z, w, None, None, None)
        assert np.max(tradeoff.errors(problems, found)) == 0
        z[0], w[1] = np.nan, np.nan
        error = np.maximum(*tradeoff.errors(problems, found))
        assert np.isinf(error[:2]).all()
        assert (error[2:] == 0).all()


@pytest.mark.slow
def test_every_row_counts_every_lane(measured):
    rows = measured["rows"]
    assert {r["dtype"] for r in rows} == {"float64", "float32", "mixed"}
    for r in rows:
        assert 0 <= r["within_1e-10"] <= r["within_1e-06"] <= r["within_1e-03"] <= 1
        assert ("z_error_worst" in r) == (r["family"] != "redundant")
        assert r["us_per_problem"] > 0
    easy = [r for r in rows if r["family"] in ("stacks", "well conditioned")]
    assert all(r["failed"] == 0 and r["within_1e-03"] == 1 for r in easy)


@pytest.mark.slow
def test_mixed_precision_solves_again_what_float32_could_not(measured):
    def pick(family, dtype, ending=""):
        name = _tradeoff_methods.PIVOTING + ending
        found = [r for r in measured["rows"] if (r["family"], r["dtype"], r["method"]) == (family, dtype, name)]
        return found[0]

    hard, again = "mass ratio 1e8", ", again if in doubt"
    assert pick(hard, "float32")["failed"] > 0
    assert pick(hard, "mixed", again)["failed"] == 0
    assert pick(hard, "float32")["failed"] <= pick(hard, "mixed", again)["solved_again"] < 1
    assert pick("stacks", "mixed", again)["solved_again"] == 0
    everywhere = pick(hard, "mixed", ", float64 from float32")
    assert everywhere["solved_again"] == 1
    assert everywhere["within_1e-06"] == pick(hard, "float64")["within_1e-06"]


def test_the_front_is_what_nothing_beats():
    assert front([(2, 1.0), (1, 3.0), (3, 2.0), (4, 0.5)]) == [(1, 3.0), (2, 1.0), (4, 0.5)]
    assert drawn(None) == GREATEST


@pytest.mark.slow
def test_written_measurements_can_be_joined_and_drawn(measured, tmp_path):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    first.write_text(json.dumps(measured, allow_nan=False))
    second.write_text(json.dumps({**measured, "rows": [{**r, "contacts": 9} for r in measured["rows"]]}))
    picture = tmp_path / "tradeoff.png"
    files = ["--read", str(first), str(second), "--json", str(tmp_path / "both.json")]
    tradeoff.main([*files, "--picture", str(picture), "--drawn", "9"])
    assert len(json.loads((tmp_path / "both.json").read_text())["rows"]) == 2 * len(measured["rows"])
    assert picture.stat().st_size > 10_000
