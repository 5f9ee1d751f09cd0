"""Sine, cosine, square root and quotient behind a screen, each a primitive of its own.

XLA:CPU ends a loop at an expensive operation that several others use. Behind a cheap one it does not, nor at
polynomials (`screens`, `circular`). As primitives these cost one step of a traced program and its derivative; a
function with a custom derivative takes many times as long to trace. One number by itself is left to XLA's own
operation: there is no loop to keep whole, and polynomials would be compiled again for every user.
"""

from collections.abc import Callable

import jax
from jax import lax
from jax.extend import core
from jax.interpreters import ad, batching, mlir

from jaxcontact.linalg.circular import cosine, has_polynomials, sine
from jaxcontact.linalg.screens import screen


def _primitive(name: str, plain: Callable, screened: Callable) -> core.Primitive:
    """A primitive on numbers of one dtype: `plain` for one by itself, `screened` for a batch."""
    made = core.Primitive(name)

    def computed(*operands):
        return (screened if operands[0].ndim else plain)(*operands)

    made.def_impl(jax.jit(computed))
    made.def_abstract_eval(lambda x, *_: x.update(weak_type=False))
    mlir.register_lowering(made, mlir.lower_fun(computed, multiple_results=False))
    return made


def _polynomial(own: Callable, library: Callable) -> Callable:
    return lambda x: own(x) if has_polynomials(x.dtype) else screen(library(x))


sine_p = _primitive("shielded_sine", lax.sin, _polynomial(sine, lax.sin))
cosine_p = _primitive("shielded_cosine", lax.cos, _polynomial(cosine, lax.cos))
root_p = _primitive("shielded_root", lax.sqrt, lambda x: screen(lax.sqrt(x)))
quotient_p = _primitive("shielded_quotient", lax.div, lambda x, y: screen(lax.div(x, y)))


def _quotients(operands, axes):
    """The rule of a batch, in which both operands get the batch axis."""
    size = next(x.shape[axis] for x, axis in zip(operands, axes, strict=True) if axis is not None)
    return quotient_p.bind(*(batching.bdim_at_front(x, axis, size) for x, axis in zip(operands, axes))), 0


for unary in (sine_p, cosine_p, root_p):
    batching.defvectorized(unary)
batching.primitive_batchers[quotient_p] = _quotients


def _inverse(y):
    return quotient_p.bind(lax.full_like(y, 1), y)


ad.defjvp2(sine_p, lambda dx, _, x: lax.mul(dx, cosine_p.bind(x)))
ad.defjvp2(cosine_p, lambda dx, _, x: lax.neg(lax.mul(dx, sine_p.bind(x))))
ad.defjvp2(root_p, lambda dx, root, _: lax.mul(dx, lax.mul(_inverse(root), lax.full_like(root, 0.5))))
ad.defjvp2(
    quotient_p,
    lambda dx, _, x, y: lax.mul(dx, _inverse(y)),
    lambda dy, ratio, x, y: lax.neg(lax.mul(lax.mul(dy, ratio), _inverse(y))),
)

SHIELDED = {"sin": sine_p, "cos": cosine_p, "sqrt": root_p, "div": quotient_p}
"""By the name of XLA's operation."""
