"""Frozen dataclasses that JAX sees through, checked when a person builds them and not when JAX rebuilds them."""

import dataclasses
from typing import dataclass_transform

import jax


@dataclass_transform(frozen_default=True)
def record(cls):
    """A frozen dataclass registered as a pytree: every field is data.

    JAX rebuilds records around batched arrays and placeholders, so `tree_unflatten` bypasses `__post_init__`;
    the checks there are for callers only.
    """
    cls = dataclasses.dataclass(frozen=True, eq=False)(cls)
    names = tuple(field.name for field in dataclasses.fields(cls))

    def flatten_with_keys(item):
        return [(jax.tree_util.GetAttrKey(name), getattr(item, name)) for name in names], None

    def flatten(item):
        return [getattr(item, name) for name in names], None

    def unflatten(_, children):
        item = object.__new__(cls)
        for name, child in zip(names, children, strict=True):
            object.__setattr__(item, name, child)
        return item

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


def unchecked(cls, **fields):
    """A record from fields that are known to fit: for traced code, where the checks would only repeat themselves."""
    item = object.__new__(cls)
    for name, value in fields.items():
        object.__setattr__(item, name, value)
    return item
