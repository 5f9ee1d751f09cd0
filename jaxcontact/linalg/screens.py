"""An operation that changes nothing and that XLA cannot drop, as a primitive."""

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend import core
from jax.interpreters import ad, batching, mlir

SCREEN = "screen"
"""Name of the primitive."""

SHIELD = 1.0
"""Its parameter where the operand is finite wherever that matters; see `unrolled.shield`."""

_screen_p = core.Primitive(SCREEN)


def screen(x: jax.Array, share: float = 0.5) -> jax.Array:
    """x, as its maximum with a most negative number, `share` of the most negative finite one; NaN passes through.

    A primitive of its own: a function with a custom derivative takes many times as long to trace. Nothing at all for
    one number by itself, where there is no loop to keep whole.
    """
    return _screen_p.bind(x, share=share)


def _maximum(x, *, share):
    if not x.ndim:
        return x
    return lax.max(x, lax.full_like(x, share * float(jnp.finfo(x.dtype).min)))


_screen_p.def_impl(jax.jit(_maximum, static_argnames="share"))
_screen_p.def_abstract_eval(lambda x, *, share: x.update(weak_type=False))
ad.primitive_jvps[_screen_p] = lambda primals, tangents, *, share: (screen(*primals, share), *tangents)
batching.defvectorized(_screen_p)
mlir.register_lowering(_screen_p, mlir.lower_fun(_maximum, multiple_results=False))
