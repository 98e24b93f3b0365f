"""The design `servo` of the package: certified, stable at all corners, better than the published servo, learnable."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from servo_cases import A_Z, model_at

from controller import ScheduledController, load_design
from controller.design.design import Actuator, Feedforward
from hfa_model import Aircraft
from verification.synthesis.command_flight import fly_commands
from verification.synthesis.controllers import design_controller
from verification.synthesis.corners import check_corners
from verification.synthesis.servo_loop import servo_plant

#: SimVFA's commands, deg and ft/s², 70 s each; its faults: effectiveness 0.2 and bandwidth 0.5 rad/s.
DIHEDRAL = [1, 2, 1, 2, 1, 2, -1, 1, 2, 1, 2, 1, 2, -1, 0]
ACCELERATION = [-1, -2, -1, -2, -1, -2, 1, -1, -2, -1, -2, -2, 1, 1, 0]
ENDS = np.column_stack([np.radians(DIHEDRAL), ACCELERATION])


@cache
def servo() -> ScheduledController:
    return design_controller(Aircraft(), load_design("servo"), np.radians([11.0]))


def test_it_measures_what_the_published_servo_measures() -> None:
    assert servo().measurements == ("pitch_rate", "dihedral", A_Z)
    assert servo().inputs == ("aileron_outer", "elevator_center")
    assert all(check["ok"] for row in servo().about["angles"] for check in row["checks"])


def test_every_corner_is_stable_at_eleven_degrees(published_aircraft: Aircraft) -> None:
    found = check_corners(published_aircraft, servo())
    assert (found.unstable, found.loops) == (0, 32)


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_every_corner_is_stable_at_every_angle(dynamics: str) -> None:
    aircraft, angles = Aircraft(dynamics=dynamics), np.radians(np.arange(21.0))
    found = check_corners(aircraft, design_controller(aircraft, load_design("servo"), angles))
    assert (found.unstable, found.loops) == (0, 672)


@pytest.mark.parametrize(
    ("order", "effectiveness", "bandwidth", "error"),
    [(1, 1.0, 2.0, 0.20), (1, 0.2, 0.5, 0.25), (2, 1.0, 2.0, 0.25), (2, 0.2, 0.5, 0.30)],
)
def test_in_linear_flight_it_follows_the_published_commands_within_the_rate(
    published_aircraft: Aircraft, order: int, effectiveness: float, bandwidth: float, error: float
) -> None:
    """The servo of SimVFA has 0.38 and 0.69 deg with order 1, 0.45 deg and a lost flight with order 2."""
    actuators = dict.fromkeys(servo().inputs, Actuator(order, bandwidth, 0.7, effectiveness))
    plant = servo_plant(published_aircraft, model_at(11.0), servo(), actuators)
    found = fly_commands(plant, servo(), ENDS, 70.0, Feedforward())
    assert math.degrees(found.errors["dihedral"]) <= error
    assert math.degrees(found.rate) <= 1.0
