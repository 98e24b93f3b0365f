"""Options that several commands share, and the objects that they make."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfa_cli.values import limits, quantity
from hfa_model.compiled import Aircraft
from hfa_model.parameters import ParameterSet, default_parameters, load_parameters
from trim.condition import TrimCondition, level_flight

DEFAULT_DYNAMICS = "published"


def add_aircraft(parser: argparse.ArgumentParser) -> None:
    """--dynamics, --parameters."""
    parser.add_argument(
        "--dynamics",
        default=DEFAULT_DYNAMICS,
        metavar="VARIANT",
        help="published (regenerates the print; default) or newton (first principles)",
    )
    parser.add_argument("--parameters", metavar="FILE", help="parameters file (default: the identified aircraft)")


def add_condition(parser: argparse.ArgumentParser, *, dihedral_required: bool = True) -> None:
    """--dihedral, --speed, --altitude, --alpha, --gamma, --limit."""
    parser.add_argument("--dihedral", required=dihedral_required, metavar="DEG", help="dihedral angle, degrees")
    parser.add_argument("--speed", metavar="FT/S", help="default: the paper's 68")
    parser.add_argument("--altitude", metavar="FT", help="default: the paper's 40000")
    parser.add_argument("--alpha", metavar="DEG", help="angle of attack, degrees; default: the paper's 2.8")
    parser.add_argument("--gamma", metavar="DEG", help="flight-path angle, degrees; default 0")
    parser.add_argument(
        "--limit", action="append", metavar="NAME=LOW:HIGH", help="limits of an unknown, degrees for angles; repeatable"
    )


def add_output(parser: argparse.ArgumentParser, also: str = "") -> None:
    """--json, --output."""
    parser.add_argument("--json", action="store_true", help="print JSON (radians, feet, pounds) instead of text")
    parser.add_argument("-o", "--output", metavar="FILE", help=f"also write .json, .npz, .mat, .csv{also}")


def parameters_of(arguments: argparse.Namespace) -> ParameterSet:
    """The parameters that the options name."""
    return default_parameters() if arguments.parameters is None else load_parameters(Path(arguments.parameters))


def aircraft_of(arguments: argparse.Namespace) -> Aircraft:
    """The aircraft that the options name."""
    return Aircraft(parameters_of(arguments).values, arguments.dynamics)


def condition_of(arguments: argparse.Namespace) -> TrimCondition:
    """The level, climbing or gliding flight that the options name."""
    given = {name: getattr(arguments, name) for name in ("dihedral", "speed", "altitude", "alpha", "gamma")}
    values = {name: quantity(name, text) for name, text in given.items() if text is not None}
    return level_flight(
        values["dihedral"],
        speed=values.get("speed"),
        altitude=values.get("altitude"),
        alpha=values.get("alpha"),
        gamma=values.get("gamma", 0.0),
        limits=limits(arguments.limit),
    )
