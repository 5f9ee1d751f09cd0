"""The map of Painlevé's rod against the signs of theory, and the command that draws it."""

import numpy as np
import pytest

from jaxcontact.__main__ import MISUSE, main
from jaxcontact.figures.regimes import Regime, regimes
from jaxcontact.mechanisms import PainleveRod


def test_the_regimes_are_given_by_two_signs():
    """(59), erratum B10: A = 1 + 3 c^2 - 3 mu s c decides the number, w = l/2 theta'^2 s - g the side."""
    angles, rates = np.linspace(0.05, 3.0, 41), np.linspace(-7.0, 7.0, 37)
    numbers, _ = regimes(PainleveRod(length=1.3), 2.2, angles, rates)
    s, c = np.sin(angles)[:, None], np.cos(angles)[:, None]
    A = 1 + 3 * c**2 - 3 * 2.2 * s * c + 0 * rates[None, :]
    w = 0.65 * rates[None, :] ** 2 * s - 9.81
    expected = np.select(
        [(A > 0) & (w < 0), (A > 0) & (w > 0), (A < 0) & (w < 0)],
        [Regime.SLIDES, Regime.DETACHES, Regime.INCONSISTENT],
        Regime.INDETERMINATE,
    )
    np.testing.assert_array_equal(numbers.regime, expected)
    assert set(expected.ravel()) == set(Regime) - {Regime.BORDER}
    assert numbers.regime.attrs["flag_meanings"].split()[2] == "inconsistent:_no_solution"


def test_the_command_writes_a_picture(tmp_path, capsys):
    assert main(["regimes", "--friction", "1.8", "--set", "length=2", "--out", str(tmp_path / "map.png")]) == 0
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert "inconsistent" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["--friction", "-1"], ["--set", "theta=1"], ["--set", "lenght=1"]])
def test_a_command_that_makes_no_sense_is_refused(tmp_path, words, capsys):
    assert main(["regimes", *words, "--out", str(tmp_path / "map.png")]) == MISUSE
    assert "error" in capsys.readouterr().err
    assert not (tmp_path / "map.png").exists()
