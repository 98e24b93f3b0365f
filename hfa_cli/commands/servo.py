"""Fly servos through the step commands of SimVFA, with the actuators as designed and with its faults, law by law.

The flights begin at 11 degrees. Writes FOLDER/CASE.json and CASE.png as each case is finished, in the units that
--units names. A law that loses the aircraft is a result, not a failure.
"""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import check_folder, number, parsed
from hfa_cli.options.parser import add_value
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_support.errors import refuse_unknown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa servo`."""
    parser.add_argument("case", metavar="CASE", nargs="?", default="all", help="a case by its name, or all (default)")
    about = "where results go; made when missing"
    parser.add_argument("-o", "--output", required=True, type=parsed(check_folder), metavar="FOLDER", help=about)
    parser.add_argument("--resume", action="store_true", help="keep the cases that are finished")
    about = "fly this controller too (.npz); repeatable"
    parser.add_argument("--controller", action="append", metavar="FILE", help=about)
    about = "fly this law only, by its name in the table; repeatable"
    parser.add_argument("--law", action="append", default=[], metavar="NAME", help=about)
    add_value(parser, "--duration", number, "S", "default: the whole sequence, 1051")
    options.add_aircraft(parser)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly, keep, report."""
    from controller.design.scheduled_controller import load_controller
    from verification.servo.cases import CASES, DURATION
    from verification.servo.servo_flights import run_case
    from verification.servo.servo_result import servo_report

    refuse_unknown("there is no case", arguments.case, (*CASES, "all"))
    duration = DURATION if arguments.duration is None else arguments.duration
    aircraft = options.aircraft_of(arguments)
    controllers = {path: load_controller(path) for path in arguments.controller or ()}
    counters: dict[str, ProgressLine] = {}

    def show_done(what: str, done: int, total: int) -> None:
        case = what.partition(",")[0]
        counters.setdefault(case, ProgressLine(f"servo {case}"))(done, total)

    names = CASES if arguments.case == "all" else (arguments.case,)
    results = [
        run_case(
            aircraft,
            name,
            controllers,
            arguments.output,
            provenance(),
            duration=duration,
            resume=arguments.resume,
            progress=show_done,
            only=arguments.law,
        )
        for name in names
    ]
    show(servo_report(results), arguments, target=None)
    return 0
