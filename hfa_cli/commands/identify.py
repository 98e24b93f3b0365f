"""Find the aircraft's parameters from the printed matrices and say how far to trust them."""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import whole
from hfa_cli.options.parser import add_value
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from trim.identification.identify import run_identification, save_fit

#: Suffix of a parameters file.
PARAMETERS = ".toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa identify`."""
    add_value(parser, "--seed", whole(0), "N", "seed of the rough guesses; default 0", default=0)
    options.add_output(parser, PARAMETERS, what=" (the parameters)")


def run(arguments: argparse.Namespace) -> int:
    """Identify, report, and write the parameters where asked."""
    target = arguments.output
    as_parameters = target is not None and target.suffix.lower() == PARAMETERS
    if as_parameters:
        options.refuse_files(arguments, ("output",), "a parameters file is in ft, slug, lbf")
    result = run_identification(arguments.seed, ProgressLine("identify"))
    if as_parameters:
        save_fit(result.fit, target)
        target = None
    show(result.report(), arguments, target=target)
    return 0
