"""Scheduled controllers without dynamics are gain schedules."""

from __future__ import annotations

import numpy as np
from known_models import exact_gain

import hfa
from controller.schedule.scheduled_controller import ScheduledController, identity


def test_a_controller_without_states_is_the_schedule_of_its_gains() -> None:
    """u = D (x - X0) of a controller without states is u = -K (x - X0) of a gain schedule."""
    model = hfa.aircraft()
    K = exact_gain(15.0)
    m, n = K.shape
    empty = np.zeros((1, 0, 0))
    controller = ScheduledController(
        "gains",
        "state",
        np.array([0.26]),
        empty,
        np.zeros((1, 0, n)),
        np.zeros((1, m, 0)),
        -K[None, ::-1],
        np.zeros((1, 0, m)),
        (),
        model.linear,
        (),
        tuple(model.inputs)[::-1],
        np.zeros((1, len(model.states))),
        np.zeros((1, m)),
        model.name,
        identity(model),
        model=model,
    )
    schedule = controller.gain_schedule()
    assert schedule is not None
    np.testing.assert_array_equal(schedule.gains[0], K)
