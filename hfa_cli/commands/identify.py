"""Find the aircraft's parameters from the printed matrices and say how far to trust them."""

from __future__ import annotations

import argparse

from hfa_cli.options import trims
from hfa_cli.options.argument_types import whole
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import ProgressLine, show
from trim.identification.identify import run_identification, save_fit

#: Suffix of a parameters file.
PARAMETERS = ".toml"


def options() -> Options:
    """Of `hfa identify`."""
    seed = Option("seed of the rough guesses; default 0", "N", whole(0), more={"default": 0})
    return {"--seed": seed, **trims.output(PARAMETERS, what=" (the parameters)")}


def run(arguments: argparse.Namespace) -> int:
    """Identify, report, and write the parameters where asked."""
    target = arguments.output
    as_parameters = target is not None and target.suffix.lower() == PARAMETERS
    if as_parameters:
        trims.refuse_files(arguments, ("output",), "a parameters file is in ft, slug, lbf")
    result = run_identification(arguments.seed, ProgressLine("identify"))
    if as_parameters:
        save_fit(result.fit, target)
    show(result.report(), arguments, target=None if as_parameters else target)
    return 0
