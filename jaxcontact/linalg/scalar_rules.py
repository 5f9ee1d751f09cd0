"""What the reader of programs knows of each operation: how entries move, what folds, what may become infinite."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxcontact.linalg.rows import ENTRIES, ROW, row_of
from jaxcontact.linalg.screens import SCREEN, SHIELD
from jaxcontact.linalg.shielded import SHIELDED, quotient_p, root_p
from jaxcontact.linalg.unrolled import in_a_row, milestone


class Entries(NamedTuple):
    """A small array as its entries: constants as numpy scalars, the rest as traced scalars."""

    shape: tuple[int, ...]
    dtype: np.dtype
    flat: list


# --- values


def literal(variable) -> Entries:
    aval = variable.aval
    return Entries(aval.shape, aval.dtype, list(np.asarray(variable.val, aval.dtype).reshape(-1)))


def entries_of(x) -> Entries:
    if isinstance(x, Entries):
        return x
    concrete = isinstance(x, jax.Array | np.ndarray | np.generic) and not isinstance(x, jax.core.Tracer)
    if concrete and not jax.dtypes.issubdtype(x.dtype, jax.dtypes.extended):
        return Entries(x.shape, x.dtype, list(np.asarray(x).reshape(-1)))
    x = jnp.asarray(x)
    return Entries(x.shape, x.dtype, in_a_row(x))


def whole(x):
    """The array of its entries again."""
    if not isinstance(x, Entries):
        return x
    if all(isinstance(entry, np.generic) for entry in x.flat):
        return jnp.asarray(np.array(x.flat, x.dtype).reshape(x.shape))
    return row_of([jnp.asarray(entry, x.dtype) for entry in x.flat]).reshape(x.shape)


def places(x: Entries) -> np.ndarray:
    return np.arange(len(x.flat)).reshape(x.shape)


def identity(x) -> Any:
    return (x.dtype.name, x.tobytes()) if isinstance(x, np.generic) else id(x)


# --- primitives that only move entries: applied to the places of the entries


def _moved(aval, x: Entries, order: np.ndarray) -> Entries:
    return Entries(aval.shape, aval.dtype, [x.flat[i] for i in order.reshape(-1)])


def _slice(aval, params, x):
    strides = params["strides"] or (1,) * len(x.shape)
    cut = tuple(slice(*s) for s in zip(params["start_indices"], params["limit_indices"], strides))
    return _moved(aval, x, places(x)[cut])


def _broadcast(aval, params, x):
    shape = [1] * len(aval.shape)
    for axis, place in enumerate(params["broadcast_dimensions"]):
        shape[place] = x.shape[axis]
    return _moved(aval, x, np.broadcast_to(places(x).reshape(shape), aval.shape))


def _joined(join: Callable, axis: str) -> Callable:
    """The rule of an operation that joins arrays along the axis named by a parameter."""

    def rule(aval, params, *parts):
        flat = [entry for part in parts for entry in part.flat]
        starts = np.cumsum([0, *(len(part.flat) for part in parts)])
        blocks = [places(part) + start for part, start in zip(parts, starts)]
        return _moved(aval, Entries((), aval.dtype, flat), join(blocks, axis=params[axis]))

    return rule


def _iota(aval, params):
    along = np.arange(aval.shape[params["dimension"]]).astype(aval.dtype)
    shape = [-1 if axis == params["dimension"] else 1 for axis in range(len(aval.shape))]
    return Entries(aval.shape, aval.dtype, list(np.broadcast_to(along.reshape(shape), aval.shape).reshape(-1)))


def _pad(aval, params, x, filling):
    """Entries among copies of the filling; a negative padding takes some away."""
    order = places(x)
    for axis, (low, high, between) in enumerate(params["padding_config"]):
        lines = np.moveaxis(order, axis, 0)
        spread = np.full((max(len(lines) + (len(lines) - 1) * between, 0), *lines.shape[1:]), len(x.flat))
        spread[:: between + 1] = lines
        around = [(max(low, 0), max(high, 0))] + [(0, 0)] * (spread.ndim - 1)
        spread = np.pad(spread, around, constant_values=len(x.flat))
        spread = spread[max(-low, 0) : len(spread) - max(-high, 0)]
        order = np.moveaxis(spread, 0, axis)
    return _moved(aval, Entries((), aval.dtype, [*x.flat, filling.flat[0]]), order)


def _split(avals, params, x):
    parts = np.split(places(x), np.cumsum(params["sizes"])[:-1], axis=params["axis"])
    return [_moved(aval, x, part) for aval, part in zip(avals, parts, strict=True)]


def _unstack(avals, params, x):
    parts = np.moveaxis(places(x), params["axis"], 0)
    return [_moved(aval, x, part) for aval, part in zip(avals, parts, strict=True)]


STRUCTURE = {
    ROW: lambda aval, _, *parts: _joined(np.stack, "axis")(aval, {"axis": -1}, *parts),
    "iota": _iota,
    "slice": _slice,
    "broadcast_in_dim": _broadcast,
    "concatenate": _joined(np.concatenate, "dimension"),
    "stack": _joined(np.stack, "axis"),
    "pad": _pad,
    "squeeze": lambda aval, params, x: _moved(aval, x, places(x)),
    "expand_dims": lambda aval, params, x: _moved(aval, x, places(x)),
    "reshape": lambda aval, params, x: _moved(aval, x, places(x)),
    "transpose": lambda aval, params, x: _moved(aval, x, places(x).transpose(params["permutation"])),
    "rev": lambda aval, params, x: _moved(aval, x, np.flip(places(x), params["dimensions"])),
}

PARTS = {"split": _split, "unstack": _unstack, ENTRIES: lambda avals, _, x: _unstack(avals, {"axis": -1}, x)}
"""Those with several results: the rules take the shapes of all."""

ELEMENTWISE = {
    *(
        "abs",
        "acos",
        "add",
        "add_any",
        "and",
        "asin",
        "atan",
        "atan2",
        "bitcast_convert_type",
        "clamp",
        "complex",
        "cos",
        "cosh",
    ),
    *(
        "convert_element_type",
        "div",
        "eq",
        "exp",
        "floor",
        "ge",
        "gt",
        "integer_pow",
        "is_finite",
        "le",
        "log",
        "lt",
        "max",
    ),
    *(
        "min",
        "mul",
        "ne",
        "neg",
        "not",
        "or",
        "pow",
        "round",
        "rsqrt",
        "select_n",
        "shift_left",
        "shift_right_arithmetic",
    ),
    *(
        SCREEN,
        *(primitive.name for primitive in SHIELDED.values()),
        "shift_right_logical",
        "sign",
        "sin",
        "sinh",
        "sqrt",
        "square",
        "stop_gradient",
        "sub",
        "tan",
        "tanh",
        "xor",
    ),
}

REDUCTIONS = {
    "reduce_sum": lax.add_p,
    "reduce_max": lax.max_p,
    "reduce_min": lax.min_p,
    "reduce_and": lax.and_p,
    "reduce_or": lax.or_p,
}

KNOWN = {*STRUCTURE, *PARTS, *ELEMENTWISE, *REDUCTIONS, "cumsum", "dot_general", "custom_jvp_call"}


# --- folding


def _constant(x, value=None) -> bool:
    return isinstance(x, np.generic) and (value is None or x == value)


def _fold_mul(x, y):
    if _constant(x, 0) or _constant(y, 1):
        return x
    if _constant(y, 0) or _constant(x, 1):
        return y
    return x * y if _constant(x) and _constant(y) else None


def _fold_add(x, y):
    if _constant(x, 0):
        return y
    if _constant(y, 0):
        return x
    return x + y if _constant(x) and _constant(y) else None


def _fold_sub(x, y):
    if _constant(y, 0):
        return x
    return x - y if _constant(x) and _constant(y) else None


def _fold_div(x, y):
    return x if _constant(y, 1) or (_constant(x, 0) and _constant(y) and y != 0) else None


def _fold_neg(x):
    return -x if _constant(x) else None


def _fold_select(which, *cases):
    return cases[int(which)] if _constant(which) else None


FOLD = {
    "add": _fold_add,
    "add_any": _fold_add,
    "div": _fold_div,
    "mul": _fold_mul,
    "neg": _fold_neg,
    quotient_p.name: _fold_div,
    "select_n": _fold_select,
    "sub": _fold_sub,
}


# --- what may leave the finite numbers

UNBOUNDED = {"acos", "asin", "log", "pow", "round", "rsqrt", "sqrt", "tan", root_p.name}


def may_be_infinite(name: str, params: dict | None, operands) -> bool:
    if name in ("div", quotient_p.name):
        return not (_constant(operands[1]) and operands[1] != 0)
    return name in UNBOUNDED or (name == "integer_pow" and params["y"] < 0)


def is_shield(name: str, params: dict | None) -> bool:
    return name == SCREEN and params["share"] == SHIELD


def is_milestone(step) -> bool:
    """Whether a step is the call of `unrolled.milestone`."""
    return step.primitive.name in ("jit", "pjit") and step.params["name"] == milestone.__name__
