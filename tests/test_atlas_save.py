"""What is written can be read again, and a failure leaves the folder as it was."""

import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

from jaxcontact.atlas import check_path, save


def numbers(**attributes):
    status = ("theta", np.array([0, 2, 0], np.int32), {"flag_values": np.array([0, 2], np.int32)})
    bound = (("theta", "length"), np.array([[0.1, 1 / 3], [np.inf, np.nan], [1e-300, 2.0]]), {"units": "1"})
    coordinates = {"theta": ("theta", [0.1, 0.2, 0.3], {"units": "rad"}), "length": [1.0, 2.0]}
    return xarray.Dataset({"bound": bound, "status": status}, coordinates, {"dtype": "float64", **attributes})


def test_netcdf_keeps_every_number_and_label(tmp_path):
    path = save(numbers(), tmp_path / "a.nc")
    with xarray.open_dataset(path, engine="h5netcdf") as again:
        xarray.testing.assert_identical(again.load(), numbers())
        assert again.status.dtype == np.int32


def test_csv_keeps_every_digit_infinity_and_absence(tmp_path):
    table = np.genfromtxt(save(numbers(), tmp_path / "a.csv"), delimiter=",", names=True)
    assert table.dtype.names == ("theta", "length", "bound", "status")
    np.testing.assert_array_equal(table["bound"].reshape(3, 2), numbers().bound.values)
    np.testing.assert_array_equal(table["theta"].reshape(3, 2)[:, 0], numbers().theta.values)


@pytest.mark.parametrize(("suffix", "beginning"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".SVG", b"<?xml")])
def test_a_figure_is_written_in_the_format_of_its_suffix(tmp_path, suffix, beginning):
    assert save(Figure(), tmp_path / f"a{suffix}").read_bytes().startswith(beginning)


def test_the_same_picture_is_the_same_file(tmp_path):
    files = []
    for name in ("a.svg", "b.svg"):
        figure = Figure()
        figure.add_subplot().plot([0, 1], [0, 1], clip_on=True)
        files.append(save(figure, tmp_path / name).read_bytes())
    assert files[0] == files[1]


def test_a_missing_folder_is_made(tmp_path):
    assert save(numbers(), tmp_path / "deep" / "down" / "a.csv").exists()


def test_a_failure_while_writing_leaves_the_folder_as_it_was(tmp_path):
    path = save(numbers(), tmp_path / "a.nc")
    before = path.read_bytes()
    with pytest.raises(TypeError):
        save(numbers(unfit=object()), path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.nc"]


def test_an_unknown_suffix_is_refused_with_those_that_exist(tmp_path):
    with pytest.raises(ValueError, match=r"must end in one of \.nc, \.csv, \.png, \.svg"):
        save(numbers(), tmp_path / "a.pdf")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(ValueError, match="it is a folder"):
        check_path(tmp_path / "folder.csv")


def test_numbers_are_no_picture_and_a_picture_no_numbers(tmp_path):
    with pytest.raises(
        ValueError, match=r"\.png holds a figure, not a Dataset: draw it first, or save it as \.nc, \.csv"
    ):
        save(numbers(), tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"\.nc holds a dataset, not a Figure"):
        save(Figure(), tmp_path / "a.nc")
    assert not list(tmp_path.iterdir())
