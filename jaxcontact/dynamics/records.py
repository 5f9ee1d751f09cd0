"""What a mechanism is made of: contacts, named coordinates, states."""

from dataclasses import dataclass
from typing import Literal

import jax
import jax.numpy as jnp
from jax import Array

from .numbers import as_float_array


@dataclass(frozen=True)
class Contact:
    """One contact of a mechanism. Static: it decides what is assembled and which problem is solved.

    `Contact("left runner", "bilateral", frictional=True)`

    Raises:
        ValueError: if `kind` is neither "bilateral" nor "unilateral".
    """

    name: str
    kind: Literal["bilateral", "unilateral"]
    """"bilateral": the gap stays zero and the normal force has either sign. "unilateral": the contact can only push."""
    frictional: bool = False

    def __post_init__(self):
        if self.kind not in ("bilateral", "unilateral"):
            raise ValueError(f'contact {self.name!r}: kind must be "bilateral" or "unilateral", got {self.kind!r}')

    @property
    def bilateral(self) -> bool:
        return self.kind == "bilateral"


@dataclass(frozen=True)
class Coordinate:
    """What a named chart coordinate means: its unit and a phrase for the axis of a plot."""

    unit: str = ""
    doc: str = ""


@jax.tree_util.register_pytree_with_keys_class
class State:
    """Generalised coordinates, velocities and the time.

    `State(jnp.array([0.0, 0.4, 0.9]), jnp.array([1.0, 0.0, 0.0]))`

    Without velocities the state is at rest *statically*: no velocity term is assembled for it (`at_rest`), while `v`
    still reads as zeros.

    Args:
        q: (n,) generalised coordinates, m or rad; float32 or float64. Integers become the default float.
        v: (n,) generalised velocities, m/s or rad/s; None: at rest.
        t: time in s, of interest to driven constraints and forces only.

    Raises:
        TypeError: for float16, bfloat16 or complex coordinates.
        ValueError: if q is not a vector, v has another shape, or float64 data meet a JAX without 64-bit floats.
    """

    def __init__(self, q: Array, v: Array | None = None, t: float | Array = 0.0):
        self.q = as_float_array("q", q)
        if self.q.ndim != 1:
            raise ValueError(f"State: q must be a vector (n,), got shape {self.q.shape}; batches go through jax.vmap")
        self._v = None if v is None else as_float_array("v", v)
        if self._v is not None and self._v.shape != self.q.shape:
            raise ValueError(f"State: v must have the shape of q, {self.q.shape}, got {self._v.shape}")
        self.t = t

    @property
    def v(self) -> Array:
        """(n,) generalised velocities."""
        return jnp.zeros_like(self.q) if self._v is None else self._v

    @property
    def at_rest(self) -> bool:
        """True if the state was given no velocity at all; static."""
        return self._v is None

    def tree_flatten_with_keys(self):
        key = jax.tree_util.GetAttrKey
        return ((key("q"), self.q), (key("v"), self._v), (key("t"), self.t)), None

    @classmethod
    def tree_unflatten(cls, _, children):
        state = object.__new__(cls)
        state.q, state._v, state.t = children
        return state

    def __repr__(self):
        return f"State(q={self.q}, v={'at rest' if self.at_rest else self._v}, t={self.t})"
