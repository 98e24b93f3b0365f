"""Options that several commands share, and the objects that they make."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfa_cli.values import limits, quantity
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import ParameterSet, default_parameters, load_parameters
from hfa_model.support.errors import BadInputError
from trim.point.condition import TrimCondition, level_flight

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


def given(arguments: argparse.Namespace, name: str) -> bool:
    """Whether an option was given; an empty word counts, so that it is refused and not passed over."""
    value = getattr(arguments, name)
    return value is not None and value is not False


def parameters_of(arguments: argparse.Namespace) -> ParameterSet:
    """The parameters that the options name; BadInputError when they belong to equations that no option names."""
    if arguments.parameters is None:
        return default_parameters()
    parameters = load_parameters(Path(arguments.parameters))
    if parameters.structure:
        raise BadInputError(
            f"{arguments.parameters}: its [structure] {', '.join(parameters.structure)} belongs to equations that no "
            "command flies; give the parameters.toml that `hfa identify --write` puts beside it"
        )
    return parameters


def aircraft_of(arguments: argparse.Namespace) -> Aircraft:
    """The aircraft that the options name."""
    return Aircraft(parameters_of(arguments).values, arguments.dynamics)


def one_place(arguments: argparse.Namespace) -> None:
    """BadInputError when both --workers and --scheduler say where the work is done."""
    if arguments.workers is not None and arguments.scheduler is not None:
        raise BadInputError("--workers are processes here, --scheduler has its own; give one of them")


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
