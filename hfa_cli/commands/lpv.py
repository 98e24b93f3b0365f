"""Linear models on the coarsest grid of dihedrals whose interpolation error is proved below a tolerance.

The error of A, B, the trimmed inputs and the exact game's gain K is bounded at every angle between the nodes, in ball
arithmetic. -o writes the matrices. Needs python-flint (`pip install .[proof]`).
"""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import output_file, positive
from hfa_cli.options.parser import add_value
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa lpv`."""
    options.add_flights(parser, "LOW:HIGH")
    add_value(parser, "--limit-error", positive, "X", "of the interpolation, relative; default 1e-3", default=1e-3)
    add_value(parser, "--certificate", output_file(".json"), "FILE", "also write what `hfa prove --check` verifies")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Bound, choose the nodes, report."""
    from verification.arithmetic import flint_or_refusal
    from verification.proof.lpv_grid import coarsest_grid

    flint_or_refusal()
    options.refuse(arguments, ("start",), "belongs to a single trim; leave it out")
    family = options.family_of(arguments)
    low, high = options.interval_of(arguments, family)
    proof = coarsest_grid(family, low, high, arguments.limit_error, progress=ProgressLine("lpv"))
    if arguments.certificate is not None:
        proof.write(arguments.certificate, provenance())
    show(proof.report(), arguments, target=arguments.output)
    return 0
