"""The command line: `jaxcontact list | curve | atlas | figures | regimes | explain | kernels`."""

import argparse
import sys
from collections.abc import Sequence

import jax

from .commands import add_explain, add_kernels, add_regimes, run_atlas, run_curve, run_figures, run_list

MISUSE = 2  # exit code, as of argparse

EXAMPLES = """examples:
  jaxcontact list
  jaxcontact list PainleveKlein
  jaxcontact curve PainleveKlein --over theta=0.05:1.5:400 --out bound.png
  jaxcontact curve painleve-klein --over theta=0.05:1.5:400 --set length=1.2 --bound norm_ratio prop11 --out bound.csv
  jaxcontact atlas FlexiblePainleveKlein --over theta=0.05:1.5:200 --over d=-0.4:2:200 --out atlas.svg
  jaxcontact curve my_drawer.py:Drawer --over offset=0:0.5:200 --out drawer.png
  jaxcontact figures --out figures
  jaxcontact regimes --friction 2 --out regimes.png
  jaxcontact explain PainleveKlein --at theta=0.9 --mu 0.4
"""
OVER = "a coordinate or parameter and its range: name=start:stop:count, angles in rad"
SET = "the value of another coordinate, parameter or choice: name=value; may be repeated"
MECHANISM = "a name that `jaxcontact list` prints, or path/to/file.py:ClassName"
BOUND = "one or more of those that `jaxcontact list` prints; default: norm_ratio"
OUT = "the file to write: .png or .svg (picture), .csv or .nc (numbers)"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if all is written, 2 if the command makes no sense (one line says why).

    Example: `main(["figures", "--out", "figures"])`
    """
    given = _parser().parse_args(argv)
    try:
        with jax.enable_x64(given.dtype == "float64"):
            given.run(given)
    except (ValueError, TypeError, OSError, ImportError) as misuse:
        if given.traceback:
            raise
        print(f"jaxcontact: error: {misuse}", file=sys.stderr)
        return MISUSE
    return 0


def _parser() -> argparse.ArgumentParser:
    everywhere = argparse.ArgumentParser(add_help=False)
    everywhere.add_argument(
        "--dtype", choices=("float64", "float32"), default="float64", help="precision of the numbers"
    )
    everywhere.add_argument("--traceback", action="store_true", help="show where an error comes from")
    parser = argparse.ArgumentParser(
        prog="jaxcontact",
        description="How much friction a mechanism bears: curves and atlases of friction bounds.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(required=True, metavar="{list,curve,atlas,figures,regimes,explain,kernels}")
    _add_list(commands, everywhere)
    _add_sweep(commands, everywhere, "curve", "a bound along one coordinate or parameter", run_curve)
    _add_sweep(commands, everywhere, "atlas", "a bound over two or more coordinates or parameters", run_atlas)
    figures = commands.add_parser("figures", help="Figures 3 to 7 of the tutorial, corrected", parents=[everywhere])
    figures.add_argument("--out", required=True, help="folder for the pictures (.png, .svg) and numbers (.csv)")
    figures.set_defaults(run=run_figures)
    add_regimes(commands, everywhere)
    add_explain(commands, everywhere)
    add_kernels(commands, everywhere)
    return parser


def _add_list(commands, everywhere: argparse.ArgumentParser) -> None:
    command = commands.add_parser("list", help="the mechanisms and bounds there are", parents=[everywhere])
    command.add_argument("mechanism", nargs="?", help="describe this one: its coordinates and parameters")
    command.set_defaults(run=run_list)


def _add_sweep(commands, everywhere: argparse.ArgumentParser, name: str, text: str, run) -> None:
    command = commands.add_parser(
        name,
        help=text,
        description=f"Compute and draw {text}.",
        epilog=EXAMPLES,
        parents=[everywhere],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("mechanism", help=MECHANISM)
    command.add_argument("--over", action="append", required=True, metavar="NAME=START:STOP:COUNT", help=OVER)
    command.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help=SET)
    command.add_argument("--bound", action="extend", nargs="+", metavar="BOUND", help=BOUND)
    command.add_argument("--angles", choices=("deg", "rad"), default="deg", help="how a picture shows angles")
    command.add_argument("--out", required=True, metavar="FILE", help=OUT)
    command.set_defaults(run=run)


if __name__ == "__main__":
    sys.exit(main())
