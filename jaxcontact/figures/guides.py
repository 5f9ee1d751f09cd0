"""Figures 4 to 6: how much friction a rod in two guides bears, rigid, telescoping and articulated."""

import jax.numpy as jnp
import numpy as np
import xarray
from jax import Array
from matplotlib.figure import Figure

from ..atlas import draw_curve, draw_friction_plane, sweep
from ..bounds import critical, critical_existence, norm_ratio
from ..dynamics import delassus
from ..mechanisms import ArticulatedPainleveKlein, FlexiblePainleveKlein, PainleveKlein

POINTS = 401  # along a curve
PLANE_POINTS = 61  # along each coefficient; the boundaries are interpolated
CORNER = np.array([0.999, 1.001])  # points this close to the corner of the square, lest interpolation cut it off
PLANE_END = 3.0  # greatest coefficient of friction in the plane
TOP, HIGH_TOP = 3.0, 12.0  # greatest friction drawn, for the rigid and for the telescoping rod
PLANE_ANGLE = np.pi / 4  # cot = 1 there: the triangle ends at 2, the square at 2/3
OPEN_RIGHT_ANGLE = np.linspace(0.0, np.pi / 2, POINTS)[1:-1]  # rad; at both ends friction does nothing or everything


def bound(mechanism: object, **coordinates: Array) -> Array:
    """The norm-ratio bound at a state of the chart."""
    return norm_ratio(delassus(mechanism, mechanism.state(**coordinates)))


def exact(mechanism: object, **coordinates: Array) -> Array:
    """The exact threshold for equal coefficients, every load and every sliding direction."""
    return critical(delassus(mechanism, mechanism.state(**coordinates)))


bound.unit, bound.long_name = "1", "bound, Proposition 10"
exact.unit, exact.long_name = "1", "exact, every load"
BOTH = {"bound": bound, "exact": exact}


def figure_4a() -> tuple[xarray.Dataset, Figure]:
    """The plane of the two coefficients: guaranteed square, triangle of uniqueness, strip of existence."""

    def square(guides, mu_1, mu_2):
        return jnp.maximum(mu_1, mu_2) / bound(guides, theta=PLANE_ANGLE)

    def triangle(guides, mu_1, mu_2):
        here = delassus(guides, guides.state(theta=PLANE_ANGLE))
        return 1.0 / critical(here, ratio=jnp.stack([mu_1, mu_2]))

    def strip(guides, mu_1, mu_2):
        here = delassus(guides, guides.state(theta=PLANE_ANGLE))
        same_way = jnp.ones(2, here.N.dtype)
        return 1.0 / critical_existence(here, same_way, ratio=jnp.stack([mu_1, mu_2]))

    strip.long_name = "a solution for every load: |μ₁ − μ₂| < 2 cot θ"
    triangle.long_name = "exactly one for every load: μ₁ + μ₂ < 2 cot θ"
    square.long_name = "guaranteed by Proposition 10"
    corner = float(bound(PainleveKlein(), theta=PLANE_ANGLE))
    row = np.union1d(np.linspace(0.0, PLANE_END, PLANE_POINTS), corner * CORNER)
    margins = {"strip": strip, "triangle": triangle, "square": square}
    numbers = sweep(margins, PainleveKlein(), mu_1=row, mu_2=row, progress=False)
    for name, guide in (("mu_1", "lower"), ("mu_2", "upper")):
        numbers[name].attrs = {"long_name": f"friction of the {guide} guide", "units": "1"}
    caption = (
        "Figure 4(a), corrected. Two rough guides, θ = 45°, both tips sliding the same way. Erratum B1: the printed "
        "condition for a unique solution, |μ₁ − μ₂| < 2 cot θ, is that for existence; uniqueness for every load needs "
        "μ₁ + μ₂ < 2 cot θ. Erratum B14: for θ ≥ 54.7° the square touches the triangle, the bound is exact for μ₁ = μ₂."
    )
    return numbers, draw_friction_plane(numbers, caption=caption)


def figure_4b() -> tuple[xarray.Dataset, Figure]:
    """The bound of the two rough guides over the angle, min(1 / (3 sin cos), cot), below the exact cot."""
    numbers = sweep(BOTH, PainleveKlein(), theta=OPEN_RIGHT_ANGLE, progress=False)
    caption = (
        "Figure 4(b), corrected. Two rough guides of equal friction: bound min(1/(3 sin θ cos θ), cot θ), exact cot θ. "
        "The printed text compares the bound with 2 cot θ, which is the limit for existence only (errata B1, B14)."
    )
    return numbers, draw_curve(numbers, caption=caption, upper=TOP)


def figure_5a() -> tuple[xarray.Dataset, Figure]:
    """The telescoping rod over the angle, for three gaps between its halves."""
    gaps = np.array([-1.2, 1.0, 1.2])
    numbers = sweep(BOTH, FlexiblePainleveKlein(), theta=OPEN_RIGHT_ANGLE, d=gaps, progress=False)
    caption = (
        "Figure 5(a), corrected. Telescoping rod, l = 1 m. Erratum A17: the printed exact condition "
        "μ₁ < (4 − 3cos²θ)/(3 sin θ cos θ) does not depend on d and is wrong; drawn is "
        "μ₁ + μ₂ < (6d² + 9dl + 4l² + p cos 2θ)/(|p| sin θ cos θ), p = l(3d + 2l), for μ₁ = μ₂. "
        "At d = −1.2 l, where the tips have changed places, bound and exact value agree."
    )
    return numbers, draw_curve(numbers, caption=caption, upper=HIGH_TOP)


def figure_5b() -> tuple[xarray.Dataset, Figure]:
    """The telescoping rod over its gap at 60 degrees, with the pole where friction does not act, d = -2l/3."""
    gaps = np.linspace(-1.5, 2.0, POINTS)

    def at_60_degrees(quantity):
        def fixed(mechanism, d):
            return quantity(mechanism, theta=jnp.asarray(np.pi / 3, d.dtype), d=d)

        fixed.unit, fixed.long_name = quantity.unit, quantity.long_name
        return fixed

    quantities = {name: at_60_degrees(quantity) for name, quantity in BOTH.items()}
    numbers = sweep(quantities, FlexiblePainleveKlein(), d=gaps, progress=False)
    caption = (
        "Figure 5(b), corrected. Telescoping rod at θ = 60°, l = 1 m. At d = −2l/3 friction does not act on "
        "the normal forces and the bound is infinite; to the left of it the bound is exact (erratum B14). The printed "
        "exact condition (erratum A17) would be a horizontal line."
    )
    return numbers, draw_curve(numbers, caption=caption, upper=HIGH_TOP)


def figure_6a() -> tuple[xarray.Dataset, Figure]:
    """The articulated rod, straight: bound = exact = cot."""
    numbers = sweep(BOTH, ArticulatedPainleveKlein(), theta1=OPEN_RIGHT_ANGLE, progress=False)
    caption = (
        "Figure 6(a), corrected. Articulated rod, straight (θ₂ = θ₁): bound = exact = cot θ₁, so the bound is not "
        "conservative here (erratum B14). The matrices are those of q = (x, y, θ₁, θ₂) (erratum A18)."
    )
    return numbers, draw_curve(numbers, caption=caption, upper=TOP)


def figure_6b() -> tuple[xarray.Dataset, Figure]:
    """The articulated rod between guides half its length apart, bent."""
    bent = ArticulatedPainleveKlein(length=1.0, spacing=0.5)
    numbers = sweep(BOTH, bent, theta1=OPEN_RIGHT_ANGLE, progress=False)
    caption = (
        "Figure 6(b), corrected. Articulated rod, θ₂ = arcsin(2D/l − sin θ₁) with D = l/2. At 30° it is straight: "
        "the bound has a kink there, equals the exact value √3, and is below it elsewhere. The matrices are those of "
        "q = (x, y, θ₁, θ₂) (erratum A18)."
    )
    return numbers, draw_curve(numbers, caption=caption)
