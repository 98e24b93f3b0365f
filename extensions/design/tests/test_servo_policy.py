"""Scheduled controllers in flight: measurements, commands, closed loop and anti-windup."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from controllers import integrating_controller, small_controller
from known_models import model_at
from scipy.integrate import solve_ivp
from tolerances import SAME_FORMULA

from hfa import BadInputError, Model, OperatingPoint, fly, linearize
from hfa_flight import (
    ActuatorBank,
    CommandedStates,
    CommandSteps,
    Harmonic,
    Scenario,
    ScheduledController,
    Waveform,
    flight_envelope,
    servo_policy,
)
from hfa_model import INPUTS, LINEAR_STATES, STATES, Input

Z = "vertical_acceleration_short_period"
FREE = ActuatorBank(
    Input(*[0.5] * 5), Input(*[-np.inf] * 5), Input(*[np.inf] * 5), Input(*[np.inf] * 5)
)


@pytest.fixture(scope="module")
def point() -> OperatingPoint:
    return model_at(10.0).point


def commands(*values: float) -> CommandSteps:
    return CommandSteps(
        ("dihedral",), 1.0 + 10.0 * np.arange(len(values)), np.array(values)[:, None]
    )


def servo_flight(
    aircraft: Model, point: OperatingPoint, controller: ScheduledController, **changes: object
) -> Any:
    follow = commands(0.01)
    law = servo_policy(controller, follow, aircraft, point)
    given = {
        "duration": 12.0,
        "step": 0.01,
        "reference": CommandedStates(follow, LINEAR_STATES),
        "actuators": FREE,
    } | changes
    return fly(
        aircraft, point, law, scenario=Scenario(**given), envelope=flight_envelope(aircraft, point)
    )  # type: ignore[arg-type]


def test_fly_accepts_a_controller_as_a_policy(point: OperatingPoint) -> None:
    """`hfa.fly` of a controller equals the flight of its policy without commands.

    Without actuators it is refused.
    """
    aircraft = point.model
    controller = small_controller(aircraft)
    none = CommandSteps((), np.zeros(0), np.zeros((0, 0)))
    scenario = Scenario(duration=1.0, step=0.01, actuators=FREE)
    initial = {"dihedral": 0.01}
    law = servo_policy(controller, none, aircraft, point)
    expected = fly(aircraft, point, law, 1.0, initial=initial, scenario=scenario)
    flown = fly(aircraft, point, controller, 1.0, initial=initial, scenario=scenario)
    np.testing.assert_array_equal(flown.states, expected.states)
    assert not np.array_equal(flown.states[-1], flown.states[0])
    with pytest.raises(BadInputError, match="requires actuators"):
        fly(aircraft, point, controller, 1.0)


@pytest.mark.parametrize("measured", [Z, "load_factor", "aileron_outer_position"])
def test_measured_outputs_are_those_of_the_linear_model(
    published_aircraft: Model, point: OperatingPoint, measured: str
) -> None:
    """A controller u = y of one measurement in flight, with an updraft w: y = C x + D a + F w."""
    parts = {"A": (1, 1), "B": (1, 4), "C": (1, 1), "D": (1, 4), "W": (1, 1)}
    only = {name: np.zeros((3, *shape)) for name, shape in parts.items()}
    only["D"][:, 0, 0] = 1e-3
    controller = small_controller(
        published_aircraft, **only, measurements=(measured, "dihedral"), inputs=("throttle",)
    )
    bank = replace(FREE, lag=Input(*[0.01] * 5))
    initial = {"alpha": 1e-3, "pitch_rate": 2e-3}
    updraft = {"updraft": Waveform(np.array([0.1]), np.zeros(1))}
    scenario = Scenario(0.5, 0.001, 0.01, air=updraft, actuators=bank)
    flight = fly(published_aircraft, point, controller, initial=initial, scenario=scenario)
    late = flight.time > 0.1
    t = flight.time[late]
    x = flight.flight.states[late][:, [STATES.index(name) for name in LINEAR_STATES]]
    a = flight.inputs[late] - np.array(point.inputs)
    linear = linearize(published_aircraft, point, outputs=("vertical_acceleration", "load_factor"))
    alpha = LINEAR_STATES.index("alpha")
    known = {
        Z: linear.C[0, alpha] * x[:, alpha] + a @ linear.D[0] + 0.1 * linear.F[0, 0],
        "load_factor": x @ linear.C[1] + a @ linear.D[1] + 0.1 * linear.F[1, 0],
        "aileron_outer_position": a[:, INPUTS.index("aileron_outer")],
    }[measured]
    command = 1e-3 * known
    lagged = a[:, INPUTS.index("throttle")]
    expected = lagged + 0.01 * np.gradient(lagged, t)
    np.testing.assert_allclose(expected[5:-5], command[5:-5], rtol=0.02, atol=1e-7)


def test_the_linear_prediction_equals_a_numpy_integration(
    published_aircraft: Model, point: OperatingPoint
) -> None:
    """The linear prediction of a flight equals an integration of the same closed loop in NumPy."""
    controller = integrating_controller(published_aircraft)
    result = servo_flight(published_aircraft, point, controller)
    assert result.predicted is not None
    free = replace(published_aircraft, linear=tuple(published_aircraft.states))
    model = linearize(free, replace(point, model=free, problem=None))
    follow = commands(0.01)
    eta = STATES.index("dihedral")
    q = STATES.index("pitch_rate")
    column = INPUTS.index("aileron_outer")

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        x = y[:7]
        a = y[7:12]
        e = y[12:]
        r = float(follow.sampled(np.array([t]))[0, 0])
        A, B, C, D = controller.at(point.states.dihedral + x[eta])
        told = np.array([x[q], x[eta], r, 0.0])
        u = np.zeros(5)
        u[column] = (C @ e + D @ told)[0]
        return np.concatenate([model.A @ x + model.B @ a, 2.0 * (u - a), A @ e + B @ told])

    path = solve_ivp(rate, (0.0, 12.0), np.zeros(13), rtol=1e-7, atol=1e-10, max_step=0.5)
    np.testing.assert_allclose(result.predicted.states[-1], path.y[:7, -1], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(result.predicted.memory[-1], path.y[12:, -1], rtol=1e-5, atol=1e-9)


def test_the_anti_windup_term_requires_saturation(
    published_aircraft: Model, point: OperatingPoint
) -> None:
    """Without saturation, the anti-windup term W (u_applied - u) has no effect.

    With saturation, the term reduces the largest integral to less than half.
    """
    lowest = np.array(point.inputs) - 1e-4
    highest = np.array(point.inputs) + 1e-4
    narrow = replace(FREE, lowest=Input(*lowest), highest=Input(*highest))
    controller = integrating_controller(published_aircraft, W=-2000.0 * np.ones((3, 1, 1)))
    plain = integrating_controller(published_aircraft)
    wound, without = (
        servo_flight(published_aircraft, point, each).flight.memory for each in (controller, plain)
    )
    np.testing.assert_allclose(wound, without, atol=1e-12)
    saturated = servo_flight(published_aircraft, point, plain, actuators=narrow).flight
    relieved = servo_flight(published_aircraft, point, controller, actuators=narrow).flight
    assert np.abs(saturated.inputs).max() == pytest.approx(1e-4, rel=1e-6)
    assert np.abs(relieved.memory).max() < 0.5 * np.abs(saturated.memory).max()


TIMES = np.array([1.0, 4.0, 9.0])
VALUES = np.array([[1.0, -2.0], [0.5, 0.0], [0.0, 3.0]])


def test_a_waveform_is_equal_in_all_forms() -> None:
    """A waveform has the same values at one time, at several times, and as an expression."""
    rng = np.random.default_rng(2)
    constant, slope, sine, cosine = rng.normal(size=(4, 3))
    signal = Waveform(constant, slope, (Harmonic(1.3, sine, cosine), Harmonic(0.2, cosine, -sine)))
    times = np.array([0.0, 0.7, 5.0])
    t = ca.SX.sym("t")
    one = signal.sampled(times)
    compiled = ca.Function("s", [t], [signal.at(t)])
    for row, time in zip(one, times.tolist(), strict=True):
        first = sine * np.sin(1.3 * time) + cosine * np.cos(1.3 * time)
        second = cosine * np.sin(0.2 * time) - sine * np.cos(0.2 * time)
        np.testing.assert_allclose(row, constant + slope * time + first + second, rtol=SAME_FORMULA)
        np.testing.assert_allclose(signal.at(time), row, rtol=SAME_FORMULA)
        np.testing.assert_allclose(np.array(compiled(time)).ravel(), row, rtol=SAME_FORMULA)


def steps(damping: float = 2.0) -> CommandSteps:
    return CommandSteps(
        ("dihedral", "vertical_acceleration_short_period"), TIMES, VALUES, 0.5, damping
    )


@pytest.mark.parametrize("damping", [0.6, 1.0, 1.5, 2.0])
def test_filtered_commands_agree_with_numerical_integration(damping: float) -> None:
    """The closed form of filtered commands agrees with a numerical integration of the command
    filter.
    """
    commands = steps(damping)
    w = 0.5
    y = np.zeros(4)
    for begin, end, goal in zip([0.0, *TIMES], [*TIMES, 20.0], [np.zeros(2), *VALUES], strict=True):

        def rate(t: float, y: np.ndarray, goal: np.ndarray = goal) -> np.ndarray:
            return np.concatenate([y[2:], w**2 * (goal - y[:2]) - 2 * damping * w * y[2:]])

        y = solve_ivp(rate, (begin, end), y, rtol=1e-10, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(commands.sampled(np.array([end]))[0], y[:2], atol=1e-8)
        np.testing.assert_allclose(
            np.array(ca.DM(commands.rate(ca.SX(end)))).ravel(), y[2:], atol=1e-8
        )
