"""Find the aircraft's parameters from the printed matrices and say how far to trust them."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfa_cli import options
from hfa_cli.output import SUFFIXES, Progress, check_target, deliver
from hfa_cli.values import whole
from hfa_model.support.errors import BadInputError
from trim.identification.evidence import run_identification, save_fit, save_identification
from trim.identification.identification_report import identification_data, identification_table, identification_text

#: Suffix of a parameters file.
PARAMETERS = ".toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa identify`."""
    parser.add_argument("--seed", metavar="N", help="seed of the rough guesses; default 0")
    parser.add_argument(
        "--write", metavar="FOLDER", help="write parameters.toml and parameters_rival.toml into this folder"
    )
    options.add_output(parser, " or .toml (the parameters)")


def run(arguments: argparse.Namespace) -> int:
    """Identify, report, and write the parameters where asked."""
    target = check_target(arguments.output, (*SUFFIXES, PARAMETERS))
    seed = whole("--seed", arguments.seed, 0, lowest=0)
    folder = None if arguments.write is None else Path(arguments.write)
    if folder is not None and not (arguments.write and folder.is_dir()):
        raise BadInputError(f"the folder {arguments.write or repr(arguments.write)} does not exist; create it first")
    result = run_identification(seed, Progress("identify"))
    if folder is not None:
        save_identification(result, folder)
    if target is not None and target.suffix.lower() == PARAMETERS:
        save_fit(result.fit, target)
        target = None
    deliver(
        identification_data(result),
        lambda: identification_text(result),
        lambda: identification_table(result),
        as_json=arguments.json,
        target=target,
    )
    return 0
