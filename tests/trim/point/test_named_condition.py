"""Named conditions: those of the package trim, and faults of a file are named."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from cli import refusal

from hfa_model import Aircraft
from hfa_support import BadInputError
from trim import find_operating_point, level_flight, load_condition
from verification import released_trims


def test_the_paper_s_condition_is_the_default() -> None:
    named, default = load_condition("paper").at(0.2), level_flight(0.2)
    assert named.imposed == pytest.approx(default.imposed)
    assert set(named.free) == set(default.free)


@pytest.mark.parametrize(("name", "speed"), [("simvfa-64", 64.0), ("simvfa-30", 30.0)])
def test_the_peer_s_conditions_fly_at_its_angles_of_attack(
    published_aircraft: Aircraft, name: str, speed: float
) -> None:
    condition = load_condition(name)
    found = [each for each in released_trims() if each.speed == speed]
    assert len(found) >= 5
    for released in found:
        point = find_operating_point(published_aircraft, condition.at(released.dihedral))
        assert point.states.speed == speed
        assert point.states.alpha == pytest.approx(released.alpha, abs=1e-7)


def test_beyond_the_angles_of_a_table_there_is_no_condition() -> None:
    with pytest.raises(
        BadInputError, match="simvfa-64: alpha is given from 0 deg to 20 deg of dihedral; 30 deg lies out"
    ):
        load_condition("simvfa-64").at(math.radians(30.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[impose]\nspeeed = 60", "unknown trim variable 'speeed'; choose from speed"),
        ("[impose]\nspeed_deg = 60", "speed_deg is no angle; write speed, in ft/s"),
        ("[impose]\nalpha_deg = 'two'", "alpha_deg is 'two'; give a finite number"),
        ("[impose]\nalpha_deg = inf", "alpha_deg is inf; give a finite number"),
        ("[impose]\nalpha_deg = true", "alpha_deg is True; give a finite number"),
        ("[impose]\nalpha_deg = [[0, 1, 2]]", "value] rows"),
        ("[impose]\nalpha_deg = [[5, 1], [5, 2]]", "must increase"),
        ("[limits]\nalpha_deg = 3", "limits.alpha_deg is 3; give a list of numbers"),
        ("free = 'alpha'", "free is 'alpha'; give a list of names in quotes"),
        ("free = ['flaps']", "unknown trim variable 'flaps'"),
        ("impose = 3", "impose is 3; make it the table"),
        ("inpose = 3", "unknown entry inpose; did you mean impose?"),
        ("free = [", "is not a TOML file"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    assert message in refusal(load_condition, path)
