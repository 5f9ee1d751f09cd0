"""A scene pays for what it has: operations in the compiled program fall as contacts lose what they can do."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks.operations import QUANTITIES, SCENES, operations
from jaxcontact.mechanisms import GuidedRod


@pytest.mark.parametrize("name", ["operators W, Wt, w", "norm_ratio"])
def test_operations_fall_from_scene_to_scene(name):
    counts = [operations(QUANTITIES[name], g, g.state(**chart)) for _, g, chart in SCENES]
    assert counts == sorted(counts, reverse=True), counts
    assert counts[-1] < 0.8 * counts[0], counts
    # Friction, then velocity: the last two scenes differ in velocity alone, which only the free acceleration feels.
    assert name == "norm_ratio" or len(set(counts)) == len(counts), counts


def test_the_bound_of_one_contact_is_little_more_than_a_division():
    """The division, one sine and cosine, and for each of three masses whether rounding has swallowed it."""
    rod = GuidedRod()
    assert operations(QUANTITIES["norm_ratio"], rod, rod.state(theta=0.9)) < 70
