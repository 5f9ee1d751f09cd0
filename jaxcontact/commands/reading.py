"""From the words of a command to mechanisms, ranges, settings, bounds; a misspelling is answered with what is valid."""

import dataclasses
import difflib
import importlib.util
import inspect
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from .. import bounds
from ..dynamics import coordinates_of
from ..mechanisms import all_mechanisms

MOST_VALUES = 10**8  # in one range; more is a slip of the finger and would fill the memory
TRUTHS = {"true": True, "yes": True, "false": False, "no": False}


def read_class(word: str) -> type:
    """The class of a mechanism by its name or by `path/to/file.py:ClassName`.

    Case, hyphens and underscores of a name do not matter.

    Raises:
        ValueError: no such mechanism, file or class, or a class that is no mechanism.

    Example: `read_class("painleve-klein") is PainleveKlein`
    """
    path, colon, name = word.rpartition(":")
    if colon or word.endswith(".py"):
        return _class_of_file(Path(path or word), name if colon else "")
    known = {_plain(name): cls for name, cls in all_mechanisms().items()}
    if _plain(word) not in known:
        raise _unknown("mechanism", word, all_mechanisms(), "or write path/to/file.py:ClassName")
    return known[_plain(word)]


def read_range(word: str) -> tuple[str, np.ndarray]:
    """The name and the values of `name=start:stop:count`, in float64; `count` values, both ends included.

    Raises ValueError for anything else. Example: `read_range("theta=0.05:1.5:400")[1].size == 400`
    """
    name, equals, numbers = word.partition("=")
    try:
        start, stop, count = (kind(part) for kind, part in zip((float, float, int), numbers.split(":"), strict=True))
    except ValueError:
        equals = ""
    if not (name and equals):
        raise ValueError(f"--over {word!r} is no range: write name=start:stop:count, for example theta=0.05:1.5:400")
    if not (math.isfinite(start) and math.isfinite(stop)) or not 1 <= count <= MOST_VALUES:
        raise ValueError(f"--over {word!r}: start and stop must be finite and count at least 1, at most {MOST_VALUES}")
    return name, np.linspace(start, stop, count)


def read_settings(cls: type, words: Sequence[str]) -> tuple[dict[str, object], dict[str, float]]:
    """The fields and the coordinates that `name=value` words fix.

    Raises ValueError for a name that is neither and a value that does not fit the field.
    Example: `read_settings(PainleveKlein, ["length=1.2"]) == ({"length": 1.2}, {})`
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}
    coordinates = coordinates_of(cls)
    of_fields, of_coordinates = {}, {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"--set {word!r}: write name=value, for example length=1.2")
        check_name(cls, name, "--set")
        if name in coordinates:
            of_coordinates[name] = _number(word, value)
        else:
            of_fields[name] = _field_value(word, value, fields[name])
    return of_fields, of_coordinates


def read_bounds(words: Iterable[str]) -> dict[str, Callable]:
    """Bounds by name, in the order given. Raises ValueError. Example: `read_bounds(["norm_ratio"])`"""
    known = bounds.by_name()
    for word in words:
        if word not in known:
            raise _unknown("bound", word, known)
    return {word: known[word] for word in words}


def check_name(cls: type, name: str, option: str) -> None:
    """Raise ValueError unless `name` is a chart coordinate or a field of the mechanism."""
    coordinates, fields = list(coordinates_of(cls)), [field.name for field in dataclasses.fields(cls)]
    if name not in coordinates and name not in fields:
        close = difflib.get_close_matches(name, [*coordinates, *fields], n=1)
        raise ValueError(
            f"{option}: {cls.__name__} has no {name!r}{_hint(close)}; "
            f"coordinates: {', '.join(coordinates) or 'none'}; parameters: {', '.join(fields) or 'none'}"
        )


def check_complete(cls: type, given: Iterable[str]) -> None:
    """Raise ValueError if a coordinate or field without default is neither varied nor set."""
    state = inspect.signature(cls.state).parameters
    needed = [name for name in coordinates_of(cls) if state[name].default is inspect.Parameter.empty]
    needed += [f.name for f in dataclasses.fields(cls) if f.default is f.default_factory is dataclasses.MISSING]
    missing = [name for name in needed if name not in set(given)]
    if missing:
        raise ValueError(
            f"{cls.__name__} needs {', '.join(missing)}: "
            f"add --over {missing[0]}=START:STOP:COUNT or --set {missing[0]}=VALUE"
        )


def _class_of_file(path: Path, name: str) -> type:
    if not path.is_file():
        raise ValueError(f"there is no file {str(path)!r}; a mechanism is a name or path/to/file.py:ClassName")
    module = _module_of_file(path)
    here = {key: cls for key, cls in vars(module).items() if inspect.isclass(cls) and cls.__module__ == module.__name__}
    mechanisms = {key: cls for key, cls in here.items() if dataclasses.is_dataclass(cls) and hasattr(cls, "state")}
    if name in here and name not in mechanisms:
        raise ValueError(
            f"{name} in {path} is no mechanism: decorate it with @jaxcontact.mechanism and give it `state`"
        )
    if name not in mechanisms:
        raise _unknown(f"mechanism of {path}", name, mechanisms, f"as {path}:ClassName")
    return mechanisms[name]


def _module_of_file(path: Path):
    """Run a user's file as a module of its own, which may import its neighbours, as if run by `python file.py`."""
    name = f"jaxcontact_user_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    sys.path.insert(0, str(path.resolve().parent))
    spec.loader.exec_module(module)
    return module


def _field_value(word: str, value: str, field: dataclasses.Field) -> object:
    if isinstance(field.default, bool):
        if value.lower() not in TRUTHS:
            raise ValueError(f"--set {word!r}: {field.name} is a choice, write {field.name}=true or {field.name}=false")
        return TRUTHS[value.lower()]
    if field.metadata.get("static", False):
        return type(field.default)(value)
    return _number(word, value)


def _number(word: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"--set {word!r}: {value!r} is no number") from None


def _unknown(kind: str, word: str, valid: Iterable[str], more: str = "") -> ValueError:
    by_plain = {_plain(name): name for name in valid}
    close = [by_plain[name] for name in difflib.get_close_matches(_plain(word), by_plain, n=1)]
    named = ", ".join(by_plain.values()) or "none"
    return ValueError(f"unknown {kind} {word!r}{_hint(close)}; there are {named}{f'; {more}' if more else ''}")


def _hint(close: Sequence[str]) -> str:
    return f" (did you mean {close[0]!r}?)" if close else ""


def _plain(name: str) -> str:
    return name.lower().replace("-", "").replace("_", "")
