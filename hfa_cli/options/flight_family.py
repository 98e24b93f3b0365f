"""Options that name level flights over an interval of dihedral, or at one."""

from __future__ import annotations

import argparse
import math
from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import number
from hfa_cli.options.parser import add_value
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError, shortened

if TYPE_CHECKING:
    from verification.enclosures.trim_branch import Family


def add_flights(parser: argparse.ArgumentParser, form: str) -> None:
    """--dihedral in degrees, as it is written; what a trim imposes and leaves free; the aircraft."""
    about = "degrees; what is proved holds at every angle between"
    add_value(parser, "--dihedral", degrees, form, about)
    options.add_flight(parser)
    options.add_aircraft(parser)


def degrees(text: str) -> tuple[float, ...]:
    """`LOW:HIGH` or one angle, in degrees: the statement is about the numbers that were written."""
    parts = text.split(":")
    if len(parts) > 2:
        raise ArgumentTypeError(f"is {shortened(text)!r}; give LOW:HIGH")
    ends = tuple(number(part) for part in parts)
    if len(ends) == 2 and not ends[0] < ends[1]:
        raise ArgumentTypeError(f"is {shortened(text)!r}; the first end must be the lower one")
    return ends


def family_of(arguments: argparse.Namespace, errors: float = 0.0) -> Family:
    """The aircraft and the flights that the options name; the dihedral is left.

    errors: every identified parameter may be off by this many of its standard errors.
    """
    from verification.enclosures.trim_branch import Family

    flights = options.flight_of(arguments)
    parameters = options.parameters_of(arguments)
    aircraft = Aircraft(parameters.values, arguments.dynamics)
    if not errors:
        return Family(aircraft, flights)
    known = parameters.standard_errors
    if not known:
        raise BadInputError("the parameters have no standard errors; leave --error out")
    spread = tuple(errors * known.get(name, 0.0) for name in parameters.values._fields)
    return Family(aircraft, flights, spread)


def interval_of(arguments: argparse.Namespace, family: Family) -> tuple[float, float]:
    """LOW:HIGH, deg; refused where no trim can be."""
    ends: tuple[float, ...] = arguments.dihedral or ()
    if len(ends) != 2:
        raise BadInputError("give the interval of dihedrals as --dihedral LOW:HIGH, degrees")
    family.check(*ends)
    return ends[0], ends[1]


def at_one_angle(arguments: argparse.Namespace) -> float | None:
    """The dihedral, deg, when one is given; the options then name a trim like those of other commands."""
    if arguments.dihedral is None:
        return None
    if len(arguments.dihedral) != 1:
        raise BadInputError("a game is at one dihedral; give --dihedral DEG")
    angle_deg = float(arguments.dihedral[0])
    arguments.dihedral = math.radians(angle_deg)
    return angle_deg
