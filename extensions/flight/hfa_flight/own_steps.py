"""Flights in the steps of another program, of aircraft whose equations have them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.closed_loop import ClosedLoop
from hfa_flight.simulation import CompiledLoop
from hfa_support.errors import BadInputError, choice_of, shortened

#: The method that flies unless another one is named.
RUNGE_KUTTA = "runge-kutta"
JSBSIM = "jsbsim"
METHODS = (RUNGE_KUTTA, JSBSIM)
#: JSBSim's own step, s.
USUAL_STEP = 1.0 / 120.0


def refuse_method(method: str) -> None:
    """BadInputError for a method that does not exist."""
    if method not in METHODS:
        raise BadInputError(f"no method {shortened(method)}; {choice_of(method, METHODS)}")


def in_own_steps(loop: ClosedLoop) -> CompiledLoop:
    """The loop of an aircraft of JSBSim, whose plant moves in JSBSim's frames of the scenario's
    step.

    BadInputError for another aircraft, and for a scenario that these frames do not support:
    actuators, policies with states, gusts, delays, disturbances.
    """
    model: Model = loop.plant.point.model
    make = getattr(model.equations, "jsbsim_steps", None)
    if make is None:
        raise BadInputError(
            f"{model.name}: method {JSBSIM} is for aircraft of JSBSim in their own units; take"
            f" {RUNGE_KUTTA}"
        )
    sizes = loop.state_sizes
    extra = {
        "actuators": sizes.actuators,
        "a policy with states": sizes.memory,
        "a gust": sizes.gust,
        "a delay": loop.scenario.delayed_ticks,
        "disturbances": loop.wind_names or _is_disturbed(loop),
    }
    for what, is_present in extra.items():
        if is_present:
            raise BadInputError(f"method {JSBSIM} flies without {what}; leave it out")
    return _SteppedLoop(loop, make(loop.scenario.step))


def _is_disturbed(loop: ClosedLoop) -> bool:
    """Whether the disturbance of the states is not 0 at all times."""
    disturbance = loop.scenario.disturbance
    if disturbance is None:
        return False
    return not ca.SX(disturbance.at(ca.SX.sym("t"))).is_zero()


class _SteppedLoop(CompiledLoop):
    """A loop whose ticks are frames of another program."""

    def __init__(self, loop: ClosedLoop, steps: Any) -> None:
        super().__init__(loop)
        self._tick = _OwnTick(self, steps)  # type: ignore[assignment]

    def observed_at(self, time: float, x: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the observations at a time."""
        return np.array(self._observed(time, x, held)).ravel()

    def inputs_in(self, observed: np.ndarray) -> np.ndarray:
        """The deviation of the inputs, (m,)."""
        begin, end = self._ends[0], self._ends[1]
        return observed[begin:end]


class _OwnTick:
    """The frames of a tick, called as the compiled one: arguments and results in place."""

    def __init__(self, loop: _SteppedLoop, steps: Any) -> None:
        plant = loop.loop.plant
        point = plant.point
        self._loop = loop
        self._steps = steps
        self._trim = np.array(point.states)
        self._inputs = np.array(point.inputs)
        self._parameters = plant.model.p  # type: ignore[attr-defined]
        scenario = loop.loop.scenario
        self._step = scenario.step
        self._count = scenario.steps_per_tick
        held = sum(loop.loop.held_sizes)
        size = self._trim.size
        observed = loop.observed_at(0.0, np.zeros(size), np.zeros(held)).size
        self.inputs = (np.zeros(1 + size), np.zeros(held))
        self.results = (np.zeros(self._count * (1 + size)), np.zeros(self._count * observed))

    def __call__(self) -> None:
        """Fly a tick; the first one begins a flight."""
        now, held = self.inputs
        rows = self.results[0].reshape(self._count, -1)
        observed = self.results[1].reshape(self._count, -1)
        time = now[0]
        x = now[1:].copy()
        if time == 0.0:
            self._steps.begin(self._trim + x, self._parameters, self._inputs)
        for number in range(self._count):
            observed[number] = self._loop.observed_at(time, x, held)
            u = self._inputs + self._loop.inputs_in(observed[number])
            x = self._steps.advance(u) - self._trim
            time += self._step
            rows[number] = [time, *x]
