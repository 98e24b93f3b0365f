"""Two figures that a nonlinear flight must reproduce: the linear model to second order, an adaptive integrator."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.flight.closed_loop import ClosedLoop
from controller.flight.nonlinear_flight import NonlinearFlight
from controller.flight.plants import LinearizedAircraft, NonlinearPlant, Plant
from controller.flight.simulation import CompiledLoop
from controller.policy.policies import FlownLaw, gain_law
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import STATE_SCALES, STATES
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_least, at_most
from trim.point.operating_point import OperatingPoint

#: Deviations of the slope study as fractions of `DIRECTION`; large enough that rounding does not show.
SIZES = (0.001, 0.002, 0.004, 0.008, 0.016)
#: 1 ft/s, 1 deg and 1 deg/s at once: every state takes part.
DIRECTION = np.array([1.0, 0.017, 10.0, 0.017, 0.017, 0.017, 0.017])
#: s, of each flight of the slope study.
DURATION = 5.0
LOWEST_SLOPE, HIGHEST_SLOPE = 1.9, 2.1
#: Largest difference from the adaptive integrator, as a fraction of the largest deviation of that state.
INTEGRATION = 1e-6
#: A deviation below this part of `STATE_SCALES` counts as that large: a flight at rest leaves rounding, some 1e-11.
AT_REST = 1e-3
ADAPTIVE_TOLERANCE = 1e-10


def deviations(aircraft: Aircraft, point: OperatingPoint, law: FlownLaw) -> np.ndarray:
    """max over t of |x_nonlinear - x_linear| in scaled units (`STATE_SCALES`), (S, 7), of the closed loop released from
    `SIZES` times `DIRECTION`.

    x_nl - x_lin = O(size²) because the two loops agree to first order (Taylor).
    """
    step, tick = 0.001, 50
    times: dict[str, Any] = {"step": step, "steps_per_tick": tick, "ticks": round(DURATION / step / tick)}
    plants: tuple[Plant, ...] = NonlinearPlant(aircraft, point), LinearizedAircraft.at(aircraft, point)
    loops = [CompiledLoop(ClosedLoop(plant, law.policy)) for plant in plants]
    errors = []
    for size in SIZES:
        nonlinear, linear = (loop.fly(size * DIRECTION, law.constants, **times).states for loop in loops)
        errors.append(np.abs(nonlinear - linear).max(axis=0) / np.array(STATE_SCALES))
    return np.array(errors)


def slope_checks(errors: np.ndarray) -> tuple[Check, ...]:
    """d log error / d log size of each state by least squares, errors (S, 7), within 1.9 to 2.1: 2 where the linear
    model is the derivative."""
    found = []
    for name, slope in zip(STATES, np.polyfit(np.log(SIZES), np.log(errors), 1)[0].tolist(), strict=True):
        reason = f"the error of the linear prediction grows with the deviation to the power {slope:.3g}, not 2"
        found.append(at_least(f"slope_{name}_at_least", slope, LOWEST_SLOPE, reason))
        found.append(at_most(f"slope_{name}_at_most", slope, HIGHEST_SLOPE, reason))
    return tuple(found)


def adaptive_states(
    loop: CompiledLoop,
    initial: np.ndarray,
    law: FlownLaw,
    *,
    tick: float,
    ticks: int,
) -> np.ndarray:
    """The plant's states at the ends of the ticks, the start first, by DOP853 at rtol 1e-10; (ticks + 1, n).

    The integrator is started anew where what the law is handed, a gust's noise or an actuator jumps: a jump inside its
    step would cost it its order. Raises NoSolutionError when it stops on the way.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Section II.10, as in SciPy.
    """
    from scipy.integrate import solve_ivp

    y, every, n = loop.loop.start(initial, law.memory), loop.loop.constants(law.constants), len(initial)
    rows = [y[:n]]
    begin = 0
    while begin < ticks:
        p = every(begin).copy()
        end = begin + 1
        while end < ticks and np.array_equal(every(end), p):
            end += 1
        times = tick * np.arange(begin, end + 1)
        found = solve_ivp(
            lambda t, state, p=p: np.array(loop.rate(t, state, p)).ravel(),
            (times[0], times[-1]),
            y,
            method="DOP853",
            t_eval=times[1:],
            rtol=ADAPTIVE_TOLERANCE,
            atol=1e-14,
        )
        if not found.success:
            reached = found.t[-1] if len(found.t) else times[0]
            raise NoSolutionError(f"the adaptive integrator stopped after {reached:.6g} s: {found.message}")
        rows += list(found.y[:n].T)
        y, begin = found.y[:, -1], end
    return np.array(rows)


def agreement_checks(aircraft: Aircraft, law: FlownLaw, result: NonlinearFlight) -> tuple[Check, ...]:
    """Both figures for a flight: the slopes about its trim, with its last gain, and the same flight integrated anew."""
    scenario = result.scenario
    errors = deviations(aircraft, result.point, gain_law(law.name, law.gains[-1]))
    fixed = result.flight.states[:: scenario.steps_per_tick]
    adaptive = adaptive_states(
        CompiledLoop(result.loop), scenario.initial, law, tick=scenario.tick, ticks=len(fixed) - 1
    )
    return (*slope_checks(errors), *integration_checks(fixed, adaptive))


def integration_checks(fixed: np.ndarray, adaptive: np.ndarray) -> tuple[Check, ...]:
    """max |fixed - adaptive| / max |adaptive| of each state's deviation from trim, (N, 7) each, at most 1e-6.

    The divisor is at least `AT_REST` of the state's scale.
    """
    found = []
    for index, name in enumerate(STATES):
        size = max(float(np.abs(adaptive[:, index]).max()), AT_REST * STATE_SCALES[index])
        difference = float(np.abs(fixed[:, index] - adaptive[:, index]).max())
        relative = difference / size
        reason = f"the fixed step and the adaptive integrator differ by {relative:.2g}; take a shorter step"
        found.append(at_most(f"integration_{name}", relative, INTEGRATION, reason))
    return tuple(found)
