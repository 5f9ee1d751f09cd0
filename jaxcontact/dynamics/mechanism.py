"""The decorator that makes a class a mechanism: a frozen dataclass that JAX sees through."""

import dataclasses
import difflib
import functools
import inspect
import math
from typing import Any, dataclass_transform

import jax
import numpy as np

from .records import Coordinate


def parameter(default: float | None, unit: str = "", doc: str = "", *, positive: bool = False) -> Any:
    """A parameter of a mechanism with its unit and meaning: `mass: float = parameter(1.0, "kg", "of the rod",
    positive=True)`.

    A bare `mass: float = 1.0` works as well; this one labels the axes of sweeps and refuses values that are not
    positive.
    """
    return dataclasses.field(default=default, metadata={"unit": unit, "doc": doc, "positive": positive})


def static(default: Any, doc: str = "") -> Any:
    """A choice that is no number of the physics, such as whether a contact is rough: `rough: bool = static(True)`.

    JAX treats it as part of the program: another value is another compilation.
    """
    return dataclasses.field(default=default, metadata={"static": True, "doc": doc})


@dataclass_transform(frozen_default=True, field_specifiers=(parameter, static))
def mechanism(cls: type) -> type:
    """Make `cls` a mechanism: a frozen dataclass, registered as a pytree whose leaves are its parameters.

    The class says what it knows (design: `contacts`, `kinetic_energy` or `mass_matrix`, `potential_energy`,
    `applied_force`, `gaps`, `slips`, `state`); the rest is derived, see `jaxcontact.dynamics.terms`.

    Example:
        @jc.mechanism
        class Puck:
            mass: float = 1.0  # kg
            contacts = (jc.Contact("table", "unilateral", frictional=True),)
            def kinetic_energy(self, q, v): return 0.5 * self.mass * (v @ v)
            def gaps(self, q): return q[1:2]
            def slips(self, q, v): return v[:1]
            def state(self, x): return jc.State(jnp.array([x, 0.0]), jnp.array([1.0, 0.0]))

    Raises (when an instance is made):
        ValueError: if a parameter is NaN, or not positive where it must be.
        TypeError: if a parameter is no number.
    """
    own_check = cls.__dict__.get("__post_init__")

    def __post_init__(self):
        for field in dataclasses.fields(self):
            if not field.metadata.get("static", False):
                object.__setattr__(self, field.name, _checked(type(self).__name__, field, getattr(self, field.name)))
        if own_check is not None:
            own_check(self)

    cls.__post_init__ = __post_init__
    if "state" in cls.__dict__:
        cls.state = _naming_coordinates(cls.__dict__["state"], cls.__name__)
    cls = dataclasses.dataclass(frozen=True)(cls)
    _register(cls)
    return cls


def coordinates_of(cls: type) -> dict[str, Coordinate]:
    """The chart coordinates of a mechanism class by name: the arguments of its `state`, in order.

    `coordinates_of(PainleveKlein)["theta"].unit == "rad"`
    """
    if not hasattr(cls, "state"):
        return {}
    described = getattr(cls, "coordinates", {})
    names = [name for name in inspect.signature(cls.state).parameters if name != "self"]
    return {name: described.get(name, Coordinate()) for name in names}


def _register(cls: type) -> None:
    """Register without calling `__init__` on the way back: a tree of derivatives may hold a negative mass."""
    fields = dataclasses.fields(cls)
    data = [f.name for f in fields if not f.metadata.get("static", False)]
    meta = [f.name for f in fields if f.metadata.get("static", False)]

    def flatten(m):
        return tuple(getattr(m, name) for name in data), tuple(getattr(m, name) for name in meta)

    def flatten_with_keys(m):
        children, aux = flatten(m)
        return tuple((jax.tree_util.GetAttrKey(name), child) for name, child in zip(data, children)), aux

    def unflatten(aux, children):
        m = object.__new__(cls)
        for name, value in zip((*data, *meta), (*children, *aux)):
            object.__setattr__(m, name, value)
        return m

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)


def _checked(owner: str, field: dataclasses.Field, value: Any) -> Any:
    """A parameter value as given, plain numbers as float; NaN and forbidden signs are refused where they can be
    seen."""
    where = f"{owner}.{field.name}"
    if isinstance(value, bool | str):
        raise TypeError(f"{where} must be a number, got {value!r}")
    if isinstance(value, int | float):
        value = float(value)
    if isinstance(value, float | np.ndarray | np.generic | jax.Array) and not isinstance(value, jax.core.Tracer):
        _check_value(where, field, np.asarray(value))
    return value


def _check_value(where: str, field: dataclasses.Field, value: np.ndarray) -> None:
    unit = field.metadata.get("unit", "")
    if np.isnan(value).any():
        raise ValueError(f"{where} is NaN; give a number{f' in {unit}' if unit else ''}")
    if field.metadata.get("positive", False) and not ((value > 0) & (value < math.inf)).all():
        raise ValueError(f"{where} must be positive and finite{f' ({unit})' if unit else ''}, got {value}")


def _naming_coordinates(state, owner: str):
    """`state` that answers a mistyped coordinate with the names there are."""
    names = [name for name in inspect.signature(state).parameters if name != "self"]
    takes_any = any(p.kind is p.VAR_KEYWORD for p in inspect.signature(state).parameters.values())

    @functools.wraps(state)
    def checked(self, *args, **kwargs):
        for name in kwargs:
            if name not in names and not takes_any:
                close = difflib.get_close_matches(name, names, n=1)
                hint = f"; did you mean {close[0]!r}?" if close else ""
                raise TypeError(f"{owner}.state has no coordinate {name!r}: it takes {', '.join(names)}{hint}")
        return state(self, *args, **kwargs)

    return checked
