"""Compare the model with what others have printed and released: a third printed model, and a simulation's trims."""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.output import show_verdict


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa validate`."""
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Compare and report; exit 1 when a difference is beyond its limit."""
    from verification.validation.comparison import validate

    return show_verdict(validate(options.aircraft_of(arguments)), arguments)
