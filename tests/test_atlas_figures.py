"""The numbers of the tutorial's figures against their closed forms (m = l = 1)."""

import numpy as np
import pytest
import xarray

from jaxcontact.__main__ import main
from jaxcontact.figures import FIGURES, FORMATS
from jaxcontact.figures.friction_plane import FIRST_ANGLE, SPACING

# The bounds come from derived terms through a Cholesky factor and singular values, the closed forms from few roundings.
# Towards the ends of the angle's range sine or cosine is 4e-3, and its rounding is magnified by as much.
CLOSE = {"rtol": 1e-12}


@pytest.fixture(scope="module")
def drawn():
    return {name: make() for name, make in FIGURES.items()}


def numbers(drawn, name):
    return drawn[name][0]


def sine_and_cosine(angle):
    return np.sin(angle.values), np.cos(angle.values)


def test_figure_4b_is_the_lesser_of_two_closed_forms_below_the_cotangent(drawn):
    table = numbers(drawn, "figure_4b")
    s, c = sine_and_cosine(table.theta)
    np.testing.assert_allclose(table.bound, np.minimum(1 / (3 * s * c), c / s), **CLOSE)
    np.testing.assert_allclose(table.exact, c / s, **CLOSE)


def test_figure_5a_follows_the_closed_forms_of_the_telescoping_rod(drawn):
    table = numbers(drawn, "figure_5a")
    double = 2 * table.theta.values
    # Rows of mathematics: d = -1.2 l, l, 1.2 l; the first one's bound is exact.
    bound = [(1.15 - np.cos(double)) / np.sin(double), 14 / (5 * np.sin(double)), 223 / (70 * np.sin(double))]
    np.testing.assert_allclose(table.bound.transpose("d", "theta"), bound, **CLOSE)
    np.testing.assert_allclose(table.exact.sel(d=-1.2), bound[0], **CLOSE)
    np.testing.assert_allclose(table.exact.sel(d=1.0), (19 + 5 * np.cos(double)) / (5 * np.sin(double)), **CLOSE)


def test_figure_5b_has_its_pole_at_minus_two_thirds_and_is_exact_to_the_left(drawn):
    table = numbers(drawn, "figure_5b")
    d = table.d.values
    p = 3 * d + 2
    exact = 2 * (6 * d**2 + 9 * d + 4 - p / 2) / (np.sqrt(3) * np.abs(p))
    bound = np.where(d > -2 / 3, 4 * (3 * d**2 + 3 * d + 1) / (np.sqrt(3) * p), exact)
    # Next to the pole (nearest point 0.002) the coupling is a difference of numbers 300 times as large.
    np.testing.assert_allclose(table.bound, bound, rtol=1e-10)
    np.testing.assert_allclose(table.exact, exact, rtol=1e-10)


def test_figure_6a_is_the_cotangent_twice(drawn):
    table = numbers(drawn, "figure_6a")
    s, c = sine_and_cosine(table.theta1)
    np.testing.assert_allclose(table.bound, c / s, **CLOSE)
    np.testing.assert_allclose(table.exact, c / s, **CLOSE)


def test_figure_6b_is_the_closed_form_of_the_bent_rod(drawn):
    table = numbers(drawn, "figure_6b")
    first = table.theta1.values
    second = np.arcsin(1 - np.sin(first))
    C, S = np.cos(2 * np.array([first, second])), np.sin(2 * np.array([first, second]))
    gamma, sigma = np.cos(2 * (first - second)), np.sin(2 * (first - second))
    above = 164 + 48 * C.sum(0) - 36 * gamma - np.sqrt(3600 * (C[0] - C[1]) ** 2 + (36 * gamma - 4) ** 2)
    below = np.sqrt(2304 * S.sum(0) ** 2 + 1296 * sigma**2) + 60 * np.abs(S[0] - S[1])
    # The arcsine near 1 turns a rounding into its square root: at 4e-3 from the end, 1e-16 / 9e-2.
    np.testing.assert_allclose(table.bound, above / below, rtol=1e-11)
    # At 30 degrees, which is a point of the grid only to rounding, bound and exact value meet; a kink has slope 5/2.
    assert np.all(table.exact >= table.bound * (1 - 1e-12))
    straight = table.sel(theta1=np.pi / 6, method="nearest")
    np.testing.assert_allclose([straight.bound, straight.exact], np.sqrt(3), atol=2.5 * np.pi / 800)


def test_figure_4a_has_a_square_in_a_triangle_in_a_strip(drawn):
    plane = numbers(drawn, "figure_4a")
    mu_1, mu_2 = np.meshgrid(plane.mu_1, plane.mu_2, indexing="ij")
    # cot(45 degrees) = 1: margins of |mu_1 - mu_2| < 2, mu_1 + mu_2 < 2 and max(mu_1, mu_2) < 2/3.
    # At mu_1 = mu_2 the coupling is nilpotent: its double eigenvalue zero comes out as the square root of rounding.
    np.testing.assert_allclose(plane.strip, np.abs(mu_1 - mu_2) / 2, rtol=1e-12, atol=1e-7)
    np.testing.assert_allclose(plane.triangle, (mu_1 + mu_2) / 2, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(plane.square, np.maximum(mu_1, mu_2) * 1.5, **CLOSE)


@pytest.mark.parametrize("name", ["figure_3a", "figure_3b", "figure_7"])
def test_at_the_marks_of_a_scalar_picture_both_sides_agree(drawn, name):
    picture = numbers(drawn, name)
    at = picture.solution.values
    right = np.where(np.isnan(at), np.nan, at if name == "figure_3b" else 0.0)
    if name == "figure_7":  # take-off: no force, positive acceleration
        right = np.where(at == 0, picture["load"].values[:, None, None], right)
    np.testing.assert_allclose(picture.height, right, atol=1e-14)


@pytest.mark.parametrize("name", ["figure_3a", "figure_7"])
def test_below_the_critical_friction_one_solution_above_it_none_or_two(drawn, name):
    counts = np.isfinite(numbers(drawn, name).solution).sum("branch")
    # Rows: w < 0, w > 0; columns: below, at and above the critical friction (errata B10, B11).
    np.testing.assert_array_equal(counts, [[1, 0, 0], [1, 1, 2]])


def test_the_bound_of_the_rod_reaches_a_share_of_the_exact_threshold_that_depends_on_its_angle_alone(drawn):
    share = numbers(drawn, "conservativeness_rod").share
    with np.errstate(invalid="ignore"):
        theta = np.arcsin((share.spacing / share.length).values)
    # min(1 / (3 sin cos), cot) / cot; upright or too short a rod has no value. Next to upright (sine 1 - 1 / 360) the
    # cosine is 0.07 and the rounding of the sine is magnified two hundred times.
    expected = np.where(theta < np.pi / 2, np.minimum(1 / (3 * np.cos(theta) ** 2), 1), np.nan)
    np.testing.assert_allclose(share.transpose(*(share.spacing.dims + share.length.dims)), expected, rtol=1e-11)


def test_the_map_of_two_links_follows_their_printed_matrices(drawn):
    share = numbers(drawn, "conservativeness_links").share
    sine = 2 * share.spacing - np.sin(share.theta1)  # of the second angle
    clear = abs(sine - 1) > 1e-12
    assert bool((np.isfinite(share) == (sine < 1)).where(clear, True).all())
    few = share.isel(theta1=slice(5, None, 23), spacing=slice(7, None, 23)).stack(place=("theta1", "spacing"))
    few = few[np.isfinite(few.values)]
    expected = []
    for theta1, spacing in few.place.values:
        A, At = links_by_hand(theta1, np.arcsin(2 * spacing - np.sin(theta1)))
        (a, b), (c, d) = np.linalg.solve(A, At)
        d = d if b * c >= 0 else -d
        exact = 2 / (abs(a + d) + np.sqrt((a - d) ** 2 + 4 * abs(b * c)))  # mathematics 3(c)
        expected.append(np.linalg.svd(A)[1][-1] / np.linalg.svd(At)[1][0] / exact)
    assert len(expected) > 150
    np.testing.assert_allclose(few, expected, rtol=1e-10)


def test_in_the_friction_plane_of_two_links_the_exact_threshold_is_where_the_determinant_vanishes(drawn):
    plane = numbers(drawn, "friction_plane")
    reach = {str(name): plane.reach.sel(region=name).values for name in plane.region.values}
    assert np.all(reach["bound"] <= reach["unique"] * (1 + 1e-12))
    assert np.all(reach["unique"] <= reach["exists"] * (1 + 1e-12))
    # The first of the four vertices D = diag(+-mu_1, +-mu_2) at which det(A - A_t D), a quadratic in r, vanishes; A and
    # A_t are the closed forms of mathematics 1.7 at theta_2 = arcsin(1 - sin theta_1).
    A, At = links_by_hand(FIRST_ANGLE, np.arcsin(2 * SPACING - np.sin(FIRST_ANGLE)))
    first = []
    for angle in plane["angle"].values:
        roots = []
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            B = At * (np.array([np.cos(angle), np.sin(angle)]) * signs)
            mixed = A[0, 0] * B[1, 1] + A[1, 1] * B[0, 0] - A[0, 1] * B[1, 0] - A[1, 0] * B[0, 1]
            roots += list(np.roots([np.linalg.det(B), -mixed, np.linalg.det(A)]))
        first.append(min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0))
    np.testing.assert_allclose(reach["unique"], first, rtol=1e-10)


def links_by_hand(theta1, theta2):
    """A and A_t of the articulated rod, m = l = 1, as the tutorial prints them (mathematics 1.7)."""
    C1, C2, S1, S2 = np.cos(2 * theta1), np.cos(2 * theta2), np.sin(2 * theta1), np.sin(2 * theta2)
    gamma, sigma = np.cos(2 * (theta1 - theta2)), np.sin(2 * (theta1 - theta2))
    cross = 36 * gamma - 4
    A = np.array([[164 + 108 * C1 - 12 * C2 - 36 * gamma, cross], [cross, 164 - 12 * C1 + 108 * C2 - 36 * gamma]])
    At = np.array([[-108 * S1 + 12 * S2, 36 * sigma], [-36 * sigma, 12 * S1 - 108 * S2]])
    return A / (41 - 9 * gamma), At / (41 - 9 * gamma)


def test_every_caption_names_the_erratum_it_corrects(drawn):
    for name, (_, picture) in drawn.items():
        if not name.startswith("figure_"):
            continue
        caption = " ".join(picture.get_supxlabel().split())
        figure = name.removeprefix("figure_")
        numbered = f"Figure {figure}" if figure.isdigit() else f"Figure {figure[:-1]}({figure[-1]})"
        assert caption.startswith(numbered), name
        assert "rrat" in caption, name


def test_figures_in_single_precision_are_refused_before_anything_is_written(tmp_path, capsys):
    assert main(["figures", "--dtype", "float32", "--out", str(tmp_path)]) == 2
    assert "need 64-bit floats" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_figures_are_written_with_their_numbers_beside_them(drawn, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(FIGURES, "figure_4b", lambda: drawn["figure_4b"])
    for other in [name for name in FIGURES if name != "figure_4b"]:
        monkeypatch.delitem(FIGURES, other)
    assert main(["figures", "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        f"figure_4b{suffix}" for suffix in (".csv", *FORMATS)
    }
    assert "3 files in" in capsys.readouterr().out
    table = np.genfromtxt(tmp_path / "out" / "figure_4b.csv", delimiter=",", names=True)
    xarray.testing.assert_equal(xarray.DataArray(table["bound"]), xarray.DataArray(drawn["figure_4b"][0].bound.values))
