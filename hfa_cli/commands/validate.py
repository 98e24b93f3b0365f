"""Compare the model with what others have printed and released: a third printed model, and a simulation's trims."""

from __future__ import annotations

import argparse

from hfa_cli.options import trims
from hfa_cli.options.parser import Options
from hfa_cli.output import show


def options() -> Options:
    """Of `hfa validate`."""
    return {**trims.HFA_OPTIONS, **trims.output()}


def run(arguments: argparse.Namespace) -> int:
    """Compare and report; exit 1 when a difference is beyond its limit."""
    from verification.validation import validate

    found = validate(trims.hfa_of(arguments))
    show(found.report(), arguments, target=arguments.output)
    return 0 if found.ok else 1
