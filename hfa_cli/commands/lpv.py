"""Linear models on the coarsest grid of dihedrals whose interpolation error is proved below a tolerance.

The error of A, B and the trimmed inputs is bounded at every angle between the nodes, in ball arithmetic. -o FILE.c
writes a C function of the interpolation, .npz and .mat the matrices. Needs python-flint (`pip install .[proof]`).
"""

from __future__ import annotations

import argparse

from hfa_cli import options
from hfa_cli.flight_family import family_of, interval_of
from hfa_cli.output import SUFFIXES, Progress, check_target, show
from hfa_cli.values import number
from hfa_model.support.errors import BadInputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa lpv`."""
    options.add_condition(parser)
    options.add_aircraft(parser)
    parser.add_argument("--tolerance", metavar="X", help="largest error, relative; default 1e-3")
    options.add_output(parser, " or .c")


def run(arguments: argparse.Namespace) -> int:
    """Bound, choose the nodes, report."""
    from hfa_model.support.files import write_text
    from verification.proof.balls import flint_or_refusal
    from verification.proof.lpv_grid import coarsest_grid
    from verification.proof.lpv_report import c_source, lpv_report

    flint_or_refusal()
    target = check_target(arguments.output, (*SUFFIXES, ".c"))
    tolerance = 1e-3 if arguments.tolerance is None else number(arguments.tolerance, "--tolerance")
    if not tolerance > 0.0:
        raise BadInputError(f"--tolerance is {tolerance:g}; it must be positive")
    family = family_of(arguments)
    low, high = interval_of(arguments, family)
    grid = coarsest_grid(family, low, high, tolerance, progress=Progress("lpv"))
    report = lpv_report(grid, tolerance, family.aircraft.variant.name)
    if target is not None and target.suffix.lower() == ".c":
        write_text(target, c_source(grid))
        target = None
    show(report, as_json=arguments.json, target=target)
    return 0
