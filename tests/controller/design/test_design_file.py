"""Designs in files: those of the package load, and faults of a file are named."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import refusal
from servo_cases import SIMVFA, simvfa_design

from controller import load_design
from controller.design.design import NAMED, Actuator, signal_unit
from hfa_model.aircraft import HFA
from hfa_support import BadInputError

DESIGNS = Path(__file__).parents[3] / "controller" / "design"


def test_every_design_of_the_package_has_a_name_and_a_source() -> None:
    assert {path.name for path in DESIGNS.glob("*.toml")} == set(NAMED.values())
    assert all("source = " in path.read_text(encoding="utf-8") for path in DESIGNS.glob("*.toml"))


def test_disturbances_are_a_table_and_actuators_are_read(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    more = "[sensors]\npitch_rate = 1e-4\n[disturbance]\nupdraft = 2.0\ncommands = 3.0\n"
    own.write_text(Path(SIMVFA["simvfa-2"]).read_text(encoding="utf-8") + more, encoding="utf-8")
    design = load_design(str(own))
    assert design.disturbances == {"updraft": 2.0, "commands": 3.0}
    assert design.actuators == dict.fromkeys(design.inputs, Actuator(2, 2.0, 0.7, 1.0))
    assert simvfa_design("simvfa-1").disturbances == {"states": 1.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("inputs = 'throttle'", "inputs is 'throttle'; give a list"),
        ("weight = 3", "unknown entry weight; did you mean weights?"),
        ("[weights.inputs]\nthrottle = -1", "weights.inputs.throttle is -1; give a finite number from 0 on"),
        ("[actuators]\nthrottle = 3", "actuators.throttle is 3; make it the table [actuators.throttle]"),
        ("[actuators.throttle]\neffectiveness = 0.0", "actuators.throttle: the effectiveness of an actuator is 0.0"),
        ("[actuators.throttle]\norder = 3", "actuators.throttle: the order of an actuator is 3"),
        ("[disturbance]\nupdraft = 'x'", "disturbance.updraft is 'x'; give a finite number"),
        ("delta = -1", "delta is -1; give a number above 0"),
        ("delta = [", "is not a TOML file"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    assert message in refusal(load_design, path)


def test_a_name_that_is_neither_is_said() -> None:
    with pytest.raises(BadInputError, match="no design of that name and no readable file; the names are paper, servo"):
        load_design("nobody")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("speed_estimate", "ft/s"),
        ("throttle_rate", "1/s"),
        ("aileron_outer_position_estimate", "rad"),
        ("vertical_acceleration_short_period_command_end_lag_12", "ft/s^2"),
        ("vertical_acceleration_short_period_integral_estimate", "ft/s^2 s"),
        ("vertical_acceleration_short_period_command_rate", "(ft/s^2)/s"),
        ("x1_integral", ""),
    ],
)
def test_a_name_says_its_unit(name: str, unit: str) -> None:
    assert signal_unit(HFA, name) == unit
