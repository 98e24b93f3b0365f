"""The flexible aircraft of the paper, whose statements need no aircraft file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from hfa_aircraft.model import Model
from hfa_model.choice import aircraft
from hfa_model.parameters import NAMED, Parameters, load_parameters
from hfa_model.variants import DYNAMICS
from hfa_support.provenance import parameter_hash


@cache
def aircraft_of(dynamics: str) -> Model | None:
    """Return the flexible aircraft with the given dynamics, or None if their name is unknown."""
    return aircraft(dynamics) if dynamics in DYNAMICS else None


def identity_of(parameters: Mapping[str, float]) -> tuple[str, str] | None:
    """Return the name of a parameter set of the flexible aircraft, and its hash.

    The name is "of the certificate" if the values belong to no named set. Return None if the
    parameters are those of another aircraft.
    """
    if set(parameters) != set(Parameters._fields):
        return None
    values = Parameters(**parameters)
    names = [name for name in NAMED if load_parameters(name).values == values]
    return (names[0] if names else "of the certificate"), parameter_hash(values)
