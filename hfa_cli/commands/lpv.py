"""Linear models on the coarsest grid of dihedrals whose interpolation error is proved below a tolerance.

The error of A, B, the trimmed inputs and the exact game's gain K is bounded at every angle between the nodes, in ball
arithmetic. -o FILE.json writes a certificate that `hfa prove --check` verifies, .npz, .mat and .csv the matrices. Needs
python-flint (`pip install .[proof]`).
"""

from __future__ import annotations

import argparse

from hfa_cli.options import trims
from hfa_cli.options.argument_types import positive
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import ProgressLine, provenance, show


def options() -> Options:
    """Of `hfa lpv`."""
    limit = Option("of the interpolation, relative; default 1e-3", "X", positive, more={"default": 1e-3})
    return {**trims.proved_trims("LOW:HIGH"), "--limit-error": limit, **trims.output()}


def run(arguments: argparse.Namespace) -> int:
    """Bound, choose the nodes, report."""
    from verification.arithmetic import flint_or_refusal
    from verification.proof.lpv_grid import coarsest_grid

    flint_or_refusal()
    trims.refuse(arguments, ("start",), "belongs to a single trim; leave it out")
    family, target = trims.family_of(arguments), arguments.output
    low, high = trims.interval_of(arguments, family)
    proof = coarsest_grid(family, low, high, arguments.limit_error, progress=ProgressLine("lpv"))
    if certified := target is not None and target.suffix.lower() == ".json":
        proof.write(target, provenance())
    show(proof.report(), arguments, target=None if certified else target)
    return 0
