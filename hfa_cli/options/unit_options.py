"""--units, the same in every command; and why some commands have none."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager

from hfa_cli.options.argument_types import one_of
from hfa_cli.options.parser import add_refused, add_value
from hfa_model.reporting.unit_system import SYSTEMS, shown_in
from hfa_model.support.errors import BadInputError

#: Command -> why what it says and writes stays in ft, slug, lbf.
IN_FEET = {
    "regenerate": "it compares digits that were printed in ft",
    "prove": "what is proved, and its certificate, is about numbers in ft",
    "lpv": "what is proved, and the C function, is about numbers in ft",
    "export": "the C, FMU and MATLAB files are in ft, slug, lbf, and say so",
    "study": "the paper's law runs on the printed matrices, which are in ft",
    "reproduce": "the paper's figures and claims are in ft",
}


def add_units(parser: argparse.ArgumentParser, command: str) -> None:
    """--units: of what is printed, drawn and written; what is typed stays in feet. Refused by a command `IN_FEET`."""
    if command not in IN_FEET:
        about = "units of what is printed, drawn and written: english (ft, slug, lbf; default) or si (m, kg, N)"
        add_value(parser, "--units", one_of(*SYSTEMS), "UNITS", about)
        return
    add_refused(parser, "--units", f"does not go with `hfa {command}`: {IN_FEET[command]}; leave it out")


def units_of(arguments: argparse.Namespace) -> AbstractContextManager[None]:
    """What is said inside is said in the units that --units names."""
    return shown_in(getattr(arguments, "units", None) or SYSTEMS[0])


def refuse_files(arguments: argparse.Namespace, names: tuple[str, ...], reason: str) -> None:
    """BadInputError when one of these options writes what is in feet whatever --units says."""
    for name in names:
        if arguments.units == "si" and getattr(arguments, name) is not None:
            raise BadInputError(
                f"--units si does not go with --{name} {getattr(arguments, name)}: {reason}; leave one out"
            )
