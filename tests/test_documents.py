"""What README and notebooks promise is what runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import jaxcontact as jc

ROOT = Path(__file__).parent.parent


def readme_example() -> str:
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    return blocks[0]


def run_as_a_user(script: Path, folder: Path) -> str:
    """What a script prints in a process of its own, without the switches of the tests."""
    run = subprocess.run(
        [sys.executable, str(script)],
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_the_twenty_lines_of_the_readme_print_what_the_readme_says(tmp_path):
    """In a process of its own, with a coarser grid; the comments hold the leading digits of the printed numbers."""
    code = readme_example().replace("400)", "20)").replace("300)", "10)")
    promised = re.findall(r"^print\(.*\)\s+# (-?[\d.]+)", code, re.MULTILINE)
    assert len(promised) >= 4
    (tmp_path / "example.py").write_text(code)
    printed = run_as_a_user(tmp_path / "example.py", tmp_path)
    for line, number in zip(printed.splitlines(), promised):
        last_digit = 10.0 ** -len(number.partition(".")[2]) if "." in number else 1e-12
        assert float(line) == pytest.approx(float(number), abs=0.5 * last_digit)
    assert (tmp_path / "atlas.svg").stat().st_size > 0


LONG = {"critical_friction", "extremes"}
"""Notebooks that run for a minute or more."""


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG))
        for path in sorted((ROOT / "notebooks").glob("*.py"))
    ],
)
def test_notebooks_run(path, tmp_path):
    run_as_a_user(path, tmp_path)


def test_documents_name_only_bounds_that_exist():
    text = (ROOT / "README.md").read_text()
    for name in re.findall(r"jc\.bounds\.(\w+)", text):
        assert hasattr(jc.bounds, name), name
