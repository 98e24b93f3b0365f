"""Fly Section 5 of the paper again: figures 3 to 23 anew, and every claim with its number, law by law.

Writes FOLDER/SECTION/ with figure-NN.png, figure-NN.npz and result.json, and FOLDER/claims.json and claims.md. A claim
that is not confirmed is a result, not a failure. Exit code 0 when everything was flown, 1 when a law of this
project lost a flight or was not certified, or a game has no solution.
"""

from __future__ import annotations

import argparse

from hfa_cli.argument_types import parsed
from hfa_cli.output import Progress, check_folder
from hfa_cli.parser import add_value
from hfa_model.support.files import write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa reproduce`."""
    parser.add_argument("experiment", metavar="SECTION", help="5.1, 5.2, 5.3, 5.4 or all")
    folder = parsed(check_folder)
    about = "where results go; made when missing"
    parser.add_argument("-o", "--output", required=True, type=folder, metavar="FOLDER", help=about)
    about = "regenerated (trimmed and linearized here; default) or printed"
    add_value(parser, "--matrices", str, "SOURCE", about, default="regenerated")
    parser.add_argument("--reading", metavar="FILE", help="another reading of what the print leaves open (.toml)")
    parser.add_argument("--resume", action="store_true", help="keep experiments that are finished")
    parser.add_argument("--json", action="store_true", help="print the claims as JSON instead of text")


def run(arguments: argparse.Namespace) -> int:
    """Fly, draw, judge, write."""
    from verification.experiments.configuration import default_reading, load_reading
    from verification.experiments.reproduction import experiments, reproduce
    from verification.experiments.result_folder import json_text
    from verification.experiments.setting import make_setting
    from verification.experiments.tables import claims_markdown, claims_text

    chosen = experiments(arguments.experiment)
    reading = default_reading() if arguments.reading is None else load_reading(arguments.reading)
    setting = make_setting(reading, arguments.matrices)
    folder = arguments.output
    folder.mkdir(exist_ok=True)
    counters: dict[str, Progress] = {}

    def show(section: str, done: int, total: int) -> None:
        counters.setdefault(section, Progress(f"reproduce {section}"))(done, total)

    table = reproduce(chosen, setting, folder, resume=arguments.resume, progress=show)
    write_text(folder / "claims.json", json_text(table))
    write_text(folder / "claims.md", claims_markdown(table))
    print(json_text(table) if arguments.json else claims_text(table), end="" if arguments.json else "\n")
    return 1 if table["own_failures"] else 0
