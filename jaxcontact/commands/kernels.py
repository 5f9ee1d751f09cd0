"""`jaxcontact kernels [--build]`."""

import argparse

from .. import native
from ..native.build import CannotBuild, build


def run_kernels(given: argparse.Namespace) -> None:
    """Print whether the compiled kernels are in use, or why not; with --build, compile them first."""
    if given.build:
        try:
            print(build())
        except CannotBuild as reason:
            raise OSError(str(reason)) from reason
    reason = native.reason()
    print(f"not in use: {reason}" if reason else "in use")


def add_kernels(commands, everywhere: argparse.ArgumentParser) -> None:
    """Register the command with the parsers of `jaxcontact.__main__`."""
    text = "whether the compiled kernels of the solvers are in use, or why not"
    command = commands.add_parser("kernels", help=text, description=f"Say {text}.", parents=[everywhere])
    command.add_argument("--build", action="store_true", help="compile them for this machine first")
    command.set_defaults(run=run_kernels)
