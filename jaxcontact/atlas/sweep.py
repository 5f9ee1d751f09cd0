"""Quantities of a mechanism over a grid, in chunks of one compiled shape."""

import dataclasses
import inspect
import itertools
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from ..linalg import compiler_options, fused
from .grid import Grid, argument_names, read_grid
from .labels import labelled

if TYPE_CHECKING:
    import xarray

# Points computed at once. Measured over 2**20 points on two busy cores, in million points per second, for chunks of
# 2**12, 2**14, 2**16 and 2**18: a fused scalar formula 12, 27, 26, 54. Programs that stay on matrices (loops, library
# routines) are fastest while these fit in the cache: a bound of two contacts 3.8, 5.2, 5.0, 2.1.
CHUNK_POINTS = 2**14
MEMORY = 2**28  # bytes the compiled program may take for what it computes on the way

Quantity = Callable[..., jax.Array]


def sweep(
    quantities: Mapping[str, Quantity],
    mechanism: object,
    /,
    *,
    chunk_size: int = CHUNK_POINTS,
    progress: bool = True,
    **axes: object,
) -> "xarray.Dataset":
    """Evaluate quantities of a mechanism on the Cartesian product of axes.

    Args:
        quantities: name -> function(mechanism, coordinate...) for one point, returning a number or an array. What the
            function carries as attributes labels the result: `unit`, `long_name`, `dims` (names of an array's own
            dimensions), `flags` (meaning -> value of an integer status).
        mechanism: a frozen dataclass registered as a pytree.
        chunk_size: points computed at once; fewer where they would take more than `MEMORY`.
        progress: a progress line on the terminal; silent where there is none.
        axes: rows of values, named like an argument of the quantities or a scalar field of the mechanism. Whole numbers
            are taken as real. Their dtype is the dtype of the computation: the mechanism's numbers follow it.

    Returns:
        A dataset with one dimension per axis in the order given; the variables keep the dtype their function returns.

    Raises:
        ValueError, TypeError: an axis or a quantity that cannot be used; the message names what can.

    Example: `sweep({"mu_max": bound}, rod, theta=jnp.linspace(0.05, 1.5, 400), length=[0.5, 1.0]).mu_max.plot()`
    """
    if chunk_size < 1:
        raise ValueError(f"chunk_size is {chunk_size}: it must be at least one point")
    if any(leaf is mechanism for leaf in jax.tree.leaves(mechanism)):
        raise TypeError(f"{type(mechanism).__name__} is opaque to JAX: decorate the class with @jaxcontact.mechanism")
    arguments = {name: _arguments(name, quantity, mechanism) for name, quantity in quantities.items()}
    grid = read_grid(axes, (name for names in arguments.values() for name in names), mechanism)
    _check_all_given(arguments, quantities, grid)
    at_point = _at_point({name: _of_point(quantities[name], names, grid) for name, names in arguments.items()}, grid)
    by_name = _run(at_point, _with_dtype(mechanism, grid.dtype), grid, min(chunk_size, max(grid.size, 1)), progress)
    values = {name: by_name[name] for name in quantities}  # JAX sorts the names; the user's order is the dataset's
    return labelled(values, quantities, mechanism, grid)


def _at_point(quantities: Mapping[str, Callable], grid: Grid) -> Callable:
    """All quantities as one function of the mechanism and the coordinates of one point."""

    def at_point(mechanism, point):
        changed = {name: point[name] for name in grid.parameters}
        here = dataclasses.replace(mechanism, **changed) if changed else mechanism
        return {name: _one_array(name, quantity(here, point)) for name, quantity in quantities.items()}

    return at_point


def _of_point(quantity: Quantity, names: tuple[str, ...], grid: Grid) -> Callable:
    """A quantity as a function of the mechanism and a point, from which it takes its own arguments.

    By position as far as they go, for `jax.grad` counts its `argnums` by position; then by name.
    """
    given = [name for name in names if name in grid.axes]
    signature = inspect.signature(quantity).parameters

    def positional(name):
        return (
            name in grid.axes and name in signature and signature[name].kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
        )

    leading = list(itertools.takewhile(positional, names))
    others = [name for name in given if name not in leading]
    return lambda mechanism, point: quantity(
        mechanism, *(point[name] for name in leading), **{name: point[name] for name in others}
    )


def _run(at_point: Callable, mechanism: object, grid: Grid, chunk: int, progress: bool) -> dict[str, np.ndarray]:
    """The values (axes..., own dimensions...) of each quantity, by one program of fixed shape called in a loop."""
    if grid.size == 0:
        point = {name: jax.ShapeDtypeStruct((), grid.dtype) for name in grid.axes}
        shapes = jax.eval_shape(at_point, mechanism, point)
        return {name: np.empty(grid.shape + shape.shape, shape.dtype) for name, shape in shapes.items()}

    axes = {name: jnp.asarray(row) for name, row in grid.axes.items()}
    program, shapes, chunk = _compiled(at_point, mechanism, axes, grid, chunk)
    values = {name: np.empty((grid.size, *shape.shape[1:]), shape.dtype) for name, shape in shapes.items()}
    for first in _with_progress(range(0, grid.size, chunk), chunk, grid.size, progress):
        wanted = min(chunk, grid.size - first)
        for name, computed in program(mechanism, axes, np.int32(first)).items():
            values[name][first : first + wanted] = np.asarray(computed)[:wanted]
    return {name: rows.reshape(grid.shape + rows.shape[1:]) for name, rows in values.items()}


def _compiled(at_point: Callable, mechanism: object, axes: dict, grid: Grid, chunk: int) -> tuple[Callable, dict, int]:
    """The program of one chunk, the shapes of its answers, and its points: fewer than asked if they take too much."""

    def of_chunk(mechanism, axes, first):
        # The last chunk is padded with its last point, which is harmless: its values are computed anyway.
        numbers = jnp.minimum(first + jnp.arange(chunk, dtype=jnp.int32), jnp.int32(grid.size - 1))
        points = jax.vmap(lambda number: grid.point(axes, number))(numbers)
        return jax.vmap(lambda point: fused(at_point, final=True)(mechanism, point))(points)

    lowered = jax.jit(of_chunk).lower(mechanism, axes, np.int32(0))  # traced once; tracing is half of the wait
    program = lowered.compile(compiler_options())
    analysis = program.memory_analysis()  # None where the device does not tell
    needed = analysis.temp_size_in_bytes if analysis else 0
    if needed > MEMORY and chunk > 1:
        return _compiled(at_point, mechanism, axes, grid, max(1, chunk * MEMORY // needed))
    return program, lowered.out_info, chunk


def _one_array(name: str, value: object) -> jax.Array:
    leaves = jax.tree.leaves(value)
    if len(leaves) != 1 or leaves[0] is not value:
        raise TypeError(f"quantity {name!r} returns a {type(value).__name__}: return one number or array of it")
    return jnp.asarray(value)


def _with_progress(starts: range, chunk: int, size: int, progress: bool) -> Iterable[int]:
    """The same starts, showing on a terminal how many points are done."""
    if not (progress and sys.stderr.isatty()):
        yield from starts
        return
    from tqdm import tqdm

    with tqdm(total=size, unit=" points", unit_scale=True, leave=False) as line:
        for first in starts:
            yield first
            line.update(min(chunk, size - first))


def _with_dtype(mechanism: object, dtype: np.dtype) -> object:
    """The mechanism with its real numbers in the dtype of the axes."""

    def follow(leaf):
        return jnp.asarray(leaf, dtype) if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else leaf

    return jax.tree.map(follow, mechanism)


def _arguments(name: str, quantity: Quantity, mechanism: object) -> tuple[str, ...]:
    if not callable(quantity):
        raise TypeError(f"quantity {name!r} must be a function of the mechanism and coordinates, not {quantity!r}")
    if not inspect.signature(quantity).parameters:
        raise TypeError(f"quantity {name!r} takes no argument: its first must be the mechanism")
    return argument_names(quantity, mechanism)


def _check_all_given(arguments: Mapping, quantities: Mapping[str, Quantity], grid: Grid) -> None:
    for name, names in arguments.items():
        if name in grid.axes:
            raise ValueError(f"quantity {name!r} has the name of an axis: rename one of them")
        signature = inspect.signature(quantities[name]).parameters
        for argument in names:
            optional = argument not in signature or signature[argument].default is not inspect.Parameter.empty
            if argument not in grid.axes and not optional:
                raise ValueError(
                    f"quantity {name!r} takes {argument!r}, which is not an axis: "
                    f"pass {argument}=... or fix it inside the function"
                )
