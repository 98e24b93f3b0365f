"""Regenerate both printed pairs (A, B) from one aircraft and compare them with the printed ones, entry by entry."""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.output import show_verdict
from verification.regeneration.regeneration import regenerate_all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa regenerate`."""
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Regenerate and compare; exit 1 when a check fails."""
    return show_verdict(regenerate_all(options.aircraft_of(arguments)), arguments)
