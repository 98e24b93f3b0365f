"""Units of a controller's states and signals by their names."""

from __future__ import annotations

import pytest

from controller.design.design import signal_unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("speed_estimate", "ft/s"),
        ("model_speed", "ft/s"),
        ("dihedral_rate", "rad/s"),
        ("pitch_rate", "rad/s"),
        ("throttle_rate", "1/s"),
        ("elevator_outer_position", "rad"),
        ("aileron_outer_position_estimate", "rad"),
        ("dihedral_command_end_lag_2", "rad"),
        ("vertical_acceleration_short_period_command_end_lag_12", "ft/s^2"),
        ("vertical_acceleration_short_period", "ft/s^2"),
        ("vertical_acceleration_short_period_integral_estimate", "ft/s^2 s"),
        ("vertical_acceleration_short_period_command_rate", "(ft/s^2)/s"),
        ("dihedral_command_end", "rad"),
        ("x1", ""),
        ("x1_integral", ""),
    ],
)
def test_a_name_says_its_unit(name: str, unit: str) -> None:
    assert signal_unit(name) == unit
