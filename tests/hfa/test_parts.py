"""A request is made from parts: groups of options with one place for each value."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import pytest

from hfa.entry_points import own_commands
from hfa.options.aircraft import Aircraft
from hfa.options.part import Part, option, part
from hfa.options.request import Request
from hfa.options.trim import Trim


@dataclass(frozen=True, kw_only=True, eq=False)
class Wing(Part):
    """A group of options."""

    span: float = option("span, m", "M", float, default=10.0)
    chord: float = option("chord, m", "M", float, default=1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Glider(Part):
    """A group that contains another group."""

    wing: Wing = part(Wing, without=("chord",), span=option("span", "M", float, default=15.0))
    mass: float = option("mass, kg", "KG", float, default=300.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class GliderRequest(Request):
    """A request with a nested group."""

    glider: Glider = part(Glider)
    flights: int = option("number of flights", "N", int, default=1)


MODEL = Aircraft.loaded({})


def test_values_reach_their_parts() -> None:
    """A value goes to the field of its path. All other fields have the declared defaults."""
    made = GliderRequest.parsed(MODEL, {"glider.wing.span": 18.0})
    assert (made.glider.wing.span, made.glider.wing.chord, made.glider.mass) == (18.0, 1.0, 300.0)
    assert GliderRequest.parsed(MODEL, {}).glider.wing.span == 15.0
    assert made.glider.wing.model is made.model is MODEL


def test_a_trim_and_an_aircraft_know_their_provenance() -> None:
    """The provenance of a request has the entries of its aircraft and of its trim."""

    @dataclass(frozen=True, kw_only=True, eq=False)
    class Trimmed(Request):
        aircraft: Aircraft = part(Aircraft)
        trim: Trim = part(Trim)

    at = Trimmed.parsed(MODEL, {"trim.at": 0.1, "trim.hold": {"panel_mass": 9.0}})
    origin = at.provenance.to_dict()
    assert origin["condition"]["imposed"]["dihedral"] == 0.1
    assert origin["changed"]["panel_mass"]["value"] == 9.0
    assert at.trim.point().model.parameters["panel_mass"].start == 9.0


@pytest.mark.parametrize("name", own_commands())
def test_every_option_of_a_command_has_one_name_and_one_place(name: str) -> None:
    """No option of a command is declared twice, and each sets a field of the request."""
    pytest.importorskip("hfa_flight")
    request = own_commands()[name].load().request
    options = request.options(MODEL)
    flags = Counter(flag for each in options.values() for flag in each.flags)
    assert [flag for flag, count in flags.items() if count > 1] == []
    made = request.parsed(MODEL, {})
    for path in options:
        value = made
        for field in path.split("."):
            value = getattr(value, field)
