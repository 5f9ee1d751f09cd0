"""A row of numbers and its entries, each way as one step of a program.

Each is the other's transpose, and in a batch the lanes stay in front: XLA sees through parts of a row of numbers, and
not through those of stacks of stacks, of which a matrix between two programs on scalars would have to be stored.
"""

import jax
from jax import lax
from jax.extend import core
from jax.interpreters import ad, batching, mlir

ENTRIES, ROW = "entries_of_row", "row_of_entries"
"""Names of the primitives."""


def entries_of_row(row: jax.Array) -> list[jax.Array]:
    """The k entries of a row (..., k).

    >>> entries_of_row(jnp.ones(3))     # three numbers
    """
    return list(_entries_p.bind(row))


def row_of(entries: list[jax.Array]) -> jax.Array:
    """The row (..., k) of k >= 1 arrays of one shape and dtype.

    >>> row_of([jnp.ones(()), jnp.zeros(())]).shape     # (2,)
    """
    return _row_p.bind(*entries)


_entries_p, _row_p = core.Primitive(ENTRIES), core.Primitive(ROW)
_entries_p.multiple_results = True


def _apart(row):
    return lax.unstack(row, axis=row.ndim - 1)


def _together(*entries):
    return lax.concatenate([lax.reshape(x, (*x.shape, 1)) for x in entries], entries[0].ndim)


_entries_p.def_impl(jax.jit(_apart))
_entries_p.def_abstract_eval(lambda row: [row.update(shape=row.shape[:-1], weak_type=False)] * row.shape[-1])
mlir.register_lowering(_entries_p, mlir.lower_fun(_apart, multiple_results=True))

_row_p.def_impl(jax.jit(_together))
_row_p.def_abstract_eval(lambda x, *more: x.update(shape=(*x.shape, 1 + len(more)), weak_type=False))
mlir.register_lowering(_row_p, mlir.lower_fun(_together, multiple_results=False))


def _entries_over_lanes(operands, axes):
    (row,), (axis,) = operands, axes
    entries = entries_of_row(batching.bdim_at_front(row, axis, row.shape[axis]))
    return entries, [0] * len(entries)


def _row_over_lanes(entries, axes):
    size = next(x.shape[axis] for x, axis in zip(entries, axes, strict=True) if axis is not None)
    return row_of([batching.bdim_at_front(x, axis, size) for x, axis in zip(entries, axes)]), 0


batching.primitive_batchers[_entries_p] = _entries_over_lanes
batching.primitive_batchers[_row_p] = _row_over_lanes


def _entries_moved(primals, tangents):
    entries, (slope,) = entries_of_row(*primals), tangents
    return entries, [ad.Zero(jax.typeof(x)) for x in entries] if type(slope) is ad.Zero else entries_of_row(slope)


def _row_moved(primals, tangents):
    return row_of(primals), row_of([*map(ad.instantiate_zeros, tangents)])


ad.primitive_jvps[_entries_p] = _entries_moved
ad.primitive_jvps[_row_p] = _row_moved


def _entries_transposed(cotangents, row):
    return [row_of([*map(ad.instantiate_zeros, cotangents)])]


def _row_transposed(cotangent, *entries):
    if type(cotangent) is ad.Zero:
        return [None] * len(entries)
    parts = entries_of_row(cotangent)
    return [part if ad.is_undefined_primal(x) else None for part, x in zip(parts, entries, strict=True)]


ad.primitive_transposes[_entries_p] = _entries_transposed
ad.primitive_transposes[_row_p] = _row_transposed
