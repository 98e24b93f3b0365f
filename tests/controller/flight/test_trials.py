"""Compiled trials."""

from __future__ import annotations

import numpy as np
from flight_cases import FlownCase

from controller.flight.plants import NonlinearPlant
from controller.flight.trials import TrialLoop
from hfa_model import LINEAR_STATES, STATES

N = len(LINEAR_STATES)


def test_machine_code_says_what_the_virtual_machine_says(newton: FlownCase) -> None:
    plant = NonlinearPlant(newton.aircraft, newton.point)
    starts = np.zeros((3, len(STATES)))
    starts[:, 0] = (0.3, 1.0, -3.0)
    found = [
        TrialLoop(plant, newton.point, newton.envelope, compile_code=compile_code).fly(
            newton.law.gains[0], starts, np.zeros((3, N)), 2.0
        )
        for compile_code in (True, False)
    ]
    assert (
        found[0].left.tolist() == found[1].left.tolist() == [-1, STATES.index("pitch_rate"), STATES.index("pitch_rate")]
    )
    np.testing.assert_allclose(found[0].when, found[1].when)
    np.testing.assert_allclose(found[0].final[:2], found[1].final[:2], rtol=1e-6, atol=1e-9)
