"""The loop: its order, fast modes, its ends; flights summed up: what leaves the envelope, when, and what goes on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest

from controller import Envelope, FlownLaw, Scenario, gain_law
from controller.flight.closed_loop import ClosedLoop, LinearPlant, Plant
from controller.flight.nonlinear_flight import NonlinearFlight, fly_within
from controller.flight.simulation import CompiledLoop
from controller.policy.policies import OpenLoop
from hfa_model import STATES, State
from hfa_model.aircraft import HFA
from hfa_support import BadInputError, NoSolutionError
from trim import OperatingPoint

SPEED = STATES.index("speed")


class Falling(Plant):
    """speed' = -1, alpha' = sqrt(0.0105 + speed): not a number from the step on that passes 0.0105 s."""

    def __init__(self, point: OperatingPoint) -> None:
        self.point = point

    def rate(self, x: Any, u: Any, d: Any, winds: Any, p: Any) -> Any:
        return ca.vertcat(-1.0, ca.sqrt(0.0105 + x[SPEED]), ca.SX.zeros(5))


def flown(point: OperatingPoint, *, stops: bool, slowest: float = -1e9) -> NonlinearFlight:
    """0.05 s in steps of 1 ms and ticks of 10."""
    lowest = State(*[-1e9] * 7)._replace(speed=point.states.speed + slowest)
    scenario, law = Scenario(0.05, initial=np.zeros(7)), gain_law("none", np.zeros((5, 6)))
    loop, envelope = ClosedLoop(Falling(point), law, scenario), Envelope(lowest, State(*[1e9] * 7), HFA)
    lost = None if stops else lambda rows: np.zeros(len(rows.times), dtype=bool)
    return fly_within(CompiledLoop(loop), envelope, lost=lost)


@pytest.mark.parametrize(
    ("slowest", "state", "time", "end"),
    [(-1e9, "alpha", 0.011, 0.02), (-0.0045, "speed", 0.005, 0.01)],
    ids=["not a number", "beyond a limit"],
)
def test_a_flight_ends_with_its_tick_or_goes_on(
    point: OperatingPoint, slowest: float, state: str, time: float, end: float
) -> None:
    for stops in (True, False):
        result = flown(point, stops=stops, slowest=slowest)
        assert result.departure is not None
        assert (result.departure.state, result.departure.time) == (state, pytest.approx(time))
        assert result.flight.states[-1, SPEED] == pytest.approx(-end if stops else -0.05)


# The loop of a pendulum whose observer has a fast mode.


@dataclass(frozen=True, eq=False)
class Pendulum(LinearPlant):
    """y1' = y2, y2' = -sin y1 - 0.3 y2 + u, and an observer y3 of y1 with a mode at -fast."""

    fast: float = 4.0

    def rate(self, x: Any, u: Any, d: Any, winds: Any, p: Any) -> Any:
        return ca.vertcat(x[1], -ca.sin(x[0]) - 0.3 * x[1] + u, self.fast * (x[0] - x[2]))


def pendulum(fast: float, step: float, *, duration: float = 6.0, observed: float = 0.0) -> CompiledLoop:
    """Pushed by p, which jumps at 3.7 s."""
    plant = Pendulum(np.zeros((3, 3)), np.zeros((3, 1)), fast=fast)
    law = FlownLaw("pushed", OpenLoop(1), np.repeat([[0.5], [-1.0]], [37, 1], axis=0), fastest=fast)
    return CompiledLoop(ClosedLoop(plant, law, Scenario(duration, step, 0.1, np.array([1.0, 0.0, observed]))))


def test_the_method_is_of_order_4_where_the_constants_jump_too() -> None:
    found = [pendulum(4.0, 0.05 / parts).fly().states[::parts] for parts in (1, 2, 4)]
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(found))
    assert 12.0 < coarse / fine < 20.0


@pytest.mark.parametrize("fast", [1e3, 1e5])
def test_a_fast_mode_of_the_law_divides_the_steps(fast: float) -> None:
    """The observer follows, and the pendulum is the one without it: 1e5 1/s at a step of 0.02 s."""
    flight = pendulum(fast, 0.02, observed=1.0).fly()
    np.testing.assert_allclose(flight.times, 0.02 * np.arange(301))
    plain = pendulum(4.0, 0.002).fly()
    np.testing.assert_allclose(flight.states[:, :2], plain.states[::10, :2], atol=1e-6)
    np.testing.assert_allclose(flight.states[:, 2], flight.states[:, 0] - flight.states[:, 1] / fast, atol=5e-5)
    with pytest.raises(BadInputError, match=r"a mode of 1e\+09 1/s; at a step of 0.02 s it must be below"):
        pendulum(1e9, 0.02)


def test_a_run_ends_with_the_tick_in_which_it_is_to_stop() -> None:
    loop = pendulum(4.0, 0.02, duration=30.0)
    whole, stopped = loop.fly(), loop.fly(stop=lambda rows: rows.times > 24.11)
    assert stopped.times[-1] == pytest.approx(24.2)
    np.testing.assert_array_equal(stopped.states, whole.states[: len(stopped.times)])


def test_a_loop_that_blows_up_says_when_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    class Blown(LinearPlant):
        def rate(self, x: Any, u: Any, d: Any, winds: Any, p: Any) -> Any:
            return x**2

    plant, law = Blown(np.zeros((1, 1)), np.zeros((1, 1))), gain_law("none", np.zeros((1, 1)))
    loop = CompiledLoop(ClosedLoop(plant, law, Scenario(200.0, 0.05, 0.1, np.ones(1))))
    with pytest.raises(NoSolutionError, match=r"left every bound at t = 1"):
        loop.fly()
    assert capfd.readouterr() == ("", "")
