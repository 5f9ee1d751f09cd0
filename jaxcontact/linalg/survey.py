"""What a traced program is made of, before it is read: what opens, whether all is taken apart, how long it becomes."""

import numpy as np
from jax.extend import core

from jaxcontact.linalg.rows import ENTRIES, ROW
from jaxcontact.linalg.scalar_rules import KNOWN, is_milestone

IN_BATCHES = "fused_in_batches"
"""The name of the primitive of `lanes`."""

ENTRIES_LIMIT = 128
"""Arrays with more entries than this stay whole."""

LENGTH_LIMIT = 2**13
"""A longer program on scalars takes too long to compile. A row taken apart or put together counts twice."""

CUT_LENGTH_LIMIT = 2**14
"""The same for one that is cut."""

LOOP_LIMIT = 5000
"""A longer program, before its repetitions fall away, is cut at its milestones. XLA:CPU takes a loop of more than some
3000 operations apart into functions that call each other, each once for every user: a thousand times slower
(computation_partitioner.cc)."""


def opened(step, final: bool):
    """The program inside a call that may be read through, else None; that of a custom derivative if `final`."""
    if step.primitive.name in ("jit", "pjit"):
        return step.params["jaxpr"]
    if step.primitive.name == IN_BATCHES:
        return step.params["program"]
    if final and step.primitive.name == "custom_jvp_call":
        return step.params["call_jaxpr"]
    return None


def of_all_inputs(traced: core.ClosedJaxpr) -> core.Jaxpr:
    """The program with its constants as first inputs; JAX 0.11 keeps those of a Jaxpr in it."""
    inputs = [*traced.jaxpr.constvars, *traced.jaxpr.invars]
    return traced.jaxpr.replace(constvars=[], invars=inputs)


def pays(program, final: bool) -> bool:
    """Whether the program is made of operations that are taken apart, and few enough of them."""
    return _length(program, final) <= (CUT_LENGTH_LIMIT if final and _is_marked(program, final) else LENGTH_LIMIT)


def is_cut(program, final: bool) -> bool:
    """Whether the program has milestones and is too long for one loop."""
    return _is_marked(program, final) and _length(program, final) > LOOP_LIMIT


def takes_apart(program, final: bool) -> bool:
    """Whether no step of the program stays as it is."""
    return _length(program, final) <= LENGTH_LIMIT and all(_is_taken_apart(step, final) for step in program.eqns)


def _is_taken_apart(step, final: bool) -> bool:
    if is_milestone(step):
        return True
    inner = opened(step, final)
    if inner is not None:
        return all(_is_taken_apart(step, final) for step in inner.jaxpr.eqns)
    small = all(v.aval.size <= ENTRIES_LIMIT for v in (*step.invars, *step.outvars))
    return small and step.primitive.name in KNOWN and step.primitive.name != "custom_jvp_call"


def _is_marked(program, final: bool) -> bool:
    if any(map(is_milestone, program.eqns)):
        return True
    inner = [opened(step, final) for step in program.eqns]
    return any(_is_marked(x.jaxpr, final) for x in inner if x)


def _length(program, final: bool) -> float:
    return sum(_length_of(step, final) for step in program.eqns)


def _length_of(step, final: bool) -> float:
    if is_milestone(step):
        return 1
    inner = opened(step, final)
    if inner is not None:
        return _length(inner.jaxpr, final)
    if step.primitive.name in (ENTRIES, ROW):
        return 2 * max(v.aval.size for v in (*step.invars, *step.outvars))
    if step.primitive.name in KNOWN:
        return sum(v.aval.size if v.aval.shape else 1 for v in step.outvars)
    scalar = max(v.aval.size for v in (*step.invars, *step.outvars)) <= 1
    return len(step.outvars) if scalar and not list(core.jaxprs_in_params(step.params)) else np.inf
