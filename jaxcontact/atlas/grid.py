"""The points of a sweep: which names may vary, and the values they take."""

import dataclasses
import difflib
import inspect
import math
from collections.abc import Callable, Iterable, Mapping

import jax
import jax.numpy as jnp
import numpy as np

# Points are numbered by int32 inside the compiled program, which has no int64 unless the user switches x64 on.
MOST_POINTS = 2**31 - 1
SHORTEST_FLOAT = 4  # bytes; half precision cannot hold a bound (a 2x2 singular value loses every digit)


@dataclasses.dataclass(frozen=True)
class Grid:
    """The Cartesian product of named axes, the last axis running fastest."""

    axes: dict[str, np.ndarray]  # name -> (k,) values, all of one floating dtype
    parameters: tuple[str, ...]  # the axes that are fields of the mechanism; the others are arguments of the quantities

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(values.size for values in self.axes.values())

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def dtype(self) -> np.dtype:
        return next(iter(self.axes.values())).dtype

    def point(self, axes: Mapping[str, jax.Array], number: jax.Array) -> dict[str, jax.Array]:
        """The coordinates of the point of this number; `axes` are the grid's own, held by the compiled program."""
        place = jnp.unravel_index(number, self.shape)
        return {name: axes[name][i] for name, i in zip(self.axes, place, strict=True)}  # JAX sorts the names of `axes`


def read_grid(axes: Mapping[str, object], arguments: Iterable[str], mechanism: object) -> Grid:
    """Check the axes of a sweep against what may vary.

    Args:
        axes: name -> 1-D values (numbers, any unit the name has).
        arguments: names of the arguments of the quantities.
        mechanism: a dataclass registered as a pytree; its scalar data fields may vary.

    Raises:
        ValueError: no axis, an unknown or static name, NaN or infinite values, too many points, half precision.
        TypeError: values that are not one row of real numbers, axes of different dtypes.

    Example: `read_grid({"theta": [0.1, 0.2]}, {"theta"}, rod).shape == (2,)`
    """
    if not axes:
        raise ValueError("a sweep needs at least one axis: write for example theta=jnp.linspace(0.05, 1.5, 400)")
    arguments, parameters = set(arguments), scalar_parameters(mechanism)
    for name in axes:
        _check_name(name, arguments, parameters, mechanism)
    values = {name: _read_axis(name, given) for name, given in axes.items()}
    kinds = {name: str(row.dtype) for name, row in values.items() if row.dtype.kind == "f"}
    if len(set(kinds.values())) > 1:
        raise TypeError(f"the axes have different dtypes, {kinds}: convert them to one")
    dtype = np.dtype(next(iter(kinds.values()), jnp.result_type(float)))
    grid = Grid({name: row.astype(dtype) for name, row in values.items()}, tuple(n for n in axes if n in parameters))
    if grid.size > MOST_POINTS:
        raise ValueError(f"the grid has {grid.size} points, one sweep takes at most {MOST_POINTS}: sweep it in parts")
    return grid


def scalar_parameters(mechanism: object) -> tuple[str, ...]:
    """Names of the fields of a mechanism that hold one number JAX can see; the others cannot be an axis."""
    if not dataclasses.is_dataclass(mechanism):
        return ()
    leaves = [path for path, leaf in jax.tree_util.tree_leaves_with_path(mechanism) if jnp.ndim(leaf) == 0]
    seen = {path[0].name for path in leaves if len(path) == 1 and isinstance(path[0], jax.tree_util.GetAttrKey)}
    # A parameter that is None, "derived unless stated", has no leaf but may be stated.
    unset = {f.name for f in dataclasses.fields(mechanism) if getattr(mechanism, f.name) is None and not _static(f)}
    return tuple(field.name for field in dataclasses.fields(mechanism) if field.name in seen | unset)


def argument_names(quantity: Callable, mechanism: object) -> tuple[str, ...]:
    """Names of the coordinates a quantity takes after the mechanism.

    One that takes any coordinate (`**coordinates`) takes those of the mechanism's chart `state`.
    """
    _mechanism, *rest = inspect.signature(quantity).parameters.values()
    names = [p.name for p in rest if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    if any(p.kind is p.VAR_KEYWORD for p in rest) and hasattr(mechanism, "state"):
        names += [name for name in inspect.signature(mechanism.state).parameters if name not in names]
    return tuple(names)


def nearest(name: str, valid: Iterable[str]) -> str:
    """A hint ` (did you mean 'theta'?)` for a mistyped name, empty if nothing valid is close."""
    close = difflib.get_close_matches(name, list(valid), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _static(field: dataclasses.Field) -> bool:
    return field.metadata.get("static", False)


def _check_name(name: str, arguments: set[str], parameters: tuple[str, ...], mechanism: object) -> None:
    kind = type(mechanism).__name__
    if name in arguments and name in parameters:
        raise ValueError(
            f"axis {name!r} is both an argument of a quantity and a parameter of {kind}: rename the argument"
        )
    if name in arguments or name in parameters:
        return
    if dataclasses.is_dataclass(mechanism) and name in {field.name for field in dataclasses.fields(mechanism)}:
        raise ValueError(f"{name!r} of {kind} is static or not a single number: it cannot be an axis, sweep each value")
    raise ValueError(
        f"unknown axis {name!r}{nearest(name, [*arguments, *parameters])}: "
        f"the quantities take {sorted(arguments)}, {kind} has the parameters {list(parameters)}"
    )


def _read_axis(name: str, given: object) -> np.ndarray:
    if isinstance(given, jax.core.Tracer):
        raise TypeError(f"axis {name!r} is traced: call sweep outside jit, vmap and grad")
    row = np.asarray(given)
    if row.ndim != 1 or row.dtype.kind not in "iuf":
        raise TypeError(f"axis {name!r} must be one row of real numbers, not shape {row.shape} of {row.dtype}")
    if not np.all(np.isfinite(row)):
        bad = int(np.argmin(np.isfinite(row)))
        raise ValueError(f"axis {name!r} must be finite, entry {bad} is {row[bad]}")
    if row.dtype.kind == "f" and row.dtype.itemsize < SHORTEST_FLOAT:
        raise ValueError(f"axis {name!r} is {row.dtype}: use float32 or float64")
    if isinstance(given, list | tuple) and row.dtype.kind == "f":
        return row.astype(jnp.result_type(float))  # python numbers have the default precision, as everywhere in JAX
    if row.dtype.kind == "f" and row.dtype != jax.dtypes.canonicalize_dtype(row.dtype):
        raise ValueError(
            f"axis {name!r} is {row.dtype}, which JAX would round to float32: "
            "write jax.config.update('jax_enable_x64', True) first, or pass numpy.float32 values"
        )
    return row
