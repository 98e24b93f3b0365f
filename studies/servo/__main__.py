"""Servo controllers of SimVFA, adaptive laws and this project under commands, faults and gusts.

README.md describes the study, and findings.md contains its results.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

import hfa
import hfa_model
from hfa import BadInputError, NoSolutionError
from hfa.extend import Report
from hfa.paper import default_parameters
from hfa_aircraft.model import Model
from hfa_flight import load_controller
from hfa_support.errors import on_one_line, refuse_unknown
from hfa_support.provenance import Provenance, parameter_hash


def main() -> int:
    """Run a subcommand, by default the complete comparison, and return the exit code.

    - 0: success
    - 1: no solution exists
    - 2: bad usage or input
    - 130: interrupted
    """
    arguments = parser().parse_args(sys.argv[1:] or ["fly", "-o", "out/servo", "--resume"])
    try:
        aircraft = hfa.aircraft(arguments.dynamics)
        report: Report = arguments.run(arguments, aircraft)
    except (BadInputError, NoSolutionError, OSError) as error:
        print(f"studies.servo: {on_one_line(str(error))}", file=sys.stderr)
        return 1 if isinstance(error, NoSolutionError) else 2
    except KeyboardInterrupt:
        print("studies.servo: interrupted", file=sys.stderr)
        return 130
    print(report.json() if arguments.json else report.text())
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of all subcommands with their options."""
    whole = argparse.ArgumentParser("python -m studies.servo", description=__doc__)
    commands = whole.add_subparsers(required=True, metavar="COMMAND")

    fly = commands.add_parser(
        "fly", help="simulate SimVFA's commands with nominal and faulty actuators"
    )
    fly.add_argument("case", nargs="?", default="all", help="name of a case; default: all")
    fly.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="folder for a table and a figure of each case",
    )
    fly.add_argument("--resume", action="store_true", help="reuse finished cases")
    fly.add_argument(
        "--law",
        action="append",
        default=[],
        metavar="NAME",
        help="simulate only this law; repeatable",
    )
    about = "additional controller (.npz of hfa design); repeatable"
    fly.add_argument("--controller", action="append", default=[], metavar="FILE", help=about)
    fly.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="duration; default: 1051 s, the complete sequence",
    )
    fly.set_defaults(run=_fly)

    ask = commands.add_parser(
        "requirements", help="compare a servo with its requirements; takes minutes"
    )
    ask.add_argument(
        "controller",
        nargs="?",
        help="controller (.npz of hfa design); default: the designed servo",
    )
    ask.set_defaults(run=_requirements)

    trade = commands.add_parser(
        "front", help="compare gains of A_z by tracking with a fault, updrafts and margins"
    )
    trade.set_defaults(run=_front)

    for each in (fly, ask, trade):
        each.add_argument("--dynamics", choices=("published", "newton"), default="published")
        each.add_argument("--json", action="store_true", help="print JSON")
    return whole


def _fly(arguments: argparse.Namespace, aircraft: Model) -> Report:
    from studies.servo.comparison import CASES, DURATION, run_case, servo_report

    refuse_unknown("there is no case", arguments.case, (*CASES, "all"))
    names = CASES if arguments.case == "all" else (arguments.case,)
    settings = {
        "duration": arguments.duration or DURATION,
        "only": arguments.law,
        "resume": arguments.resume,
    }
    controllers = {path: load_controller(path, hfa.aircraft()) for path in arguments.controller}
    where = (controllers, arguments.output, _origin(aircraft))
    return servo_report([run_case(aircraft, name, *where, **settings) for name in names])


def _requirements(arguments: argparse.Namespace, aircraft: Model) -> Report:
    from studies.servo.comparison import designed_servo
    from studies.servo.flights import requirements

    name = arguments.controller
    return requirements(
        aircraft,
        designed_servo(aircraft) if name is None else load_controller(name, hfa.aircraft()),
    )


def _front(_: argparse.Namespace, aircraft: Model) -> Report:
    from studies.servo.front import front

    return front(aircraft)


def _origin(aircraft: Model) -> Provenance:
    command = f"python -m studies.servo {shlex.join(sys.argv[1:])}"
    parameters = default_parameters()
    return Provenance(
        command,
        hfa_model.variant_of(aircraft).name,
        parameters.name,
        parameter_hash(parameters.values),
    )


if __name__ == "__main__":
    sys.exit(main())
