"""A traced program for a batch, on one number for each entry and all lanes.

Where `jax.vmap` of `fused` would write a program on scalars for one lane, and once more for all, here it is written
once, for all; and one problem by itself, where there are no loops to save, stays as it is written.
"""

import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core
from jax.interpreters import ad, batching, mlir

from jaxcontact.linalg.fused import fused
from jaxcontact.linalg.reader import Reader
from jaxcontact.linalg.rows import entries_of_row, row_of
from jaxcontact.linalg.scalar_rules import Entries, entries_of
from jaxcontact.linalg.survey import IN_BATCHES, of_all_inputs, takes_apart
from jaxcontact.linalg.tracing import Traced


def fused_in_batches(function: Callable) -> Callable:
    """`function`, which under vmap becomes a program on scalars, as `fused` makes it; when it is differentiated too.

    >>> jax.jit(jax.vmap(fused_in_batches(lambda x: jnp.stack([x, 0 * x]) @ jnp.stack([x, x]))))
    """

    def call(*arguments):
        traced = Traced.of(function, *arguments)
        program = core.ClosedJaxpr(of_all_inputs(traced.program), [])
        results = _program_p.bind(*traced.program.consts, *jax.tree.leaves(arguments), program=program)
        return jax.tree.unflatten(jax.tree.structure(traced.shapes), results)

    return call


def read_batch(
    program: core.ClosedJaxpr, size: int, leaves: Sequence, batched: Sequence[bool], *, final: bool
) -> list[Entries] | None:
    """The results of a traced program for a batch: of every entry one number for each of `size` lanes, or the same one
    for all. Leaves that are `batched` have the lanes in front. None if a step of the program cannot be taken apart.

    >>> read_batch(jax.make_jaxpr(jnp.dot)(row, column), 10, [rows, column], [True, False], final=True)
    """
    if not takes_apart(program.jaxpr, final):
        return None
    inputs = [columns_of(x) if b else x for x, b in zip(leaves, batched, strict=True)]
    return [entries_of(x) for x in Reader(final, lanes=size).run(program.jaxpr, program.consts, inputs)]


def columns_of(x: jax.Array) -> Entries:
    """The entries of the small arrays of a batch, each for all lanes."""
    lanes, shape = x.shape[0], x.shape[1:]
    count = math.prod(shape)
    return Entries(shape, x.dtype, entries_of_row(lax.reshape(x, (lanes, count))) if count else [])


def _small_arrays(x: Entries, size: int) -> jax.Array:
    """(size, ...) the arrays of their entries again."""
    if not x.flat:
        return jnp.zeros((size, *x.shape), x.dtype)
    columns = [e if np.ndim(e) else lax.full((size,), e, x.dtype) for e in x.flat]
    return lax.reshape(row_of(columns), (size, *x.shape))


_program_p = core.Primitive(IN_BATCHES)
_program_p.multiple_results = True


@_program_p.def_impl
def _run(*operands, program):
    return core.jaxpr_as_fun(program)(*operands)


_program_p.def_abstract_eval(lambda *_, program: program.out_avals)
mlir.register_lowering(_program_p, mlir.lower_fun(_run, multiple_results=True))


def _over_lanes(operands, axes, *, program):
    """The rule of a batch."""
    size = next(x.shape[axis] for x, axis in zip(operands, axes, strict=True) if axis is not None)
    batched = [axis is not None for axis in axes]
    leaves = [batching.bdim_at_front(x, axis, size) if b else x for x, axis, b in zip(operands, axes, batched)]
    results = read_batch(program, size, leaves, batched, final=False)
    if results is None:
        found = jax.vmap(fused(core.jaxpr_as_fun(program)), [0 if b else None for b in batched])(*leaves)
    else:
        found = [_small_arrays(x, size) for x in results]
    return found, [0] * len(found)


batching.primitive_batchers[_program_p] = _over_lanes


def _with_derivatives(primals, tangents, *, program):
    """The rule of a derivative: that of the program on scalars, in those operands that have one."""
    moving = [k for k, t in enumerate(tangents) if type(t) is not ad.Zero]

    def computed(*varied):
        operands = list(primals)
        for k, x in zip(moving, varied, strict=True):
            operands[k] = x
        return fused(core.jaxpr_as_fun(program))(*operands)

    results, slopes = jax.jvp(computed, [primals[k] for k in moving], [tangents[k] for k in moving])
    return results, [ad.Zero(jax.typeof(x)) if x.dtype == jax.dtypes.float0 else x for x in slopes]


ad.primitive_jvps[_program_p] = _with_derivatives
