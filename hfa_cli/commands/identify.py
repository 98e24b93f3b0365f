"""Find the aircraft's parameters from the printed matrices and say how far to trust them."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import parsed, whole
from hfa_cli.options.parser import add_value
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError
from trim.identification.identify import run_identification, save_fit

#: Suffix of a parameters file.
PARAMETERS = ".toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa identify`."""
    add_value(parser, "--seed", whole(0), "N", "seed of the rough guesses; default 0", default=0)
    about = "write parameters.toml into this folder"
    add_value(parser, "--write", parsed(_folder), "FOLDER", about)
    options.add_output(parser, PARAMETERS, what=" (the parameters)")


def run(arguments: argparse.Namespace) -> int:
    """Identify, report, and write the parameters where asked."""
    target = arguments.output
    named = ("output",) * (target is not None and target.suffix.lower() == PARAMETERS)
    options.refuse_files(arguments, ("write", *named), "a parameters file is in ft, slug, lbf")
    result = run_identification(arguments.seed, ProgressLine("identify"))
    if arguments.write is not None:
        save_fit(result.fit, arguments.write / "parameters.toml")
    if target is not None and target.suffix.lower() == PARAMETERS:
        save_fit(result.fit, target)
        target = None
    show(result.report(), arguments, target=target)
    return 0


def _folder(text: str) -> Path:
    """A folder that is there."""
    if not text or not Path(text).is_dir():
        raise BadInputError(f"{text or repr(text)}: there is no such folder; create it first")
    return Path(text)
