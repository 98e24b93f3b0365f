"""Trims and linear models over a grid of one or two conditions; modes tracked, failures kept as rows."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from hfa_cli import options
from hfa_cli.output import Progress, check_target, deliver
from hfa_cli.values import grid
from hfa_model.errors import BadInputError
from trim.sweep import MOST_POINTS, SWEPT, sweep
from trim.sweep_report import sweep_table, sweep_text, sweep_warnings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa sweep`."""
    for name, unit in zip(SWEPT, ("deg", "ft/s", "ft", "deg"), strict=True):
        parser.add_argument(f"--{name}", metavar="RANGE", help=f"start:stop:step, a,b,c or one number, {unit}")
    parser.add_argument("--full", action="store_true", help="seven states, with altitude")
    parser.add_argument(
        "--picture", metavar="FILE", help="draw the root locus of a sweep in one variable (.png or .svg)"
    )
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Sweep and report; exit 1 when no point has a trim."""
    target = check_target(arguments.output)
    picture = check_target(arguments.picture, (".png", ".svg"))
    aircraft = options.aircraft_of(arguments)
    given = {name: getattr(arguments, name) for name in SWEPT if getattr(arguments, name) is not None}
    if not given:
        raise BadInputError(f"nothing to sweep; give at least one of {', '.join('--' + name for name in SWEPT)}")
    axes = {name: grid(name, text, MOST_POINTS) for name, text in given.items()}
    result = sweep(aircraft, axes, full=arguments.full, progress=Progress("sweep"))
    if picture is not None:
        from verification.figures import root_locus

        root_locus(result, picture)
    deliver(
        result.to_dict(),
        lambda: sweep_text(result),
        lambda: sweep_table(result),
        as_json=arguments.json,
        target=target,
    )
    for warning in sweep_warnings(result):
        print(f"hfa: note: {warning}", file=sys.stderr)
    return 0 if np.any(result.trimmed) else 1
