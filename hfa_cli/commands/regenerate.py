"""Regenerate both printed pairs (A, B) from one aircraft and compare them with the print, entry by entry."""

from __future__ import annotations

import argparse

from hfa_cli import options
from hfa_cli.output import deliver
from verification.published.regeneration import regenerate_all, regeneration_data, regeneration_table, regeneration_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa regenerate`."""
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Regenerate, compare and judge; exit 1 when a check fails."""
    pairs = regenerate_all(options.aircraft_of(arguments))
    data = regeneration_data(pairs)
    deliver(
        data,
        lambda: regeneration_text(pairs),
        lambda: regeneration_table(pairs),
        as_json=arguments.json,
        target=arguments.output,
    )
    return 0 if data["ok"] else 1
