"""What is flown in the cases of `hfa servo`."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
import pytest

from verification.servo.cases import ANGLES, CASES, DURATION, OWN_ANGLES, REGULATED, TRIM_DEG, simvfa_commands


def test_the_commands_are_sixteen_steps_of_seventy_seconds() -> None:
    commands = simvfa_commands()
    assert commands.names == REGULATED
    assert (len(commands.times), DURATION) == (16, 1051.0)
    np.testing.assert_allclose(np.diff(commands.times), 70.0)
    assert np.degrees(commands.values[:, 0]).tolist() == pytest.approx(
        [1, 2, 1, 2, 1, 2, -1, 1, 2, 1, 2, 1, 2, -1, 0, 0]
    )


def test_faults_act_from_the_start() -> None:
    parts = attrgetter("begin", "effectiveness", "bandwidth", "damping")
    weak = {name: [parts(fault) for fault in case.faults] for name, case in CASES.items()}
    assert weak == {
        "order-1": [],
        "order-1-fault": [(0.0, 0.2, 0.5, None)],
        "order-2": [],
        "order-2-fault": [(0.0, 0.2, 0.5, 0.8)],
    }


def test_tables_hold_every_angle_that_is_commanded() -> None:
    """SimVFA has one of 0 to 20 deg, by the degree; ours has a degree of room and more beyond the commands."""
    assert np.degrees(ANGLES).tolist() == pytest.approx(range(21))
    commanded = TRIM_DEG + np.degrees(simvfa_commands().values[:, 0])
    assert np.degrees(OWN_ANGLES[0]) <= commanded.min() - 1.0
    assert np.degrees(OWN_ANGLES[-1]) >= commanded.max() + 1.0
