"""Compiled trials."""

from __future__ import annotations

import numpy as np
import pytest
from flight_cases import FlownCase

from controller.flight.plants import NonlinearPlant
from controller.flight.trials import TrialLoop
from hfa_model import LINEAR_STATES, STATES

N = len(LINEAR_STATES)


def test_machine_code_says_what_the_virtual_machine_says(newton: FlownCase, monkeypatch: pytest.MonkeyPatch) -> None:
    plant = NonlinearPlant(newton.aircraft, newton.point)
    starts = np.zeros((3, len(STATES)))
    starts[:, 0] = (0.3, 1.0, -3.0)
    found = []
    for _ in range(2):
        loop = TrialLoop(plant, newton.point, newton.envelope)
        found.append(loop.fly(newton.law.gains[0], starts, np.zeros((3, N)), 2.0))
        monkeypatch.setattr("controller.flight.watched_loop.machine_code", lambda function: function)
    assert (
        found[0].left.tolist() == found[1].left.tolist() == [-1, STATES.index("pitch_rate"), STATES.index("pitch_rate")]
    )
    np.testing.assert_allclose(found[0].when, found[1].when)
    np.testing.assert_allclose(found[0].final[:2], found[1].final[:2], rtol=1e-6, atol=1e-9)
