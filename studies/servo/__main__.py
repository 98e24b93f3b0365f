"""Servos of the aircraft: SimVFA's, adaptive laws and ours through commands, actuator faults and gusts.

See studies/servo/README.md, and findings.md for the results.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from controller import design_model, load_controller, save_controller
from hfa_model import Aircraft, default_parameters
from hfa_model.provenance import Provenance, parameter_hash
from hfa_support import BadInputError, NoSolutionError, Report
from hfa_support.errors import on_one_line, refuse_unknown
from trim import level_model
from verification import solve_game


def main() -> int:
    """Run one command, without words the whole comparison.

    Exit code: 0 done, 1 a constraint is missed or no solution exists, 2 bad usage or input.
    """
    arguments = parser().parse_args(sys.argv[1:] or ["fly", "-o", "out/servo", "--resume"])
    try:
        aircraft = Aircraft(dynamics=arguments.dynamics)
        report: Report = arguments.run(arguments, aircraft)
    except (BadInputError, NoSolutionError, OSError) as error:
        print(f"studies.servo: {on_one_line(str(error))}", file=sys.stderr)
        return 1 if isinstance(error, NoSolutionError) else 2
    except KeyboardInterrupt:
        print("studies.servo: interrupted", file=sys.stderr)
        return 130
    print(report.json() if arguments.json else report.text())
    return 0 if report.data.get("ok", True) else 1


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    whole = argparse.ArgumentParser("python -m studies.servo", description=__doc__)
    commands = whole.add_subparsers(required=True, metavar="COMMAND")

    fly = commands.add_parser("fly", help="SimVFA's commands, with the actuators as designed and with its faults")
    fly.add_argument("case", nargs="?", default="all", help="order-1, order-1-fault, order-2, order-2-fault or all")
    fly.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="a table and a figure a case")
    fly.add_argument("--resume", action="store_true", help="keep the cases that are finished")
    fly.add_argument("--law", action="append", default=[], metavar="NAME", help="this law only; repeatable")
    about = "fly this controller too (.npz of hfa design); repeatable"
    fly.add_argument("--controller", action="append", default=[], metavar="FILE", help=about)
    fly.add_argument("--duration", type=float, metavar="S", help="default: the whole sequence, 1051 s")
    fly.set_defaults(run=_fly)

    design = commands.add_parser("design", help="the controller of a design and its [feedforward], at 0, 1, ... 20 deg")
    design.add_argument("design", help="name or file of the design")
    about = "the controller, for hfa fly --controller and monte-carlo"
    design.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.npz", help=about)
    design.set_defaults(run=_design)

    search = commands.add_parser("search", help="search better weights of a design; goes on where it was interrupted")
    search.add_argument("tuning", help="the tuning file (.toml)")
    about = "the design found; evaluations are kept in the folder FILE.evaluations"
    search.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.toml", help=about)
    search.set_defaults(run=_search)

    line = commands.add_parser("line", help="fly the designs between that of a tuning file and another")
    line.add_argument("tuning", help="the tuning file (.toml)")
    line.add_argument("toward", help="name or file of the other design")
    line.set_defaults(run=_line)

    gusts = commands.add_parser("gusts", help="the largest gusts of 400 ft that a controller stands")
    gusts.add_argument("controller", help="a controller (.npz of hfa design)")
    gusts.set_defaults(run=_gusts)

    updraft = commands.add_parser("updraft", help="what the worst updraft costs a design that measures all states")
    updraft.add_argument("design", help="name or file of the design")
    updraft.add_argument("--dihedral", type=float, default=11.0, metavar="DEG")
    updraft.set_defaults(run=_updraft)

    for each in (fly, design, search, line, gusts, updraft):
        each.add_argument("--dynamics", choices=("published", "newton"), default="published")
        each.add_argument("--json", action="store_true", help="print JSON")
    return whole


def _fly(arguments: argparse.Namespace, aircraft: Aircraft) -> Report:
    from studies.servo.comparison import CASES, DURATION, run_case, servo_report

    refuse_unknown("there is no case", arguments.case, (*CASES, "all"))
    names = CASES if arguments.case == "all" else (arguments.case,)
    settings = {"duration": arguments.duration or DURATION, "only": arguments.law, "resume": arguments.resume}
    controllers = {path: load_controller(path) for path in arguments.controller}
    where = (controllers, arguments.output, _origin(aircraft))
    return servo_report([run_case(aircraft, name, *where, **settings) for name in names])


def _design(arguments: argparse.Namespace, aircraft: Aircraft) -> Report:
    from studies.servo.feedforward import shaped_controller, shaped_design
    from studies.servo.tuning import design_entries

    chosen = shaped_design(arguments.design, design_entries(arguments.design))
    made = shaped_controller(aircraft, *chosen, np.radians(np.arange(21.0)))
    made = replace(made, about={**made.about, "provenance": _origin(aircraft).to_dict()})
    save_controller(arguments.output, made)
    return made.report()


def _search(arguments: argparse.Namespace, aircraft: Aircraft) -> Report:
    from studies.servo.search import search_report, tune
    from studies.servo.tuning import load_tuning, save_design

    tuning = load_tuning(arguments.tuning)
    found = tune(aircraft, tuning, arguments.output.with_name(f"{arguments.output.name}.evaluations"), _count)
    description = {"description": f"found by a search from {tuning.name}"}
    save_design(arguments.output, tuning.entries_at(found.best) | description)
    return search_report(tuning, found)


def _line(arguments: argparse.Namespace, aircraft: Aircraft) -> Report:
    from studies.servo.feedforward import shaped_design
    from studies.servo.search import design_line
    from studies.servo.tuning import design_entries, load_tuning

    tuning, entries = load_tuning(arguments.tuning), design_entries(arguments.toward)
    shaped_design(arguments.toward, entries)
    return design_line(aircraft, tuning, arguments.toward, entries)


def _gusts(arguments: argparse.Namespace, aircraft: Aircraft) -> Report:
    from studies.servo.flights import gust_limits

    return gust_limits(aircraft, load_controller(arguments.controller))


def _updraft(arguments: argparse.Namespace, aircraft: Aircraft) -> Report:
    from studies.servo.feedforward import shaped_design
    from studies.servo.flights import updraft_cost
    from studies.servo.tuning import design_entries

    design, _ = shaped_design(arguments.design, design_entries(arguments.design))
    built = design_model(aircraft, level_model(aircraft, float(np.radians(arguments.dihedral))), design)
    return updraft_cost(built, built.game(), solve_game(built.game()).K)


def _origin(aircraft: Aircraft) -> Provenance:
    command, parameters = f"python -m studies.servo {shlex.join(sys.argv[1:])}", default_parameters()
    return Provenance(command, aircraft.variant.name, parameters.name, parameter_hash(parameters.values))


def _count(done: int, total: int) -> None:
    if sys.stderr.isatty():
        print(f"\revaluation {done} of {total}", end="\n" if done == total else "", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
