"""Regenerate both printed pairs (A, B) from one aircraft and compare them with the printed ones, entry by entry."""

from __future__ import annotations

import argparse

from hfa_cli.options import trims
from hfa_cli.options.parser import Options
from hfa_cli.output import show
from verification.regeneration import regenerate_all


def options() -> Options:
    """Of `hfa regenerate`."""
    return {**trims.HFA_OPTIONS, **trims.output()}


def run(arguments: argparse.Namespace) -> int:
    """Regenerate and compare; exit 1 when a check fails."""
    found = regenerate_all(trims.hfa_of(arguments))
    show(found.report(), arguments, target=arguments.output)
    return 0 if found.ok else 1
