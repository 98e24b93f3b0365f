"""Simulation of JSBSim aircraft with JSBSim's integration steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.closed_loop import ClosedLoop, NonlinearPlant
from hfa_flight.scenario import Scenario
from hfa_flight.simulation import CompiledLoop
from hfa_support.errors import BadInputError, choice_of, refuse_unless_positive, shortened

#: The default method.
RUNGE_KUTTA = "runge-kutta"
JSBSIM = "jsbsim"
METHODS = (RUNGE_KUTTA, JSBSIM)
#: Default step of JSBSim, s.
_USUAL_STEP = 1.0 / 120.0
#: Relative tolerance within which a number of steps counts as whole.
_WHOLE = 1e-6


def refuse_method(model: Model, method: str, step: float | None) -> None:
    """Raise BadInputError unless the method exists and supports the aircraft and the step.

    step: value of --step, or None. Only the method "jsbsim" accepts a step.
    """
    if method not in METHODS:
        raise BadInputError(
            f"--method (method= in Python) is {shortened(method)}; {choice_of(method, METHODS)}"
        )
    if method != JSBSIM and step is not None:
        raise BadInputError(
            f"--step (step= in Python) applies only to --method {JSBSIM}; remove --step, or use "
            "this method"
        )
    if method == JSBSIM and not hasattr(model.equations, "jsbsim_steps"):
        raise BadInputError(
            f"{model.name}: --method {JSBSIM} supports only JSBSim aircraft without unit"
            f" conversion; use --method {RUNGE_KUTTA}"
        )


def timed_by(method: str, step: float | None, scenario: Scenario) -> Scenario:
    """Return the scenario with the integration step and tick of the method.

    For the method "jsbsim", both equal `step`. For other methods, the scenario is unchanged.

    step: step of method "jsbsim", s, or None for 1/120

    Raises BadInputError if the step is not positive or the duration is not a whole number of steps.
    """
    if method != JSBSIM:
        return scenario
    frame = _USUAL_STEP if step is None else float(step)
    refuse_unless_positive("step", frame, " s")
    frames = scenario.duration / frame
    if round(frames) < 1 or abs(frames - round(frames)) > _WHOLE * frames:
        raise BadInputError(
            f"--duration {scenario.duration:g} s is not a multiple of --step {frame:.6g} s, as"
            f" --method {JSBSIM} requires; change --duration or --step"
        )
    return replace(scenario, step=frame, tick=frame)


def in_own_steps(loop: ClosedLoop) -> CompiledLoop:
    """Return the compiled loop of a JSBSim aircraft that JSBSim's own integration advances.

    Raises BadInputError for actuators, a policy with memory, a gust, a delay or a disturbance.
    These are not supported.
    """
    model: Model = loop.plant.point.model
    make: Callable[[float], Any] = model.equations.jsbsim_steps  # type: ignore[attr-defined]  # of JSBSim's
    scenario = loop.scenario
    extra = {
        "--actuators": scenario.actuators is not None,
        "a policy with states": loop.state_sizes.memory,
        "--gust or --turbulence": scenario.gust is not None,
        "--delay": scenario.delayed_ticks,
        "--disturbance": loop.wind_names or _is_disturbed(loop),
    }
    for what, is_present in extra.items():
        if is_present:
            raise BadInputError(
                f"--method {JSBSIM} does not support {what}; use --method {RUNGE_KUTTA}"
            )
    return CompiledLoop(loop, stepper=lambda compiled: _OwnSteps(compiled, make))


def _is_disturbed(loop: ClosedLoop) -> bool:
    """Return whether the disturbance of the states is nonzero at some time."""
    disturbance = loop.scenario.disturbance
    if disturbance is None:
        return False
    return not ca.SX(disturbance.at(ca.SX.sym("t"))).is_zero()


class _OwnSteps:
    """Stepper of a JSBSim aircraft by JSBSim's own integration."""

    def __init__(self, loop: CompiledLoop, make: Callable[[float], Any]) -> None:
        plant = loop.loop.plant
        assert isinstance(plant, NonlinearPlant)  # only these have steps of their own
        scenario = loop.loop.scenario
        self.step = scenario.step
        self.steps = scenario.steps_per_tick
        self.sizes = loop.rate.numel_in(1), loop.observed.numel_out(0)
        self._loop = loop
        self._own = make(scenario.step)
        self._trim = np.array(plant.point.states)
        self._inputs = np.array(plant.point.inputs)
        self._parameters = plant.model.p

    def __call__(
        self, time: float, state: np.ndarray, held: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the states after each step, and the values observed before it."""
        if time == 0.0:
            self._own.begin(self._trim + state[0], self._parameters, self._inputs)
        after = np.empty((1, self.steps, self.sizes[0]))
        seen = np.empty((1, self.steps, self.sizes[1]))
        for number in range(self.steps):
            seen[:, number] = self.observed(time, state, held)
            u = self._inputs + self._loop.inputs_in(seen[0, number])
            state = (self._own.advance(u) - self._trim)[None]
            after[:, number] = state
            time += self.step
        return after, seen

    def observed(self, time: float, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the values observed at a time, (1, k)."""
        return np.array(self._loop.observed(time, state[0], held[0])).reshape(1, -1)
