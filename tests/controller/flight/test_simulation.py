"""The loop: its order, fast modes, its ends; flights summed up: what leaves the envelope, when, and what goes on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest

from controller import Envelope, Scenario, gain_law
from controller.flight.closed_loop import ClosedLoop
from controller.flight.plants import LinearPlant, Plant, Sizes, chosen_states
from controller.flight.simulation import CompiledLoop, Summary, SummedLoop
from controller.policy.policies import OpenLoop
from hfa_model import STATES, State
from hfa_model.aircraft import HFA
from hfa_support import BadInputError, NoSolutionError
from trim import OperatingPoint

SPEED, ALPHA = STATES.index("speed"), STATES.index("alpha")


class Falling(Plant):
    """speed' = -1, alpha' = sqrt(0.0105 + speed): not a number from the step on that passes 0.0105 s."""

    sizes, chosen = Sizes(7, 6, 5), chosen_states(HFA)

    def rate(self, x: Any, u: Any, d: Any, winds: Any = None, p: Any = None) -> Any:
        return ca.vertcat(-1.0, ca.sqrt(0.0105 + x[SPEED]), ca.SX.zeros(5))


def flown(point: OperatingPoint, *, stops: bool, slowest: float = -1e9) -> Summary:
    """0.05 s in steps of 1 ms and ticks of 10."""
    lowest = State(*[-1e9] * 7)._replace(speed=point.states.speed + slowest)
    scenario, law = Scenario(0.05, initial=np.zeros(7)), gain_law("none", np.zeros((5, 6)))
    summed = SummedLoop(Falling(), point, law, scenario, Envelope(lowest, State(*[1e9] * 7), HFA), 1)
    return summed.fly(scenario, lost=None if stops else lambda x: np.zeros(len(x), dtype=bool))


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


# The loop of a pendulum whose observer has a fast mode.


@dataclass(frozen=True)
class Pendulum(LinearPlant):
    """y1' = y2, y2' = -sin y1 - 0.3 y2 + u, and an observer y3 of y1 with a mode at -fast."""

    fast: float = 4.0

    def rate(self, x: Any, u: Any, d: Any, winds: Any = None, p: Any = None) -> Any:
        return ca.vertcat(x[1], -ca.sin(x[0]) - 0.3 * x[1] + u, self.fast * (x[0] - x[2]))


def pendulum(fast: float, step: float, *, tick: float = 0.1, duration: float = 30.0, flights: int = 0) -> CompiledLoop:
    """Pushed by p, which jumps at 3.7 s."""
    plant = Pendulum(np.zeros((3, 3)), np.zeros((3, 1)), fast=fast)
    return CompiledLoop(ClosedLoop(plant, OpenLoop(1), Scenario(duration, step, tick)), fast, flights)


def pushed(tick: int) -> np.ndarray:
    return np.array([0.5 if tick < 37 else -1.0])


def test_the_method_is_of_order_4_where_the_constants_jump_too() -> None:
    start = np.array([1.0, 0.0, 0.0])
    loops = [pendulum(4.0, 0.05 / parts, duration=6.0) for parts in (1, 2, 4)]
    found = [loop.fly(start, pushed).states[::parts] for loop, parts in zip(loops, (1, 2, 4), strict=True)]
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(found))
    assert 12.0 < coarse / fine < 20.0


@pytest.mark.parametrize("fast", [1e3, 1e5])
def test_a_fast_mode_of_the_law_divides_the_steps(fast: float) -> None:
    """The observer follows, and the pendulum is the one without it: 1e5 1/s at a step of 0.02 s."""
    start = np.array([1.0, 0.0, 1.0])
    flight = pendulum(fast, 0.02, duration=6.0).fly(start, pushed)
    np.testing.assert_allclose(flight.times, 0.02 * np.arange(301))
    plain = pendulum(4.0, 0.002, duration=6.0).fly(start, pushed)
    np.testing.assert_allclose(flight.states[:, :2], plain.states[::10, :2], atol=1e-6)
    np.testing.assert_allclose(flight.states[:, 2], flight.states[:, 0] - flight.states[:, 1] / fast, atol=5e-5)
    with pytest.raises(BadInputError, match=r"a mode of 1e\+09 1/s; at a step of 0.02 s it must be below"):
        pendulum(1e9, 0.02)


def test_a_run_ends_with_the_tick_in_which_it_is_to_stop() -> None:
    whole = pendulum(4.0, 0.02).fly(np.array([1.0, 0.0, 0.0]), pushed)
    stopped = pendulum(4.0, 0.02).fly(np.array([1.0, 0.0, 0.0]), pushed, stop=lambda rows: rows.times > 24.11)
    assert stopped.times[-1] == pytest.approx(24.2)
    np.testing.assert_array_equal(stopped.states, whole.states[: len(stopped.times)])


def test_a_loop_that_blows_up_says_when_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    class Blown(LinearPlant):
        def rate(self, x: Any, u: Any, d: Any, winds: Any = None, p: Any = None) -> Any:
            return x**2

    plant = Blown(np.zeros((1, 1)), np.zeros((1, 1)))
    loop = CompiledLoop(ClosedLoop(plant, OpenLoop(1), Scenario(200.0, 0.05, 0.1)))
    with pytest.raises(NoSolutionError, match=r"left every bound at t = 1"):
        loop.fly(np.ones(1), lambda _: np.zeros(1))
    assert capfd.readouterr() == ("", "")
