"""Flights against two others: the linear model, to second order, and an adaptive integrator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cli import assert_refused, hfa
from known_models import SMALL, FlownCase, flown, signal
from random_points import STATE_SCALES
from scipy.integrate import solve_ivp

from controller import Actuators, Dryden, FlownLaw, OneMinusCosine, Scenario, Signal
from controller.flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant
from controller.flight.nonlinear_flight import NonlinearFlight
from controller.flight.simulation import CompiledLoop
from controller.policy.signals import Harmonic
from hfa_model import LINEAR_STATES, STATES, Input
from hfa_model.vectors import CONTROL_LIMITS
from trim import find_operating_point, level_flight

N = len(LINEAR_STATES)
#: Parts of 1 ft/s, 1 deg and 1 deg/s at once; large enough that rounding does not show.
SIZES = (0.001, 0.004, 0.016)
DIRECTION = np.array([1.0, 0.017, 10.0, 0.017, 0.017, 0.017, 0.017])


def slopes(plant: NonlinearPlant, linear: LinearPlant, law: FlownLaw) -> np.ndarray:
    """d log |x_nonlinear - x_linear| / d log size of the closed loop released from SIZES x DIRECTION, by state, (7,).

    2 where the linear model is the derivative (Taylor), 1 where it is not.
    """
    scenario = Scenario(2.0, 0.001, 0.05, DIRECTION)
    loops = [CompiledLoop(ClosedLoop(each, law, scenario)) for each in (plant, linear)]
    errors = []
    for size in SIZES:
        one, other = (loop.fly(replace(scenario, initial=size * DIRECTION)).states for loop in loops)
        errors.append(np.abs(one - other).max(axis=0) / np.array(STATE_SCALES))
    return np.asarray(np.polyfit(np.log(SIZES), np.log(errors), 1)[0])


def test_the_linear_prediction_is_wrong_to_second_order_only(newton: FlownCase, at_15: FlownCase) -> None:
    """And one made half a degree away is wrong to first order."""
    for case, off in ((at_15, 0.0), (newton, 0.5)):
        other = find_operating_point(case.aircraft, level_flight(float(np.radians(15.0 + off))))
        linear = LinearPlant.at(case.aircraft, other)
        found = dict(zip(STATES, slopes(NonlinearPlant(case.aircraft, case.point), linear, case.law), strict=True))
        if off:
            assert max(found[name] for name in ("alpha", "pitch", "pitch_rate", "dihedral")) < 1.5
        else:
            assert all(1.9 < slope < 2.1 for slope in found.values()), found


def one_flight_of_everything(duration: float = 1.0, step: float = 0.001) -> Scenario:
    """Every stage at once: reference, disturbance, noise, errors, actuators, turbulence."""
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    return Scenario(
        duration=duration,
        step=step,
        initial=0.1 * SMALL,
        reference=signal(dihedral=0.01),
        disturbance=Signal(np.zeros(N), np.zeros(N), (Harmonic(3.0, np.full(N, 1e-3), np.zeros(N)),)),
        noise=signal(alpha=1e-4),
        errors={"lift_slope": 0.98},
        actuators=Actuators(Input(*[0.02] * 5), lowest, highest, Input(*[np.inf] * 5)),
        gust=Dryden(1.0, 1750.0, 68.0, 0.01, round(duration / 0.01), seed=3),
    )


def adaptive_states(result: NonlinearFlight) -> np.ndarray:
    """The same flight by DOP853 at rtol 1e-10, at the ends of the ticks, (ticks + 1, 7).

    Started anew where what the law is handed, a gust's noise or an actuator jumps: a jump inside its step would cost it
    its order. Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Section II.10, as in SciPy.
    """
    loop, scenario = CompiledLoop(result.loop), result.loop.scenario
    y, every = result.loop.start(), result.loop.constants()
    rows, begin, ticks = [y[:7]], 0, scenario.ticks
    while begin < ticks:
        p, end = every(begin).copy(), begin + 1
        while end < ticks and np.array_equal(every(end), p):
            end += 1
        times = scenario.tick * np.arange(begin, end + 1)
        found = solve_ivp(
            lambda t, state, p=p: np.array(loop.rate(t, state, p)).ravel(),
            (times[0], times[-1]),
            y,
            method="DOP853",
            t_eval=times[1:],
            rtol=1e-10,
            atol=1e-14,
        )
        assert found.success
        rows += list(found.y[:7].T)
        y, begin = found.y[:, -1], end
    return np.array(rows)


def difference(fixed: np.ndarray, adaptive: np.ndarray) -> float:
    """max |fixed - adaptive| / max |adaptive| over the states' deviations from trim."""
    size = np.maximum(np.abs(adaptive).max(axis=0), 1e-3 * np.array(STATE_SCALES))
    return float((np.abs(fixed - adaptive).max(axis=0) / size).max())


SCENARIOS = {
    "gust": Scenario(duration=2.5, gust=OneMinusCosine(150.0, 4.0, 68.0, 0.2), errors={"panel_mass": 1.05}),
    "everything": one_flight_of_everything(),
}


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_the_fixed_step_agrees_with_an_adaptive_integrator(at_15: FlownCase, scenario: Scenario) -> None:
    result = flown(at_15, scenario)
    assert result.departure is None
    adaptive, fixed = adaptive_states(result), result.flight.states[:: scenario.steps_per_tick]
    assert difference(fixed, adaptive) < 1e-6


def test_a_step_that_is_too_long_is_seen(newton: FlownCase) -> None:
    result = flown(newton, Scenario(duration=1.0, step=0.01, initial=SMALL))
    assert difference(result.flight.states, adaptive_states(result)) > 1e-6


def test_the_same_flight_twice_gives_the_same_bits(newton: FlownCase) -> None:
    one, two = (flown(newton, one_flight_of_everything(0.5)) for _ in range(2))
    for name in ("times", "states", "errors", "inputs", "memory", "updrafts"):
        assert np.array_equal(getattr(one.flight, name), getattr(two.flight, name)), name
    assert np.any(one.flight.updrafts != 0.0)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("fly", "--initial", "speed=-70"), "begins with speed -2 ft/s beyond 34"),
        (("schedule", "--to", "16:1", "--initial", "dihedral=-90"), "begins with dihedral -75 deg beyond -60"),
    ],
)
def test_a_start_outside_the_envelope_is_refused(words: tuple[str, ...], named: str) -> None:
    assert_refused(hfa(*words, "--dihedral", "15", "--law", "exact"), 2, named)
