"""Figures 3 and 7: one sliding contact, its forces read off a picture."""

from collections.abc import Callable

import numpy as np
import xarray
from matplotlib.figure import Figure

from ..atlas import draw_scalar_picture
from ..dynamics import delassus
from ..mechanisms import GuidedRod, PainleveRod

ANGLE = np.pi / 4  # of the rod from the horizontal; the critical friction (1 + 3 cos^2) / (3 sin cos) is 5/3 there
FRICTIONS = (0.8, 5 / 3, 2.5)  # below it, at it, above it
LOADS = (-1.0, 1.0)  # m/s^2, w
LEFTWARDS = -1.0  # xi, the sign of the sliding velocity for which friction harms when 0 < theta < pi/2
FORCES = np.linspace(-1.0, 1.5, 251)  # N
PUSHES = np.linspace(0.0, 1.5, 151)  # N
MARGIN_OF_ZERO = 1e-12  # slopes A (1 - mu / mu_crit) below this share of A are the critical one, rounded

Law = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # (force, friction, load), broadcast together


def figure_3a() -> tuple[xarray.Dataset, Figure]:
    """The acceleration of the guided tip over the contact force: solutions where it vanishes.

    A λ - A_t μ ξ |λ| + w, the scalar case of (40), tutorial section 3.2.2.
    """
    A, At = _couplings(GuidedRod())
    numbers = _numbers(
        FORCES,
        left=lambda force, friction, load: A * force - At * friction * LEFTWARDS * np.abs(force) + load,
        right=lambda force: np.zeros_like(force),
        solutions=lambda friction, load: _bilateral_solutions(A, At, friction, load),
    )
    _describe(numbers, ("normal acceleration of the tip", "m/s²"), "required: stays in the guide")
    caption = (
        "Figure 3(a), corrected. Rod in a bilateral guide, θ = 45°, tip sliding to the left: A λ − A_t μ ξ |λ| + w; "
        "the critical friction is 5/3. Erratum B11: above it, none for w < 0 and two for w > 0 holds where A_t ξ > 0, "
        "as here; where A_t ξ < 0 it is the reverse."
    )
    return numbers, draw_scalar_picture(numbers, caption=caption)


def figure_3b() -> tuple[xarray.Dataset, Figure]:
    """The same solutions as fixed points of λ -> A^-1 A_t μ ξ |λ| - A^-1 w: unique while the slope is below one."""
    A, At = _couplings(GuidedRod())
    numbers = _numbers(
        FORCES,
        left=lambda force, friction, load: (At * friction * LEFTWARDS * np.abs(force) - load) / A,
        right=lambda force: force,
        solutions=lambda friction, load: _bilateral_solutions(A, At, friction, load),
    )
    _describe(numbers, ("fixed-point map", "N"), "λ itself")
    caption = (
        "Figure 3(b), corrected. The contact force as a fixed point of λ → (A_t μ ξ |λ| − w) / A. Slopes below one in "
        "size give one solution for every load; which load gives two and which none above that depends on the sign "
        "of A_t ξ (erratum B11)."
    )
    return numbers, draw_scalar_picture(numbers, caption=caption)


def figure_7() -> tuple[xarray.Dataset, Figure]:
    """Painlevé's rod on a floor: 0 <= λ ⊥ A λ + w >= 0 with A = A_n - A_t μ ξ, equation (59)."""
    A, At = _couplings(PainleveRod())
    numbers = _numbers(
        PUSHES,
        left=lambda force, friction, load: (A - At * friction * LEFTWARDS) * force + load,
        right=lambda force: np.zeros_like(force),
        solutions=lambda friction, load: _unilateral_solutions(A, At, friction, load),
    )
    _describe(numbers, ("normal acceleration of the tip", "m/s²"), "in contact: zero")
    caption = (
        "Figure 7, corrected. Painlevé's rod, θ = 45°, tip sliding to the left: 0 ≤ λ ⊥ (A_n − A_t μ ξ) λ + w ≥ 0. "
        "Erratum B10: A > 0 is necessary and sufficient for a solution for every load; with A < 0 there are two for "
        "w > 0, contact and take-off, and none for w < 0; with A = 0 none for w < 0."
    )
    return numbers, draw_scalar_picture(numbers, caption=caption)


def _couplings(rod: GuidedRod | PainleveRod) -> tuple[float, float]:
    """A_n and A_t of the contact, 1/kg."""
    here = delassus(rod, rod.state(theta=ANGLE))
    return float(here.W[0, 0]), float(here.Wt[0, 0])


def _bilateral_solutions(A: float, At: float, friction: float, load: float) -> list[tuple[float, bool]]:
    """(λ, valid) on the branches λ > 0 and λ < 0 of A λ - A_t μ ξ |λ| + w = 0."""
    slopes = [A - At * friction * LEFTWARDS * side for side in (1.0, -1.0)]
    roots = [-load / slope if abs(slope) > MARGIN_OF_ZERO * A else np.nan for slope in slopes]
    return [(root, root * side > 0) for root, side in zip(roots, (1.0, -1.0), strict=True)]


def _unilateral_solutions(A: float, At: float, friction: float, load: float) -> list[tuple[float, bool]]:
    """(λ, valid) of contact, A λ + w = 0 with λ > 0, and of take-off, λ = 0 with w >= 0."""
    slope = A - At * friction * LEFTWARDS
    contact = -load / slope if abs(slope) > MARGIN_OF_ZERO * A else np.nan
    return [(contact, contact > 0), (0.0, load >= 0)]


def _numbers(force: np.ndarray, left: Law, right: Callable, solutions: Callable) -> xarray.Dataset:
    """The dataset `draw_scalar_picture` draws."""
    found = np.array([[solutions(friction, load) for friction in FRICTIONS] for load in LOADS])
    solution = np.where(found[..., 1] > 0, found[..., 0], np.nan)
    load, friction = np.array(LOADS), np.array(FRICTIONS)
    return xarray.Dataset(
        {
            "left": (("load", "friction", "force"), left(force, friction[:, None], load[:, None, None])),
            "right": ("force", right(force)),
            "solution": (("load", "friction", "branch"), solution),
            "height": (("load", "friction", "branch"), left(solution, friction[:, None], load[:, None, None])),
        },
        {"load": load, "friction": friction, "force": force, "branch": [0, 1]},
    )


def _describe(numbers: xarray.Dataset, left: tuple[str, str], right: str) -> None:
    numbers["left"].attrs = {"long_name": left[0], "units": left[1]}
    numbers["right"].attrs = {"long_name": right, "units": left[1]}
    numbers["solution"].attrs = {"long_name": "contact force", "units": "N"}
    numbers["force"].attrs = {"long_name": "contact force λ", "units": "N"}
    numbers["load"].attrs = {"long_name": "free acceleration w", "units": "m/s²"}
    numbers["friction"].attrs = {"long_name": "coefficient of friction", "units": "1"}
