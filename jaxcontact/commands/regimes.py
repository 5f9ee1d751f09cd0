"""`jaxcontact regimes --out FILE`."""

import argparse

from .. import atlas
from ..mechanisms import PainleveRod
from .reading import read_settings

PICTURES = (".png", ".svg")


def run_regimes(given: argparse.Namespace) -> None:
    """Write the map of Painlevé's rod as a picture or as numbers."""
    # The figures need the extra `plot`, which the other commands can do without.
    from ..figures.regimes import ANGLES, MEANINGS, RATES, regimes

    out = atlas.check_path(given.out)
    if not 0 <= given.friction < float("inf"):
        raise ValueError(f"--friction must be finite and not negative, got {given.friction}")
    fields, coordinates = read_settings(PainleveRod, given.set)
    if coordinates:
        raise ValueError(f"--set {', '.join(coordinates)}: the map goes over these; set length, mass or gravity")
    axes = (row.astype(given.dtype) for row in (ANGLES, RATES))
    numbers, picture = regimes(PainleveRod(**fields), given.friction, *axes)
    atlas.save(picture if out.suffix.lower() in PICTURES else numbers, out)
    share = {name: float((numbers.regime == value).mean()) for name, value in MEANINGS.items()}
    print(f"{out}: " + ", ".join(f"{name} {100 * part:.1f} %" for name, part in share.items() if part))


def add_regimes(commands, everywhere: argparse.ArgumentParser) -> None:
    """Register the command with the parsers of `jaxcontact.__main__`."""
    text = "where Painlevé's rod slides, takes off, or has no or two solutions"
    command = commands.add_parser("regimes", help=text, description=f"Map {text}.", parents=[everywhere])
    command.add_argument("--friction", type=float, default=2.0, help="coefficient of friction, default 2")
    command.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="length, mass or gravity")
    command.add_argument("--out", required=True, metavar="FILE", help=".png or .svg (picture), .csv or .nc (numbers)")
    command.set_defaults(run=run_regimes)
