"""The walls of the house: imports run downwards only, and a room says in one line what it is for."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "jaxcontact"

MAY_IMPORT = {
    "linalg": set(),
    "native": set(),
    "complementarity": {"linalg", "native"},
    "dynamics": {"linalg"},
    "contact": {"linalg", "dynamics", "complementarity", "bounds"},
    "bounds": {"linalg", "dynamics"},
    "mechanisms": {"dynamics"},
    "atlas": {"linalg"},
    "figures": {"linalg", "dynamics", "complementarity", "contact", "bounds", "mechanisms", "atlas"},
    "commands": {
        "linalg",
        "native",
        "dynamics",
        "complementarity",
        "contact",
        "bounds",
        "mechanisms",
        "atlas",
        "figures",
    },
}
"""Which rooms each room may import from; `__init__` and `__main__` may import all."""

OPTIONAL = {"matplotlib", "xarray", "tqdm", "h5netcdf", "pandas"}
"""Extras: the only packages that may be imported inside a function."""

NEEDS_AN_EXTRA = "jaxcontact.figures"
"""Our own room that cannot be entered without matplotlib."""


def files():
    return sorted(PACKAGE.rglob("*.py"))


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(path: Path) -> list[tuple[ast.stmt, str]]:
    """Every import statement with the absolute name of the module it takes from."""
    package = ("jaxcontact", *path.relative_to(PACKAGE).parts[:-1])
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [(node, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*base, *filter(None, [node.module])))
            names = [alias.name for alias in node.names]
            found += [(node, module if node.module or not node.level else f"{module}.{name}") for name in names]
            if module == "jaxcontact":
                found += [(node, f"jaxcontact.{name}") for name in names]
    return found


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_downwards_only(path):
    room = room_of(path)
    if room in ("__init__", "__main__"):
        return
    assert room in MAY_IMPORT, f"the room {room!r} has no place in the plan of the house"
    for _, module in imports_of(path):
        parts = module.split(".")
        if parts[0] == "jaxcontact" and len(parts) > 1 and (PACKAGE / parts[1]).with_suffix("").name:
            neighbour = parts[1]
            known = (PACKAGE / neighbour).exists() or (PACKAGE / f"{neighbour}.py").exists()
            assert not known or neighbour == room or neighbour in MAY_IMPORT[room], f"{room} may not import {module}"


def test_imports_stand_at_the_top_but_for_optional_packages():
    for path in files():
        functions = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.FunctionDef | ast.Lambda)]
        inside = {line for f in functions for line in range(f.lineno, f.end_lineno + 1)}
        for node, module in imports_of(path):
            optional = module.split(".")[0] in OPTIONAL or module.startswith(NEEDS_AN_EXTRA)
            assert node.lineno not in inside or optional, f"{path.name}: {module} is imported inside a function"


def test_every_file_opens_with_a_caption():
    for path in files():
        caption = (ast.get_docstring(ast.parse(path.read_text())) or "").splitlines()
        assert caption, f"{path} has no docstring"
        assert caption[0].endswith((".", ":")), f"{path}: {caption[0]!r} is no sentence"


def test_the_library_sets_no_jax_switch():
    for path in files():
        calls = [ast.unparse(n.func) for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        if room_of(path) not in ("commands", "__main__"):
            assert "jax.config.update" not in calls, path


def test_no_file_is_a_drawer_for_odds_and_ends():
    assert not {path.stem for path in files()} & {"utils", "misc", "helpers", "common"}


@pytest.mark.parametrize("path", files(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_extremum_may_lose_nan(path):
    """XLA's reductions do on a CPU (see `linalg.extrema`): only there are they called."""
    if path.name == "extrema.py":
        return
    assert not {name for name in ("jnp.max(", "jnp.min(", "jnp.amax(", "jnp.amin(") if name in path.read_text()}
