"""The command line: what it writes, what it says, and that a mistake leaves nothing behind."""

import json
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray

from jaxcontact import native
from jaxcontact.__main__ import main

DRAWER = Path(__file__).parent / "data" / "drawer.py"
CURVE = ["curve", "PainleveKlein", "--over", "theta=0.05:1.5:30"]


def table(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def painleve_klein(theta):
    """Proposition 10 of the two rough guides, mathematics of section 3.2.2."""
    return np.minimum(1 / (3 * np.sin(theta) * np.cos(theta)), 1 / np.tan(theta))


def test_a_curve_as_csv_holds_the_bound(tmp_path, capsys):
    assert main([*CURVE, "--out", str(tmp_path / "a.csv")]) == 0
    curve = table(tmp_path / "a.csv")
    # A few roundings of the Cholesky factor and the singular values.
    np.testing.assert_allclose(curve["norm_ratio"], painleve_klein(curve["theta"]), rtol=1e-13)
    assert curve["theta"][[0, -1]].tolist() == [0.05, 1.5]
    said = capsys.readouterr()
    assert "a.csv: 30 points in" in said.out
    assert "0 without a value" in said.out
    assert said.err == "", "no progress line without a terminal"


def test_several_bounds_become_several_variables(tmp_path):
    assert main([*CURVE, "--bound", "norm_ratio", "prop11", "--bound", "prop10", "--out", str(tmp_path / "a.csv")]) == 0
    curve = table(tmp_path / "a.csv")
    assert curve.dtype.names == ("theta", "norm_ratio", "prop11", "prop10")
    np.testing.assert_allclose(curve["prop11"] * 3, curve["prop10"], rtol=1e-15)


def test_names_may_be_written_with_hyphens_and_in_any_case(tmp_path):
    assert main(["curve", "painleve-KLEIN", *CURVE[2:], "--out", str(tmp_path / "a.csv")]) == 0


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_curve_can_be_drawn(tmp_path, suffix):
    assert main([*CURVE, "--out", str(tmp_path / f"a{suffix}")]) == 0
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]


def test_set_fixes_parameters_choices_and_coordinates(tmp_path):
    words = ["--set", "length=2", "--set", "upper_frictional=no", "--set", "x=3", "--out", str(tmp_path / "a.nc")]
    assert main([*CURVE, *words]) == 0
    with xarray.open_dataset(tmp_path / "a.nc") as curve:
        parameters = json.loads(curve.attrs["parameters"])
        assert (parameters["length"], parameters["upper_frictional"]) == (2.0, False)
        assert json.loads(curve.attrs["coordinates_set"]) == {"x": 3.0}
        # One frictional guide, Proposition 12: 2 cot theta, whatever the length.
        np.testing.assert_allclose(curve.norm_ratio, 2 / np.tan(curve.theta), rtol=1e-13)


def test_an_atlas_over_a_coordinate_and_a_parameter(tmp_path, capsys):
    words = ["atlas", "FlexiblePainleveKlein", "--over", "theta=0.3:1.2:7", "--over", "length=0.5:2:5", "--set", "d=1"]
    assert main([*words, "--out", str(tmp_path / "a.nc")]) == 0
    assert "35 points" in capsys.readouterr().out
    with xarray.open_dataset(tmp_path / "a.nc") as atlas:
        assert dict(atlas.sizes) == {"theta": 7, "length": 5}
        assert atlas.theta.attrs["units"] == "rad"
        l = atlas.length
        # Proposition 10 for d > -2l/3, with d = 1.
        expected = (3 + 3 * l + l**2) / (l * (3 + 2 * l) * np.sin(atlas.theta) * np.cos(atlas.theta))
        np.testing.assert_allclose(atlas.norm_ratio, expected.transpose("theta", "length"), rtol=1e-13)


def test_single_precision_on_request_and_the_switch_is_left_as_it_was(tmp_path):
    before = jax.config.jax_enable_x64
    assert main([*CURVE, "--dtype", "float32", "--out", str(tmp_path / "a.nc")]) == 0
    assert jax.config.jax_enable_x64 == before
    with xarray.open_dataset(tmp_path / "a.nc") as curve:
        assert curve.norm_ratio.dtype == np.float32
        # cot(1.5) loses a digit: its relative condition is 1.5 / (sin cos) = 21.
        np.testing.assert_allclose(curve.norm_ratio, painleve_klein(curve.theta.values), rtol=21 * 2**-22)


def test_a_mechanism_in_a_file_of_its_own_has_curves_and_atlases(tmp_path):
    word = f"{DRAWER}:Drawer"
    assert main(["curve", word, "--over", "width=0.7:1.4:8", "--out", str(tmp_path / "a.csv")]) == 0
    curve = table(tmp_path / "a.csv")
    # For width > sqrt(2) depth the smaller eigenvalue of W is depth^2 / 2J, Wt has the norm depth (width / 2) / J: the
    # bound is depth / width, the drawer-maker's rule, whatever the mass.
    np.testing.assert_allclose(curve["norm_ratio"], 0.4 / curve["width"], rtol=1e-13)
    over = ["--over", "width=0.7:1.4:20", "--over", "depth=0.2:0.4:20", "--set", "mass=5"]
    assert main(["atlas", word, *over, "--out", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_file_may_import_its_neighbours(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "drawer_beside.py").write_text(DRAWER.read_text())
    heavy = (
        "import jaxcontact as jc\nfrom drawer_beside import Drawer\n\n{}class Heavy(Drawer):\n    mass: float = 50.0\n"
    )
    words = ["curve", f"{tmp_path / 'heavy.py'}:Heavy", "--over", "width=0.7:1:3", "--out", str(tmp_path / "a.csv")]
    (tmp_path / "heavy.py").write_text(heavy.format("@jc.mechanism\n"))
    assert main(words) == 0
    (tmp_path / "heavy.py").write_text(heavy.format(""))
    assert main(words) == 2, "a class of one's own is decorated, also where it inherits"


def test_a_bound_that_does_not_fit_the_mechanism_says_so(tmp_path, capsys):
    assert main([*CURVE, "--bound", "prop13", "--out", str(tmp_path / "a.csv")]) == 0
    said = capsys.readouterr().out
    assert "30 without a value" in said
    assert "prop13 has no value at any point" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["curve", "PainleveKlien", *CURVE[2:]],
            "'PainleveKlien' (did you mean 'PainleveKlein'?); there are GuidedRod",
        ),
        (["curve", "Nonsense", *CURVE[2:]], "or write path/to/file.py:ClassName"),
        (["curve", "no_such.py:Drawer", *CURVE[2:]], "there is no file 'no_such.py'"),
        (["curve", f"{DRAWER}:Draw", "--over", "x=0:1:2"], "'Draw' (did you mean 'Drawer'?)"),
        (["curve", f"{DRAWER}", "--over", "x=0:1:2"], "there are Drawer"),
        ([*CURVE[:2], "--over", "thet=0.1:1:3"], "no 'thet' (did you mean 'theta'?); coordinates: theta, x"),
        ([*CURVE[:2], "--over", "theta=0.1:1"], "write name=start:stop:count"),
        ([*CURVE[:2], "--over", "theta=0.1:1:many"], "write name=start:stop:count"),
        ([*CURVE[:2], "--over", "theta=0.1:inf:3"], "must be finite"),
        ([*CURVE[:2], "--over", "theta=0.1:1:0"], "count at least 1"),
        ([*CURVE[:2], "--over", "theta=0.1:1:1000000000"], "at most 100000000"),
        ([*CURVE, "--over", "theta=0.1:1:3"], "--over is given 2 times: use atlas"),
        (["atlas", *CURVE[1:]], "give --over twice"),
        (["atlas", *CURVE[1:], "--over", "theta=1:2:3"], "--over theta is given twice"),
        (["atlas", *CURVE[1:], "--over", "x=1:2:3", "--over", "length=1:2:3"], "a picture shows two coordinates"),
        ([*CURVE, "--bound", "norm_rato"], "unknown bound 'norm_rato' (did you mean 'norm_ratio'?)"),
        ([*CURVE, "--set", "lenght=1"], "no 'lenght' (did you mean 'length'?)"),
        ([*CURVE, "--set", "length"], "write name=value"),
        ([*CURVE, "--set", "length=long"], "'long' is no number"),
        ([*CURVE, "--set", "upper_frictional=2"], "write upper_frictional=true or upper_frictional=false"),
        ([*CURVE, "--set", "length=-1"], "length must be positive"),
        ([*CURVE, "--set", "theta=1"], "theta is in --over and in --set"),
        ([*CURVE, "--over", "lower_frictional=0:1:2"], "use atlas"),
        ([*CURVE[:2], "--over", "length=1:2:3"], "PainleveKlein needs theta"),
        ([*CURVE[:2], "--over", "lower_frictional=0:1:2", "--set", "theta=1"], "is static"),
    ],
)
def test_a_mistake_is_answered_in_one_line_with_what_is_valid_and_nothing_is_written(tmp_path, capsys, words, message):
    assert main([*words, "--out", str(tmp_path / "a.png")]) == 2
    said = capsys.readouterr()
    assert said.err.startswith("jaxcontact: error: ")
    assert message in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert not list(tmp_path.iterdir())


def test_a_suffix_that_cannot_be_written_is_refused_before_anything_is_computed(tmp_path, capsys):
    assert main([*CURVE, "--out", str(tmp_path / "a.pdf")]) == 2
    assert "must end in one of .nc, .csv, .png, .svg" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_reported(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main([*CURVE, "--out", str(tmp_path / "file" / "a.csv")]) == 2
    assert "jaxcontact: error: " in capsys.readouterr().err


def test_list_names_every_mechanism_and_bound(capsys):
    assert main(["list"]) == 0
    said = capsys.readouterr().out
    for name in ("GuidedRod", "PainleveKlein", "LinearBearing", "norm_ratio", "prop14"):
        assert f"  {name} " in said


def test_list_shows_what_a_mechanism_can_vary(capsys):
    assert main(["list", "PainleveKlein"]) == 0
    said = capsys.readouterr().out
    for line in ("theta rad: angle of the rod", "length = 1.0 m", "lower guide: bilateral, frictional"):
        assert line in said
    assert main(["list", f"{DRAWER}:Drawer"]) == 0
    assert "width = 0.8" in capsys.readouterr().out


def test_the_traceback_is_there_for_those_who_ask(tmp_path):
    with pytest.raises(ValueError, match="unknown mechanism"):
        main(["curve", "Nonsense", *CURVE[2:], "--traceback", "--out", str(tmp_path / "a.png")])


def test_help_has_examples_and_a_command_without_arguments_is_refused(capsys):
    with pytest.raises(SystemExit) as left:
        main(["curve", "--help"])
    assert left.value.code == 0
    assert "jaxcontact curve PainleveKlein --over theta=0.05:1.5:400 --out bound.png" in capsys.readouterr().out
    with pytest.raises(SystemExit) as left:
        main([])
    assert left.value.code == 2


def test_no_display_is_needed_and_pyplot_is_left_alone(tmp_path):
    script = (
        "import sys; from jaxcontact.__main__ import main\n"
        f"code = main({[*CURVE, '--out', str(tmp_path / 'a.png')]!r})\n"
        "sys.exit(code or 'matplotlib.pyplot' in sys.modules)"
    )
    environment = {"PATH": "", "MPLBACKEND": "tkagg", "MPLCONFIGDIR": str(tmp_path), "HOME": str(tmp_path)}
    assert subprocess.run([sys.executable, "-c", script], env=environment, check=False).returncode == 0


def test_help_loads_neither_xarray_nor_matplotlib():
    script = "import sys, jaxcontact.__main__; sys.exit(bool({'xarray', 'matplotlib', 'pandas'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_explain_puts_one_configuration_in_words(capsys):
    """At theta = 0.9 Proposition 10 stops at 0.6846, the exact threshold at cot 0.9 = 0.7936: 0.7 lies between."""
    assert main(["explain", "PainleveKlein", "--at", "theta=0.9", "--mu", "0.7"]) == 0
    rows = {line[:30].strip(): line.split() for line in capsys.readouterr().out.splitlines()}
    assert rows["Proposition 10"][-2] == "no"
    assert rows["Exact threshold"][-2] == "yes"
    assert main(["explain", "PainleveKlein", "--at", "theta=0.9", "--mu", "0.7", "0.1", "0.1"]) == 2
    assert "one for each of the 2 contacts" in capsys.readouterr().err
    assert main(["explain", "PainleveKlein", "--mu", "0.7"]) == 2
    assert "needs theta" in capsys.readouterr().err


def test_the_kernels_are_in_use_or_the_reason_is_named(capsys, monkeypatch):
    assert main(["kernels"]) == 0
    assert capsys.readouterr().out.strip() == (f"not in use: {native.reason()}" if native.reason() else "in use")
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CXX", raising=False)
    assert main(["kernels", "--build"]) == 2
    assert "no C++ compiler found" in capsys.readouterr().err
