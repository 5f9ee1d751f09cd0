"""What the pictures show: the numbers themselves, their labels, and what has no number."""

import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

from jaxcontact.atlas import add_map, draw_atlas, draw_curve, draw_friction_plane, draw_scalar_picture
from jaxcontact.atlas.style import label, set_angle_ticks, symbol, upper_limit

THETA = np.linspace(0.05, 1.5, 60)
LENGTH = np.linspace(0.5, 2.0, 40)


def curves(**quantities):
    named = {name: ("theta", row, {"units": "1", "long_name": name}) for name, row in quantities.items()}
    return xarray.Dataset(named, {"theta": ("theta", THETA, {"units": "rad", "long_name": "inclination"})})


def surface(values, **attributes):
    coordinates = {"theta": ("theta", THETA, {"units": "rad"}), "length": ("length", LENGTH, {"units": "m"})}
    return xarray.Dataset({"bound": (("theta", "length"), values, {"units": "1", **attributes})}, coordinates)


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def drawn(figure: Figure) -> Figure:
    """Everything laid out and painted: what cannot be drawn warns, and warnings are errors."""
    figure.canvas.draw()
    return figure


def test_a_curve_shows_the_numbers_over_degrees():
    (axes,) = drawn(draw_curve(curves(bound=np.sin(THETA)))).axes
    (line,) = axes.get_lines()
    np.testing.assert_allclose(line.get_xdata(), np.degrees(THETA))
    np.testing.assert_array_equal(line.get_ydata(), np.sin(THETA))
    assert axes.get_xlabel() == r"inclination, $\theta$ (°)"
    assert axes.get_ylabel() == "bound"


def test_radians_are_labelled_as_fractions_of_pi():
    (axes,) = drawn(draw_curve(curves(bound=np.sin(THETA)), angles="rad")).axes
    np.testing.assert_array_equal(axes.get_lines()[0].get_xdata(), THETA)
    assert r"$\pi/4$" in [text.get_text() for text in axes.get_xticklabels()]
    with pytest.raises(ValueError, match="angles is 'gon'"):
        draw_curve(curves(bound=THETA), angles="gon")


def test_several_quantities_are_told_apart_by_colour_and_by_dashes():
    (axes,) = drawn(draw_curve(curves(bound=np.sin(THETA), exact=THETA, third=THETA / 2))).axes
    lines = axes.get_lines()
    assert legend(axes) == ["bound", "exact", "third"]
    assert len({line.get_color() for line in lines}) == len({line.get_linestyle() for line in lines}) == 3


def test_another_dimension_becomes_one_line_for_each_value():
    values = np.outer(np.sin(THETA), [1.0, 2.0])
    family = surface(np.zeros((60, 40))).isel(length=[0, 39])
    family["bound"] = (("theta", "length"), values)
    (axes,) = drawn(draw_curve(family)).axes
    assert legend(axes) == ["length = 0.5 m", "length = 2 m"]
    np.testing.assert_array_equal(axes.get_lines()[1].get_ydata(), values[:, 1])
    with pytest.raises(ValueError, match="40 lines are too many"):
        draw_curve(surface(np.zeros((60, 40))))


def test_a_name_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(ValueError, match=r"no 'bond': it has \['bound'\]"):
        draw_curve(curves(bound=THETA), ["bond"])
    with pytest.raises(ValueError, match=r"no 'phi': it has \['theta'\]"):
        draw_curve(curves(bound=THETA), along="phi")


def test_a_pole_does_not_flatten_the_curve():
    (axes,) = drawn(draw_curve(curves(bound=1 / np.tan(THETA)))).axes
    assert axes.get_ylim()[0] == 0
    assert np.median(1 / np.tan(THETA)) > 0.2 * axes.get_ylim()[1]
    (axes,) = drawn(draw_curve(curves(bound=1 + 0.1 * np.sin(THETA)))).axes
    assert axes.get_ylim()[1] > 1.1, "without a pole nothing is cut"


def test_infinite_and_missing_values_are_shaded_and_named():
    values = np.where(THETA > 1.2, np.inf, np.where(THETA < 0.3, np.nan, THETA))
    (axes,) = drawn(draw_curve(curves(bound=values))).axes
    assert legend(axes) == ["bound", "infinite: no limit", "no value"]
    infinite, missing = axes.patches
    assert infinite.get_x() + infinite.get_width() == pytest.approx(np.degrees(THETA[-1]))
    assert missing.get_x() == pytest.approx(np.degrees(THETA[0]))


def test_a_line_that_is_infinite_beside_a_finite_one_says_so_in_the_legend():
    (axes,) = drawn(draw_curve(curves(bound=THETA, exact=np.where(THETA > 1, np.inf, THETA)))).axes
    assert legend(axes) == ["bound", "exact (infinite in part)"]
    assert not axes.patches


@pytest.mark.parametrize("row", [np.full(60, np.nan), np.full(60, np.inf), np.zeros(60), -THETA])
def test_a_curve_without_ordinary_values_can_be_drawn(row):
    drawn(draw_curve(curves(bound=row)))


@pytest.mark.parametrize("size", [0, 1, 2])
def test_a_short_curve_can_be_drawn(size):
    drawn(draw_curve(curves(bound=THETA).isel(theta=slice(size))))


def test_a_map_shows_the_numbers_with_the_first_dimension_to_the_right():
    values = np.outer(np.sin(THETA), LENGTH)
    axes, bar = drawn(draw_atlas(surface(values, long_name="bound"))).axes
    mesh = axes.collections[0]
    np.testing.assert_array_equal(mesh.get_array().reshape(40, 60), values.T)
    assert axes.get_xlabel() == r"$\theta$ (°)"
    assert axes.get_ylabel() == "length (m)"
    assert bar.get_ylabel() == "bound"
    assert axes.texts, "contour lines carry their values"


def test_a_map_may_be_turned():
    (axes, _) = drawn(draw_atlas(surface(np.outer(THETA, LENGTH)), right="length")).axes
    assert axes.get_xlabel() == "length (m)"
    assert axes.get_ylabel() == r"$\theta$ (°)"


def test_an_axis_that_runs_backwards_is_drawn_forwards():
    values = np.outer(np.sin(THETA), LENGTH)
    forwards = draw_atlas(surface(values)).axes[0].collections[0].get_array()
    backwards = draw_atlas(surface(values).isel(theta=slice(None, None, -1))).axes[0].collections[0].get_array()
    np.testing.assert_array_equal(forwards, backwards)


def test_cells_without_a_number_are_grey_or_hatched_and_named():
    values = np.outer(np.sin(THETA), LENGTH)
    values[:5], values[-5:] = np.inf, np.nan
    axes = drawn(draw_atlas(surface(values))).axes[0]
    assert legend(axes) == ["infinite: no limit", "no value"]
    assert axes.patch.get_hatch()


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, 3.0, -1.0])
def test_a_map_of_one_value_can_be_drawn(value):
    drawn(draw_atlas(surface(np.full((60, 40), value))))


@pytest.mark.parametrize("shape", [(1, 40), (60, 1), (1, 1), (2, 2)])
def test_a_thin_map_can_be_drawn(shape):
    values = np.outer(np.sin(THETA), LENGTH)
    drawn(draw_atlas(surface(values).isel(theta=slice(shape[0]), length=slice(shape[1]))))


def test_a_wide_range_is_coloured_by_ratio():
    axes, _ = drawn(draw_atlas(surface(np.outer(1 / np.tan(THETA), LENGTH)))).axes
    assert type(axes.collections[0].norm).__name__ == "LogNorm"
    axes, _ = drawn(draw_atlas(surface(np.outer(1 + THETA, LENGTH)))).axes
    assert type(axes.collections[0].norm).__name__ == "Normalize"


def test_a_status_is_drawn_as_classes_of_which_those_that_occur_are_named():
    values = np.where(np.outer(THETA, LENGTH) > 1, 7, 0).astype(np.int32)
    flags = {"flag_values": np.array([0, 3, 7], np.int32), "flag_meanings": "solved never no_solution"}
    (axes,) = drawn(draw_atlas(surface(values, **flags))).axes
    assert legend(axes) == ["solved", "no solution"]


def test_a_map_has_two_dimensions():
    with pytest.raises(ValueError, match=r"two dimensions, 'bound' has \['theta'\]"):
        add_map(Figure().add_subplot(), curves(bound=THETA).bound)


def test_the_friction_plane_names_its_regions_the_strongest_first():
    row = np.linspace(0, 3, 31)
    total = row[:, None] + row
    names = {
        "weak": (("mu_1", "mu_2"), total / 4),
        "strong": (("mu_1", "mu_2"), total / 2, {"long_name": "strong one"}),
    }
    figure = drawn(draw_friction_plane(xarray.Dataset(names, {"mu_1": row, "mu_2": row})))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "strong one",
        "weak",
        "nothing guaranteed for every load",
    ]


def test_a_scalar_picture_counts_and_marks_the_solutions():
    force, friction = np.linspace(-1, 1, 5), np.array([1.0, 2.0])
    picture = xarray.Dataset(
        {
            "left": (("load", "friction", "force"), np.ones((1, 2, 5)), {"long_name": "acceleration", "units": "m/s²"}),
            "right": ("force", np.zeros(5), {"long_name": "zero"}),
            "solution": (("load", "friction", "branch"), [[[0.5, np.nan], [np.nan, np.nan]]]),
            "height": (("load", "friction", "branch"), [[[1.0, np.nan], [np.nan, np.nan]]]),
        },
        {"load": ("load", [-1.0], {"long_name": "w", "units": "N"}), "friction": friction, "force": force},
    )
    (axes,) = drawn(draw_scalar_picture(picture)).axes
    assert legend(axes) == ["zero", r"$\mu$ = 1: one solution", r"$\mu$ = 2: no solution"]
    assert axes.get_title() == "w = −1 N"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("theta", r"$\theta$"),
        ("theta1", r"$\theta_{\mathrm{1}}$"),
        ("mu_max", r"$\mu_{\mathrm{max}}$"),
        ("mass", "mass"),
        ("free_gap", "free gap"),
    ],
)
def test_greek_names_are_written_in_greek(name, text):
    assert symbol(name) == text


def test_a_dimensionless_quantity_carries_no_unit():
    assert label(xarray.DataArray([1.0], name="bound", attrs={"units": "1"})) == "bound"


def test_angles_get_round_ticks():
    axes = Figure().add_subplot()
    for end, step in ((np.pi / 2, 15.0), (2 * np.pi, 90.0), (np.radians(4.0), 1.0)):
        row = xarray.DataArray(np.linspace(0, end, 9), name="theta", attrs={"units": "rad"})
        set_angle_ticks(axes.xaxis, row)
        assert set(np.diff(axes.xaxis.get_major_locator().tick_values(0, np.degrees(end)))) == {step}


def test_the_upper_limit_is_that_of_the_tallest_line_that_has_no_pole():
    assert upper_limit([np.ones(10), np.full(10, 5.0)]) == pytest.approx(5.25)
    assert upper_limit([np.full(3, np.nan)]) is None
