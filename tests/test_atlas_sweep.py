"""Sweeps against a loop over single points, and what they refuse."""

import dataclasses
import io
import json
import sys
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

import jaxcontact as jc
from jaxcontact.atlas import sweep
from jaxcontact.mechanisms import PainleveKlein


@dataclasses.dataclass(frozen=True)
class Named:
    unit: str
    doc: str


@partial(jax.tree_util.register_dataclass, data_fields=["length", "mass", "springs"], meta_fields=["rough"])
@dataclasses.dataclass(frozen=True)
class Ladder:
    """A stand-in for a mechanism: two numbers, a row of numbers, one static choice, a chart."""

    length: float = dataclasses.field(default=2.0, metadata={"unit": "m", "doc": "ladder length"})
    mass: float = 3.0
    springs: tuple[float, ...] = (1.0, 2.0)
    rough: bool = dataclasses.field(default=True, metadata={"static": True})
    coordinates = {"theta": Named("rad", "inclination")}

    def state(self, theta, shift=0.0):
        return self.length * jnp.cos(theta) + shift


def reach(ladder, theta):
    return ladder.length * jnp.cos(theta)


def quiet(quantities, mechanism, **more):
    return sweep(quantities, mechanism, progress=False, **more)


THETA = np.linspace(0.1, 1.5, 7)


def test_an_atlas_holds_at_each_point_the_value_of_that_point():
    length = np.array([0.5, 1.0, 4.0])
    atlas = quiet({"reach": reach}, Ladder(), theta=THETA, length=length)
    assert atlas.reach.dims == ("theta", "length")
    # One rounding of the product and one of the cosine, which numpy and XLA may round differently.
    np.testing.assert_allclose(atlas.reach, np.cos(THETA)[:, None] * length, rtol=4e-16)
    assert float(atlas.reach.sel(length=4.0).isel(theta=2)) == float(atlas.reach[2, 2])


@pytest.mark.parametrize("chunk_size", [1, 4, 20, 21, 22, 1000])
def test_the_chunk_size_changes_no_value_and_a_padded_chunk_leaves_no_trace(chunk_size):
    length = np.array([0.5, 1.0, 4.0])
    atlas = quiet(
        {"number": lambda ladder, theta: 10 * theta + ladder.length}, Ladder(), theta=np.arange(7), length=length
    )
    again = quiet(
        {"number": lambda ladder, theta: 10 * theta + ladder.length},
        Ladder(),
        chunk_size=chunk_size,
        theta=np.arange(7),
        length=length,
    )
    np.testing.assert_array_equal(again.number, atlas.number)
    np.testing.assert_array_equal(again.number, 10.0 * np.arange(7)[:, None] + length)


@pytest.mark.parametrize("size", [0, 1])
def test_an_axis_may_be_empty_or_a_single_value(size):
    atlas = quiet({"reach": reach}, Ladder(), theta=THETA[:size], length=np.array([1.0, 2.0]))
    assert atlas.reach.shape == (size, 2)
    np.testing.assert_allclose(atlas.reach, np.cos(THETA[:size])[:, None] * [1.0, 2.0], rtol=4e-16)


def test_quantities_of_different_arguments_share_one_grid():
    def shifted(ladder, theta, shift):
        return ladder.state(theta, shift)

    atlas = quiet({"reach": reach, "shifted": shifted}, Ladder(), theta=THETA, shift=np.array([0.0, 5.0]))
    np.testing.assert_allclose(atlas.shifted - atlas.reach, np.broadcast_to([0.0, 5.0], (7, 2)), atol=1e-15)


def test_a_quantity_that_takes_any_coordinate_takes_those_of_the_chart():
    atlas = quiet({"x": lambda ladder, **at: ladder.state(**at)}, Ladder(), theta=THETA, length=[1.0])
    np.testing.assert_allclose(atlas.x[:, 0], np.cos(THETA), rtol=4e-16)
    with pytest.raises(ValueError, match=r"'thet' .*did you mean 'theta'.*'shift', 'theta'.*length.*mass"):
        quiet({"x": lambda ladder, **at: ladder.state(**at)}, Ladder(), thet=THETA)


def test_an_array_quantity_keeps_its_own_dimensions():
    def both(ladder, theta):
        return jnp.stack([jnp.cos(theta), jnp.sin(theta)])

    assert quiet({"tip": both}, Ladder(), theta=THETA).tip.dims == ("theta", "tip_0")
    both.dims = ("side",)
    atlas = quiet({"tip": both}, Ladder(), theta=THETA)
    assert atlas.tip.dims == ("theta", "side")
    np.testing.assert_allclose((atlas.tip**2).sum("side"), 1.0, rtol=1e-15)
    both.dims = ("side", "way")
    with pytest.raises(ValueError, match="returns 1 dimensions of its own and names 2"):
        quiet({"tip": both}, Ladder(), theta=THETA)


def test_units_names_and_flags_travel_with_the_numbers():
    def status(ladder, theta):
        return jnp.where(theta > 1, 2, 0).astype(jnp.int32)

    status.flags, status.long_name = {"solved": 0, "no solution": 2}, "outcome"
    atlas = quiet({"status": status}, Ladder(), theta=THETA, length=[1.0])
    assert atlas.theta.attrs == {"units": "rad", "long_name": "inclination"}
    assert atlas.length.attrs == {"units": "m", "long_name": "ladder length"}
    assert atlas.status.long_name == "outcome"
    assert atlas.status.flag_values.tolist() == [0, 2]
    assert atlas.status.flag_values.dtype == atlas.status.dtype
    assert atlas.status.flag_meanings == "solved no_solution"
    assert atlas.status.dtype == np.int32
    np.testing.assert_array_equal(atlas.status[:, 0], np.where(THETA > 1, 2, 0))


def test_the_attributes_say_where_the_numbers_come_from():
    attributes = quiet({"reach": reach}, Ladder(mass=5.0), theta=THETA, length=[1.0]).attrs
    assert attributes["mechanism"].endswith("Ladder")
    parameters = json.loads(attributes["parameters"])
    assert parameters["mass"] == 5.0
    assert parameters["rough"] is True
    assert "length" not in parameters, "a parameter that varies is no constant of the sweep"
    assert attributes["dtype"] == "float64"
    assert attributes["jax_version"] == jax.__version__


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_axes_decide_the_precision(dtype):
    atlas = quiet({"reach": reach}, Ladder(length=np.float64(2.0)), theta=THETA.astype(dtype))
    assert atlas.reach.dtype == dtype
    assert atlas.theta.dtype == dtype


def test_double_precision_is_never_rounded_silently():
    with jax.enable_x64(False):
        with pytest.raises(ValueError, match=r"jax_enable_x64"):
            quiet({"reach": reach}, Ladder(), theta=np.linspace(0.1, 1, 3))
        with pytest.raises(ValueError, match=r"jax_enable_x64"):
            quiet({"reach": reach}, Ladder(), theta=xarray.DataArray([0.1, 0.2]))
        assert quiet({"reach": reach}, Ladder(), theta=[0.1, 0.2]).reach.dtype == np.float32


@pytest.mark.parametrize(
    ("axes", "error", "message"),
    [
        ({}, ValueError, "at least one axis"),
        ({"tehta": THETA}, ValueError, r"unknown axis 'tehta' \(did you mean 'theta'\?\).*length.*mass"),
        ({"theta": THETA, "rough": [0.0, 1.0]}, ValueError, "'rough' of Ladder is static"),
        ({"theta": THETA, "springs": [0.0, 1.0]}, ValueError, "'springs' of Ladder is static or not a single number"),
        ({"length": [1.0]}, ValueError, "takes 'theta', which is not an axis"),
        ({"theta": 0.3}, TypeError, r"one row of real numbers, not shape \(\)"),
        ({"theta": [[0.3]]}, TypeError, "one row of real numbers"),
        ({"theta": [1j]}, TypeError, "one row of real numbers"),
        ({"theta": [True, False]}, TypeError, "one row of real numbers"),
        ({"theta": [0.1, np.nan]}, ValueError, "finite, entry 1 is nan"),
        ({"theta": np.ones(2, np.float16)}, ValueError, "float16: use float32 or float64"),
        ({"theta": THETA, "length": np.ones(2, np.float32)}, TypeError, "different dtypes"),
        ({"theta": np.zeros(2**16), "length": np.ones(2**16)}, ValueError, "in parts"),
        ({"theta": THETA, "chunk_size": 0}, ValueError, "at least one point"),
    ],
)
def test_an_axis_that_cannot_be_used_is_refused_with_what_can(axes, error, message):
    with pytest.raises(error, match=message):
        quiet({"reach": reach}, Ladder(), **axes)


def test_a_name_that_is_argument_and_parameter_is_refused():
    with pytest.raises(ValueError, match="both an argument of a quantity and a parameter"):
        quiet({"twice": lambda ladder, length: 2 * length}, Ladder(), length=[1.0])


def test_a_quantity_with_the_name_of_an_axis_is_refused():
    with pytest.raises(ValueError, match="has the name of an axis"):
        quiet({"theta": reach}, Ladder(), theta=THETA)


def test_a_quantity_must_be_a_function_of_the_mechanism():
    with pytest.raises(TypeError, match="must be a function"):
        quiet({"reach": 3.0}, Ladder(), theta=THETA)
    with pytest.raises(TypeError, match="its first must be the mechanism"):
        quiet({"reach": lambda: 3.0}, Ladder(), theta=THETA)


def test_a_quantity_returns_one_array():
    with pytest.raises(TypeError, match="'pair' returns a tuple: return one number or array"):
        quiet({"pair": lambda ladder, theta: (theta, theta)}, Ladder(), theta=THETA)


def test_variables_keep_the_order_of_the_quantities():
    atlas = quiet({"z": reach, "a": reach, "m": reach}, Ladder(), theta=THETA)
    assert list(atlas.data_vars) == ["z", "a", "m"]


def test_a_parameter_that_is_not_stated_may_vary():
    @partial(jax.tree_util.register_dataclass, data_fields=["gap"], meta_fields=[])
    @dataclasses.dataclass(frozen=True)
    class Guides:
        gap: float | None = None

    atlas = quiet({"width": lambda guides: 2 * guides.gap}, Guides(), gap=[2.0, 3.0])
    np.testing.assert_array_equal(atlas.width, [4.0, 6.0])


def test_a_class_that_jax_cannot_see_through_is_refused():
    class Box:
        length = 1.0

    with pytest.raises(TypeError, match="opaque to JAX"):
        quiet({"reach": reach}, Box(), theta=THETA)


def test_a_sweep_inside_a_transformation_is_refused():
    with pytest.raises(TypeError, match="outside jit"):
        jax.jit(lambda row: quiet({"reach": reach}, Ladder(), theta=row).reach.values)(THETA)


def test_one_program_serves_all_chunks():
    traced = []

    def counted(ladder, theta):
        traced.append(theta)
        return theta

    quiet({"counted": counted}, Ladder(), chunk_size=41, theta=np.linspace(0, 1, 41))
    once = len(traced)
    quiet({"counted": counted}, Ladder(), chunk_size=4, theta=np.linspace(0, 1, 41))
    assert len(traced) == 2 * once, "eleven chunks are traced as often as one"


def test_a_program_that_takes_much_memory_is_given_fewer_points(monkeypatch):
    traced = []

    def greedy(ladder, theta):
        traced.append(theta)
        return jnp.sort(jnp.cos(theta * jnp.arange(100.0)))[-2]

    expected = np.sort(np.cos(np.linspace(0, 1, 3000)[:, None] * np.arange(100.0)))[:, -2]
    quiet({"greedy": greedy}, Ladder(), theta=np.linspace(0, 1, 3000))
    once = len(traced)
    # 3000 points hold 2.4 megabytes of cosines.
    monkeypatch.setattr(sys.modules[sweep.__module__], "MEMORY", 2**20)
    atlas = quiet({"greedy": greedy}, Ladder(), theta=np.linspace(0, 1, 3000))
    assert len(traced) == once + 2 * once, "compiled again for a smaller chunk"
    np.testing.assert_allclose(atlas.greedy, expected, rtol=1e-15)


def test_a_quantity_may_be_bound_to_some_of_its_arguments():
    bound = partial(lambda ladder, theta, shift: ladder.state(theta, shift), shift=4.0)
    atlas = quiet({"x": bound}, Ladder(), theta=THETA)
    np.testing.assert_allclose(atlas.x, 4 + 2 * np.cos(THETA), rtol=4e-16)


def test_a_terminal_sees_how_many_points_are_done(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    sweep({"reach": reach}, Ladder(), theta=THETA)
    assert "/7.00 [" in sys.stderr.getvalue()
    assert "points/s" in sys.stderr.getvalue()


def test_a_sweep_says_nothing_where_there_is_no_terminal(capsys):
    sweep({"reach": reach}, Ladder(), theta=THETA)
    said = capsys.readouterr()
    assert said.out == said.err == ""


def test_a_sweep_plots_with_its_labels():
    axes = Figure().add_subplot()
    quiet({"reach": reach}, Ladder(), theta=THETA).reach.plot(ax=axes)
    assert axes.get_xlabel() == "inclination [rad]"


def test_a_bound_and_its_slope_over_an_angle_and_a_length():
    def mu_max(guides, theta):
        return jc.bounds.norm_ratio(jc.delassus(guides, guides.state(theta=theta)))

    theta = np.array([0.3, 0.7, 1.1, 1.4])
    quantities = {"mu_max": mu_max, "slope": jax.grad(mu_max, argnums=1)}
    atlas = quiet(quantities, PainleveKlein(), theta=theta, length=np.array([0.5, 1.0, 2.0]))
    # Proposition 10: 1 / (3 sin cos) up to 54.7 degrees, then cot; whatever the length.
    steep = theta < np.arccos(1 / np.sqrt(3))
    bound = np.where(steep, 2 / (3 * np.sin(2 * theta)), 1 / np.tan(theta))
    slope = np.where(steep, -4 * np.cos(2 * theta) / (3 * np.sin(2 * theta) ** 2), -1 / np.sin(theta) ** 2)
    # Derived terms, a Cholesky factor and singular values: some roundings, and as many again for the slope.
    np.testing.assert_allclose(atlas.mu_max, np.broadcast_to(bound[:, None], (4, 3)), rtol=1e-13)
    np.testing.assert_allclose(atlas.slope, np.broadcast_to(slope[:, None], (4, 3)), rtol=1e-12)
    axes = Figure().add_subplot()
    atlas.mu_max.plot(ax=axes, add_colorbar=False)
    assert " ".join(axes.get_ylabel().split()) == "angle of the rod from the horizontal [rad]"
