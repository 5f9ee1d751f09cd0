"""`jaxcontact explain MECHANISM --at theta=0.9 --mu 0.4`."""

import argparse

import jax.numpy as jnp
import numpy as np

from ..bounds import certify, explain
from ..dynamics import delassus
from .reading import check_complete, read_class, read_settings


def run_explain(given: argparse.Namespace) -> None:
    """Print what each statement of the tutorial says of one configuration, in words."""
    cls = read_class(given.mechanism)
    fields, coordinates = read_settings(cls, [*given.at, *given.set])
    check_complete(cls, coordinates)
    mechanism = cls(**fields)
    contacts = len(mechanism.contacts)
    if len(given.mu) not in (1, contacts):
        raise ValueError(f"--mu: give one coefficient for all, or one for each of the {contacts} contacts")
    place = {name: jnp.asarray(value, given.dtype) for name, value in coordinates.items()}
    here = delassus(mechanism, mechanism.state(**place))
    print(explain(certify(here, jnp.asarray(np.broadcast_to(np.array(given.mu, given.dtype), (contacts,))))))


def add_explain(commands, everywhere: argparse.ArgumentParser) -> None:
    """Register the command with the parsers of `jaxcontact.__main__`."""
    text = "what the statements of the tutorial say of one configuration, in words"
    command = commands.add_parser("explain", help=text, description=f"Print {text}.", parents=[everywhere])
    command.add_argument("mechanism", help="a name that `jaxcontact list` prints, or path/to/file.py:ClassName")
    command.add_argument("--at", action="extend", nargs="+", default=[], metavar="NAME=VALUE", help="the coordinates")
    command.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameters")
    command.add_argument("--mu", nargs="+", type=float, required=True, help="one coefficient, or one per contact")
    command.set_defaults(run=run_explain)
