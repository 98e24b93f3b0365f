"""Options that name a family of flights over an interval of dihedral."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from hfa_cli import options
from hfa_cli.values import number, quantity
from hfa_model.aircraft import Aircraft
from hfa_model.support.errors import BadInputError

if TYPE_CHECKING:
    from verification.proof.trim_branch import Family


def family_of(arguments: argparse.Namespace, errors: float = 0.0) -> Family:
    """The aircraft and the flights that the options name; the dihedral is left.

    errors: every identified parameter may be off by this many of its standard errors.
    """
    from verification.proof.trim_branch import Family

    if arguments.limit is not None:
        raise BadInputError("--limit does not go with a proof, which is about the limits of the aircraft")
    names = ("speed", "altitude", "alpha", "gamma")
    words = {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}
    settings = {name: quantity(name, text) for name, text in words.items()}
    if not errors:
        return Family(options.aircraft_of(arguments), settings)
    parameters = options.parameters_of(arguments)
    known = parameters.standard_errors
    if not known:
        raise BadInputError("the parameters have no standard errors; leave --errors out")
    spread = tuple(errors * known.get(name, 0.0) for name in parameters.values._fields)
    return Family(Aircraft(parameters.values, arguments.dynamics), settings, spread)


def interval_of(arguments: argparse.Namespace, family: Family) -> tuple[float, float]:
    """LOW:HIGH in degrees as they were written, because the statement is about them; refused when no trim can be."""
    text = arguments.dihedral or ""
    low, colon, high = text.partition(":")
    if not colon or ":" in high:
        raise BadInputError("give the interval of dihedrals as --dihedral LOW:HIGH, degrees")
    ends = number(low, "dihedral"), number(high, "dihedral")
    if not ends[0] < ends[1]:
        raise BadInputError(f"dihedral is {text!r}; the first end must be the lower one")
    for end in ends:
        family.condition(end).check_pitch()
    return ends
