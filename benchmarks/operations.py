"""Operations in the compiled program, scene by scene: a scene pays for what it has and for nothing else.

Counts the arithmetic instructions of the optimised program for one state (no batch), float64.
"""

import argparse
import json
import re

import jax

import jaxcontact as jc
from jaxcontact.linalg import fused
from jaxcontact.mechanisms import GuidedRodUnderCeiling, PainleveKlein

BOOKKEEPING = {
    "parameter", "constant", "tuple", "get-tuple-element", "bitcast", "broadcast", "copy", "fusion", "call", "reshape",
    "concatenate", "slice", "transpose", "pad", "convert", "iota", "dynamic-slice", "dynamic-update-slice",
    "copy-start", "copy-done", "bitcast-convert",
}  # fmt: skip
"""Instructions that move data and compute nothing."""

MOVING = {"theta": 0.9, "speed": 1.0}

REDUCTION = "round-nearest-even"
"""The instruction with which a sine begins."""

SCENES = (
    ("one guide, one ceiling, both rough, sliding", GuidedRodUnderCeiling(), MOVING),
    ("two rough guides, sliding", PainleveKlein(), MOVING),
    ("one rough, one smooth guide, sliding", PainleveKlein(upper_frictional=False), MOVING),
    ("two smooth guides, sliding", PainleveKlein(lower_frictional=False, upper_frictional=False), MOVING),
    ("two smooth guides, at rest", PainleveKlein(lower_frictional=False, upper_frictional=False), {"theta": 0.9}),
)
"""Each scene has what the one before it has, less one thing: unilaterality, friction, friction, velocity."""


def operations(function, *arguments) -> int:
    """Arithmetic instructions in the optimised program of `function`, compiled as a sweep compiles it.

    The polynomials of a sine and cosine of one angle count as two, however often XLA repeats them; each has one
    rounding to the nearest integer.
    """
    found = _instructions(function, *arguments)
    turns = found.count(REDUCTION)
    if not turns:
        return len(found)
    return len(found) - turns * (len(_instructions(_sine_and_cosine, 0.5)) - 1) + 2


def _sine_and_cosine(angle):
    return jax.numpy.sin(angle) + jax.numpy.cos(angle)


def _instructions(function, *arguments) -> list[str]:
    text = jax.jit(fused(function, final=True)).lower(*arguments).compile().as_text()
    names = re.findall(r"^\s+(?:ROOT )?%?[\w.-]+ = (?:\([^)]*\)|\S+) ([\w-]+)\(", text, re.MULTILINE)
    return [name for name in names if name not in BOOKKEEPING]


def free_acceleration(mechanism, state):
    here = jc.delassus(mechanism, state)
    return here.W, here.Wt, here.w


def bound(mechanism, state):
    return jc.bounds.norm_ratio(jc.delassus(mechanism, state))


def forces(mechanism, state):
    found = jc.contact_forces(mechanism, state, jax.numpy.full((len(mechanism.contacts),), 0.1))
    return found.normal, found.acceleration, found.status


QUANTITIES = {"operators W, Wt, w": free_acceleration, "norm_ratio": bound, "contact_forces": forces}


def table() -> list[dict]:
    return [
        {"scene": name, **{what: operations(f, g, g.state(**chart)) for what, f in QUANTITIES.items()}}
        for name, g, chart in SCENES
    ]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks operations", description=__doc__)
    parser.add_argument("--json", metavar="FILE", help="write the table there as well")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    rows = table()
    width = max(len(row["scene"]) for row in rows)
    print(f"{'scene':{width}}  " + "  ".join(f"{name:>18}" for name in QUANTITIES))
    for row in rows:
        print(f"{row['scene']:{width}}  " + "  ".join(f"{row[name]:>18}" for name in QUANTITIES))
    if options.json:
        with open(options.json, "w") as file:
            json.dump(rows, file, indent=1)
