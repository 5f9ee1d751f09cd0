"""`jaxcontact list [MECHANISM]`."""

import argparse
import dataclasses
import inspect

from .. import bounds
from ..dynamics import coordinates_of
from ..mechanisms import all_mechanisms
from .reading import read_class


def run_list(given: argparse.Namespace) -> None:
    """Print the mechanisms and bounds, or everything one mechanism can be asked to vary."""
    if given.mechanism:
        print("\n".join(description(read_class(given.mechanism))))
        return
    classes, named = all_mechanisms(), bounds.by_name()
    width = max(map(len, [*classes, *named])) + 2
    print("mechanisms")
    for name, cls in classes.items():
        print(f"  {name:{width}}{_first_line(cls)}")
    print("bounds")
    for name, bound in named.items():
        print(f"  {name:{width}}{_first_line(bound)}")
    print("`jaxcontact list MECHANISM` shows what can be varied.")


def description(cls: type) -> list[str]:
    """The lines on one mechanism: its docstring, its contacts, its coordinates and parameters with units.

    Example: `print("\\n".join(description(PainleveKlein)))`
    """
    lines = [cls.__name__, "", *(inspect.getdoc(cls) or "").splitlines(), "", "contacts"]
    for contact in _default(cls).contacts:
        lines.append(f"  {contact.name}: {contact.kind}, {'frictional' if contact.frictional else 'frictionless'}")
    lines += ["", "coordinates (--over, --set)"]
    arguments = inspect.signature(cls.state).parameters
    for name, coordinate in coordinates_of(cls).items():
        lines.append(_entry(name, coordinate.doc, coordinate.unit, arguments[name].default))
    lines += ["", "parameters (--over, --set) and choices (--set)"]
    for field in dataclasses.fields(cls):
        lines.append(_entry(field.name, field.metadata.get("doc", ""), field.metadata.get("unit", ""), field.default))
    return lines


def _default(cls: type) -> object:
    missing = [f.name for f in dataclasses.fields(cls) if f.default is f.default_factory is dataclasses.MISSING]
    return cls(**dict.fromkeys(missing, 1.0))


def _entry(name: str, doc: str, unit: str, default: object) -> str:
    stated = default not in (inspect.Parameter.empty, dataclasses.MISSING, None)
    value = f" = {default}" if stated else ""
    return f"  {name}{value}{f' {unit}' if unit else ''}{f': {doc}' if doc else ''}"


def _first_line(thing: object) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]
