"""Options that several commands share, and the objects that they make."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfa_cli.argument_types import PICTURES, angle, number, output_file, parsed, span, whole
from hfa_cli.output import SUFFIXES
from hfa_cli.parser import add_named, add_value
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import ParameterSet, default_parameters, load_parameters
from hfa_model.support.errors import BadInputError
from trim.point.condition import TrimCondition, level_flight

DEFAULT_DYNAMICS = "published"
#: What --speed and its like impose, by name; --dihedral apart.
OF_THE_CONDITION = ("speed", "altitude", "alpha", "gamma")
_MOST_WORKERS = 1000


def add_aircraft(parser: argparse.ArgumentParser) -> None:
    """--dynamics, --parameters."""
    equations = "published (regenerates the print; default) or newton (first principles)"
    add_value(parser, "--dynamics", str, "VARIANT", equations, default=DEFAULT_DYNAMICS)
    add_value(parser, "--parameters", parsed(_parameters), "FILE", "parameters file (default: the identified aircraft)")


def add_condition(parser: argparse.ArgumentParser, *, dihedral_required: bool = True) -> None:
    """--dihedral, --speed, --altitude, --alpha, --gamma, --limit."""
    add_value(parser, "--dihedral", angle, "DEG", "dihedral angle, degrees", required=dihedral_required)
    add_value(parser, "--speed", number, "FT/S", "default: the paper's 68")
    add_value(parser, "--altitude", number, "FT", "default: the paper's 40000")
    add_value(parser, "--alpha", angle, "DEG", "angle of attack, degrees; default: the paper's 2.8")
    add_value(parser, "--gamma", angle, "DEG", "flight-path angle, degrees; default 0")
    add_named(parser, "--limit", span, "NAME=LOW:HIGH", "limits of an unknown, degrees for angles; repeatable")


def add_output(parser: argparse.ArgumentParser, *also: str, what: str = "") -> None:
    """--json, --output; `also` are suffixes beside the usual ones, `what` says what they are for."""
    parser.add_argument("--json", action="store_true", help="print JSON (radians, feet, pounds) instead of text")
    about = f"also write {', '.join(SUFFIXES)}" + (f" or {', '.join(also)}{what}" if also else "")
    parser.add_argument("-o", "--output", type=output_file(*SUFFIXES, *also), metavar="FILE", help=about)


def add_picture(parser: argparse.ArgumentParser, what: str) -> None:
    """--picture, which draws what is named."""
    add_value(parser, "--picture", output_file(*PICTURES), "FILE", f"draw {what} ({' or '.join(PICTURES)})")


def add_workers(parser: argparse._ActionsContainer, what: str) -> None:
    """--workers, --scheduler, --resume."""
    add_value(parser, "--workers", whole(1, _MOST_WORKERS), "N", "processes; default 1")
    add_value(parser, "--scheduler", str, "URL", "Dask scheduler, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help=f"continue an interrupted {what}")


def given(arguments: argparse.Namespace, name: str) -> bool:
    """Whether an option was given; an empty word counts, so that it is refused and not passed over."""
    value = getattr(arguments, name)
    return value is not None and value is not False


def refuse(arguments: argparse.Namespace, names: tuple[str, ...], reason: str) -> None:
    """BadInputError for the first option of these that was given: it would change nothing."""
    for name in names:
        if given(arguments, name):
            raise BadInputError(f"--{name} {reason}")


def parameters_of(arguments: argparse.Namespace) -> ParameterSet:
    """The parameters that the options name."""
    chosen: ParameterSet | None = arguments.parameters
    return default_parameters() if chosen is None else chosen


def aircraft_of(arguments: argparse.Namespace) -> Aircraft:
    """The aircraft that the options name."""
    return Aircraft(parameters_of(arguments).values, arguments.dynamics)


def one_place(arguments: argparse.Namespace) -> None:
    """BadInputError when both --workers and --scheduler say where the work is done."""
    if arguments.workers is not None and arguments.scheduler is not None:
        raise BadInputError("--workers are processes here, --scheduler has its own; give one of them")


def condition_of(arguments: argparse.Namespace) -> TrimCondition:
    """The level, climbing or gliding flight that the options name."""
    return level_flight(
        arguments.dihedral,
        speed=arguments.speed,
        altitude=arguments.altitude,
        alpha=arguments.alpha,
        gamma=0.0 if arguments.gamma is None else arguments.gamma,
        limits=arguments.limit,
    )


def _parameters(text: str) -> ParameterSet:
    """Parameters of a file; BadInputError when they belong to equations that no option names."""
    parameters = load_parameters(Path(text))
    if parameters.structure:
        raise BadInputError(
            f"{text}: its [structure] {', '.join(parameters.structure)} belongs to equations that no "
            "command flies; give the parameters.toml that `hfa identify --write` puts beside it"
        )
    return parameters
