"""One mechanism per file: parameters in, energies, gaps and slips out."""

from .articulated_painleve_klein import ArticulatedPainleveKlein
from .flexible_painleve_klein import FlexiblePainleveKlein
from .guided_rod import GuidedRod
from .guided_rod_under_ceiling import GuidedRodUnderCeiling
from .linear_bearing import LinearBearing
from .painleve_klein import PainleveKlein
from .painleve_rod import PainleveRod
from .rod_between_floor_and_ceiling import RodBetweenFloorAndCeiling

_FIGURE_1_THEN_MORE = (
    GuidedRod,
    PainleveRod,
    GuidedRodUnderCeiling,
    PainleveKlein,
    FlexiblePainleveKlein,
    ArticulatedPainleveKlein,
    RodBetweenFloorAndCeiling,
    LinearBearing,
)


def all_mechanisms() -> dict[str, type]:
    """The mechanisms that ship, by class name, in the order of Figure 1 of the tutorial.

    `all_mechanisms()["PainleveKlein"]`
    """
    return {cls.__name__: cls for cls in _FIGURE_1_THEN_MORE}


__all__ = ["all_mechanisms", *(cls.__name__ for cls in _FIGURE_1_THEN_MORE)]
