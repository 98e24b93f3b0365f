"""Trim the aircraft and report state, inputs, the residual of each equation, loads and margins to limits."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from hfa_cli import options
from hfa_cli.argument_types import parsed, quantity
from hfa_cli.output import show
from hfa_cli.parser import add_named, add_value
from hfa_model.support.errors import BadInputError
from trim.point.condition import release
from trim.point.operating_point import load_operating_point
from trim.point.solve import find_operating_point
from trim.point.trim_report import trim_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa trim`."""
    options.add_condition(parser)
    parser.add_argument("--free", action="append", metavar="NAME", help="leave a variable free; repeatable")
    add_named(parser, "--hold", quantity, "NAME=VALUE", "hold a variable, degrees for angles; repeatable")
    saved = parsed(lambda text: load_operating_point(Path(text)))
    add_value(parser, "--start", saved, "FILE", "begin from a saved operating point (.json)")
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report."""
    free, hold = tuple(arguments.free or ()), arguments.hold or {}
    _refuse_two_values(arguments, free, hold)
    aircraft = options.aircraft_of(arguments)
    condition = release(options.condition_of(arguments), free=free, hold=hold)
    point = find_operating_point(aircraft, condition, arguments.start)
    show(trim_report(aircraft, condition, point), as_json=arguments.json, target=arguments.output)
    return 0


def _refuse_two_values(arguments: argparse.Namespace, free: tuple[str, ...], hold: Mapping[str, float]) -> None:
    """A variable has one value, or none: --dihedral, which is always given, may be set free, the others not."""
    for name in ("dihedral", *options.OF_THE_CONDITION):
        if options.given(arguments, name) and name in hold:
            raise BadInputError(f"{name} is given twice, by --{name} and by --hold; give it once")
        if options.given(arguments, name) and name in free and name != "dihedral":
            raise BadInputError(f"{name} is given by --{name} and set free by --free; leave one of them out")
