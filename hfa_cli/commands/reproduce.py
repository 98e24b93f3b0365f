"""Simulate Section 5 of the paper again: figures 3 to 23 anew, and every claim with its number, law by law.

Writes FOLDER/SECTION/ with figure-NN.png, figure-NN.npz and result.json, and FOLDER/claims.json and claims.md. A claim
that is not confirmed is a result, not a failure. Exit code 0 when every flight was simulated, 1 when a law
of this project lost the aircraft or was not certified, or a game has no solution.
"""

from __future__ import annotations

import argparse

from hfa_cli.options.argument_types import check_folder, parsed, whole
from hfa_cli.options.parser import add_refused, add_value
from hfa_cli.options.shared_options import DEFAULT_DYNAMICS, MOST_WORKERS, cores
from hfa_cli.origin import provenance
from hfa_cli.progress import ProgressLine
from hfa_support.files import write_texts
from hfa_support.jsonable import records_text
from hfa_support.streams import say

#: Steps of a flight from which starting processes pays.
_LONG = 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa reproduce`."""
    parser.add_argument("experiment", metavar="SECTION", help="5.1, 5.2, 5.3, 5.4 or all")
    folder = parsed(check_folder)
    about = "where results go; made when missing"
    parser.add_argument("-o", "--output", required=True, type=folder, metavar="FOLDER", help=about)
    about = "regenerated (trimmed and linearized here; default) or printed"
    add_value(parser, "--matrices", str, "SOURCE", about, default="regenerated")
    parser.add_argument("--resume", action="store_true", help="keep experiments that are finished")
    about = "processes that share the flights; default: one a core for long flights, else 1"
    add_value(parser, "--workers", whole(1, MOST_WORKERS), "N", about)
    add_refused(
        parser, "--reading", "is no longer there: the configuration is that of verification/experiments/section5.toml"
    )
    parser.add_argument("--json", action="store_true", help="print the claims as JSON instead of text")
    parser.set_defaults(parameters=None, dynamics=DEFAULT_DYNAMICS)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, draw, check, write."""
    from verification.experiments.configuration import section5_configuration
    from verification.experiments.reproduction import experiments, reproduce
    from verification.experiments.setting import make_setting
    from verification.experiments.tables import claims_markdown, claims_text

    chosen = experiments(arguments.experiment)
    setting = make_setting(section5_configuration(), arguments.matrices)
    folder = arguments.output
    folder.mkdir(exist_ok=True)
    counters: dict[str, ProgressLine] = {}

    def show(section: str, done: int, total: int) -> None:
        counters.setdefault(section, ProgressLine(f"reproduce {section}"))(done, total)

    flight = setting.configuration.flight
    steps = flight.ticks * flight.steps_per_tick
    processes = arguments.workers or (cores() if steps >= _LONG else 1)
    origin = provenance()
    table = reproduce(chosen, setting, folder, origin, resume=arguments.resume, progress=show, processes=processes)
    written = claims_markdown(table) + f"\n{origin.text()}\n"
    write_texts(folder, {"claims.json": records_text(table), "claims.md": written})
    said = records_text(table) if arguments.json else f"{claims_text(table)}\n\n{origin.text()}"
    say(said.removesuffix("\n"))
    return 1 if table["own_failures"] else 0
