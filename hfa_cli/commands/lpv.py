"""Linear models on the coarsest grid of dihedrals whose interpolation error is proved below a tolerance.

The error of A, B, the trimmed inputs and the exact game's gain K is bounded at every angle between the nodes, in ball
arithmetic. -o FILE.c writes a C function of the interpolation, .npz and .mat the matrices. Needs python-flint
(`pip install .[proof]`).
"""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import output_file, positive
from hfa_cli.options.parser import add_value
from hfa_cli.origin import origin_lines, provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa lpv`."""
    options.add_flights(parser, "LOW:HIGH")
    add_value(parser, "--limit-error", positive, "X", "of the interpolation, relative; default 1e-3", default=1e-3)
    add_value(parser, "--certificate", output_file(".json"), "FILE", "also write what `hfa prove --check` verifies")
    options.add_output(parser, ".c")


def run(arguments: argparse.Namespace) -> int:
    """Bound, choose the nodes, report."""
    from hfa_support.files import write_text
    from verification.arithmetic import flint_or_refusal
    from verification.proof.lpv_grid import c_source, certify, coarsest_grid, lpv_report

    flint_or_refusal()
    options.refuse(arguments, ("start",), "belongs to a single trim; leave it out")
    family = options.family_of(arguments)
    low, high = options.interval_of(arguments, family)
    grid = coarsest_grid(family, low, high, arguments.limit_error, progress=ProgressLine("lpv"))
    if arguments.certificate is not None:
        certify(grid, arguments.certificate, provenance())
    target = arguments.output
    if target is not None and target.suffix.lower() == ".c":
        write_text(target, c_source(grid, origin_lines()))
        target = None
    show(lpv_report(grid, arguments.limit_error), arguments, target=target)
    return 0
