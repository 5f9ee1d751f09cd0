"""What a batch can save as a whole: chunks that stay in the cache, and work that few lanes need.

Functions are written for one problem; these rules say what `jax.vmap` makes of them. A vmap of a vmap is one batch.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxcontact.linalg.tracing import Traced, where

WIDEST_VECTOR = 512
"""Bits; XLA itself stops at 256."""

FULL = 2**16
"""Lanes that keep an accelerator busy."""


def in_chunks(function: Callable, lanes: int) -> Callable:
    """`function`, which under vmap runs over at most `lanes` problems at a time.

    A loop then ends with the slowest lane of its chunk, not of the batch, and its state stays in the cache. On
    accelerators the batch stays whole. Not to be differentiated.

    >>> jax.vmap(in_chunks(lambda x: lax.while_loop(lambda y: y < 1, lambda y: 2 * y, x), 256))(x)
    """

    def apart(*arguments):
        traced = Traced.of(function, *arguments)

        @custom_vmap
        def many(*arguments):
            if not _on_cpu():
                return jax.vmap(traced.run)(*arguments)
            return _chunk_by_chunk(jax.vmap(traced.run), lanes, arguments)

        @many.def_vmap
        def _(size, batched, *arguments):
            return _as_one_batch(many, size, batched, arguments)

        @custom_vmap
        def one(*arguments):
            return traced.run(*arguments)

        @one.def_vmap
        def _(size, batched, *arguments):
            spread = _spread(size, batched, arguments)
            results = many(*jax.tree.unflatten(jax.tree.structure(arguments), spread))
            return results, jax.tree.map(lambda _: True, traced.shapes)

        return one(*arguments)

    return apart


def compiler_options() -> dict:
    """What to ask of the compiler for a batch, at the top-level jit: on a CPU the widest vectors, up to twice the speed
    of a fused loop where the processor has them.

    >>> jax.jit(jax.vmap(jnp.sin), compiler_options=compiler_options())
    """
    return {"xla_cpu_prefer_vector_width": WIDEST_VECTOR} if _on_cpu() else {}


def where_needed(needed: jax.Array, function: Callable, otherwise, *arguments):
    """`function(*arguments)` where `needed` (a bool) holds, else `otherwise`; a batch of which no lane needs it skips
    it. Not to be differentiated.

    >>> where_needed(~solved, proof_of_infeasibility, jnp.zeros((), bool), M, q)
    """
    traced = Traced.of(function, *arguments)

    @custom_vmap
    def one(needed, otherwise, *arguments):
        return lax.cond(needed, traced.run, lambda *_: otherwise, *arguments)

    @one.def_vmap
    def _(size, batched, *given):
        axes = jax.tree.map(lambda b: 0 if b else None, tuple(batched))

        def lane(needed, otherwise, *arguments):
            return jax.tree.map(lambda a, b: where(needed, a, b), traced.run(*arguments), otherwise)

        def idle(_, otherwise, *__):
            return otherwise

        def over(choice):
            return lambda *given: jax.vmap(choice, axes, axis_size=size)(*given)

        results = lax.cond(jnp.any(given[0]), over(lane), over(idle), *given)
        return results, jax.tree.map(lambda _: True, traced.shapes)

    return one(needed, otherwise, *arguments)


def for_the_few(needed: jax.Array, function: Callable, otherwise, *arguments, lanes: int):
    """As `where_needed`, for a `function` worth the trouble of picking the lanes out of a batch that need it: these
    alone are computed, at most `lanes` at a time, on accelerators FULL. Not to be differentiated.

    >>> for_the_few(doubtful, again, first, problem, lanes=256)
    """
    traced = Traced.of(function, *arguments)

    @custom_vmap
    def many(needed, otherwise, arguments):
        size = len(needed)
        width = min(lanes if _on_cpu() else FULL, size)
        order, count = jnp.argsort(~needed), jnp.sum(needed)

        def advance(k, results):
            # the last group begins earlier, with lanes that are done again, or with some that do not need it
            begin = jnp.minimum(k * width, size - width)
            chosen = lax.dynamic_slice_in_dim(order, begin, width)
            found = jax.vmap(traced.run)(*jax.tree.map(lambda x: x[chosen], arguments))

            def put(whole, part):
                wanted = needed[chosen].reshape(-1, *[1] * (part.ndim - 1))
                return whole.at[chosen].set(jnp.where(wanted, part, whole[chosen]))

            return jax.tree.map(put, results, found)

        return lax.fori_loop(0, -(-count // width), advance, otherwise) if size else otherwise

    @many.def_vmap
    def _(size, batched, *given):
        return _as_one_batch(many, size, batched, given)

    @custom_vmap
    def one(needed, otherwise, arguments):
        return lax.cond(needed, lambda given: traced.run(*given), lambda _: otherwise, arguments)

    @one.def_vmap
    def _(size, batched, *given):
        spread = _spread(size, batched, given)
        results = many(*jax.tree.unflatten(jax.tree.structure(given), spread))
        return results, jax.tree.map(lambda _: True, traced.shapes)

    return one(needed, otherwise, arguments)


def walled(function: Callable) -> Callable:
    """`function` as a computation of its own, which XLA neither repeats for each user of its results nor takes apart.

    Without the wall a short program that feeds many others is compiled, and run, many times over. The wall is a branch
    that is always taken, which the compiler cannot know. On accelerators there is none: the host would have to look at
    each branch, and XLA compiles and runs these programs quicker without. Not to be differentiated.

    >>> jax.vmap(walled(lambda x: x + 1))(jnp.zeros(3))     # ones
    """

    def apart(*arguments):
        traced = Traced.of(function, *arguments)

        @custom_vmap
        def one(*arguments):
            if not _on_cpu():
                return traced.run(*arguments)

            def nothing(*_):
                return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), traced.shapes)

            # a constant that the compiler does not see through
            return lax.cond(lax.optimization_barrier(np.bool_(True)), traced.run, nothing, *arguments)

        @one.def_vmap
        def _(size, batched, *arguments):
            axes = jax.tree.map(lambda b: 0 if b else None, tuple(batched))
            results = walled(jax.vmap(traced.run, axes, axis_size=size))(*arguments)
            return results, jax.tree.map(lambda _: True, traced.shapes)

        return one(*arguments)

    return apart


def _on_cpu() -> bool:
    """Whether programs are made for a CPU, as far as one can know while they are traced."""
    return jax.default_backend() == "cpu"


def _spread(size, batched, arguments):
    """The leaves with the batch axis in front, also where they had none."""
    flags = jax.tree.leaves(batched)
    leaves = jax.tree.leaves(arguments)
    return [x if b else jnp.broadcast_to(x, (size, *x.shape)) for x, b in zip(leaves, flags, strict=True)]


def _as_one_batch(many, size, batched, arguments):
    """What a rule for a batch of batches returns: `many` on all problems in one row."""
    spread = _spread(size, batched, arguments)
    inner = spread[0].shape[1]
    flat = [x.reshape(size * inner, *x.shape[2:]) for x in spread]
    results = many(*jax.tree.unflatten(jax.tree.structure(arguments), flat))
    results = jax.tree.map(lambda x: x.reshape(size, inner, *x.shape[1:]), results)
    return results, jax.tree.map(lambda _: True, results)


def _chunk_by_chunk(function, lanes, arguments):
    """Where the size is no multiple of `lanes` the last chunk begins earlier and does some lanes again: nothing is
    copied to fill it."""
    size = len(jax.tree.leaves(arguments)[0])
    if size <= lanes:
        return function(*arguments)

    def chunk(start):
        return function(*jax.tree.map(lambda x: lax.dynamic_slice_in_dim(x, start, lanes), arguments))

    def advance(k, results):
        start = jnp.minimum(k * lanes, size - lanes)

        def put(whole, part):
            return lax.dynamic_update_slice_in_dim(whole, part, start, 0)

        return jax.tree.map(put, results, chunk(start))

    shapes = jax.eval_shape(chunk, jnp.int32(0))
    empty = jax.tree.map(lambda x: jnp.zeros((size, *x.shape[1:]), x.dtype), shapes)
    return lax.fori_loop(0, -(-size // lanes), advance, empty)
