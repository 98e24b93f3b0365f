"""Flights without a history: what leaves the envelope, when, and what goes on."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from controller import Envelope
from controller.flight.closed_loop import ClosedLoop
from controller.flight.plants import ModelPlant
from controller.flight.simulation import Summary, SummedLoop
from controller.policy.policies import GainPolicy
from hfa_model import STATES, State
from hfa_model.aircraft import HFA
from trim import OperatingPoint

SPEED, ALPHA = STATES.index("speed"), STATES.index("alpha")


class Falling(ModelPlant):
    """speed' = -1, alpha' = sqrt(0.0105 + speed): not a number from the step on that passes 0.0105 s."""

    constants_size, model = 0, HFA

    def rate(self, x: Any, u: Any, d: Any, winds: Any = None, p: Any = None) -> Any:
        return ca.vertcat(-1.0, ca.sqrt(0.0105 + x[SPEED]), ca.SX.zeros(5))


def flown(point: OperatingPoint, *, stops: bool, slowest: float = -1e9) -> Summary:
    """0.05 s in steps of 1 ms and ticks of 10."""
    lowest = State(*[-1e9] * 7)._replace(speed=point.states.speed + slowest)
    loop = ClosedLoop(Falling(), GainPolicy(5, 6))
    summed = SummedLoop(
        loop,
        point,
        Envelope(lowest, State(*[1e9] * 7), HFA),
        step=0.001,
        steps_per_tick=10,
        stops=stops,
        compile_code=False,
    )
    return summed.fly(loop.start(np.zeros(7)), lambda tick: np.zeros(30), 0.05)


@pytest.mark.parametrize("stops", [True, False])
def test_what_is_not_a_number_has_left(point: OperatingPoint, stops: bool) -> None:
    summary = flown(point, stops=stops)
    assert (summary.left, summary.flown) == (ALPHA, pytest.approx(0.011))
    assert summary.final[SPEED] == pytest.approx(-0.011 if stops else -0.05)


def test_sums_end_where_the_envelope_is_left_whether_or_not_the_flight_goes_on(point: OperatingPoint) -> None:
    one, other = (flown(point, stops=stops, slowest=-0.0045) for stops in (True, False))
    for summary in (one, other):
        assert (summary.left, summary.flown) == (SPEED, pytest.approx(0.005))
        assert summary.peak_error[SPEED] == pytest.approx(0.004)
        assert summary.rms_error[SPEED] == pytest.approx(np.sqrt(np.mean((0.001 * np.arange(5)) ** 2)))
    assert (one.final[SPEED], other.final[SPEED]) == (pytest.approx(-0.005), pytest.approx(-0.05))
