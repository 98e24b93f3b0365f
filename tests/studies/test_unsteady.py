"""The servo of SimVFA on three dynamics, as docs/validity.md has it."""

from __future__ import annotations

import numpy as np
import pytest

from controller import design_controller
from hfa_model import Aircraft
from studies.servo.simvfa import simvfa_design
from studies.unsteady.__main__ import margins


def test_the_lags_of_the_air_reach_the_servo_and_make_its_loop_unstable() -> None:
    servo = design_controller(Aircraft(), simvfa_design("simvfa-1"), np.radians([5.0, 15.0]))
    assert margins("published", 5.0, servo, 1) == pytest.approx((-0.133, 1.63), abs=6e-3)
    assert margins("newton", 15.0, servo, 1) == pytest.approx((-0.101, 1.07), abs=6e-3)
    assert margins("unsteady", 15.0, servo, 1)[0] == pytest.approx(0.048, abs=6e-4)
