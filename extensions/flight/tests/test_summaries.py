"""What a flight says about itself: envelope, departures, excesses, errors, shares and problems.

The glider is linear, so its flights and problems are computed by hand.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from matplotlib import pyplot
from scipy.linalg import expm

import hfa
from hfa import BadInputError, Model, Signal
from hfa_aircraft.limits import Limits
from hfa_aircraft.march.refinement import IntegrationError
from hfa_aircraft.signals import record
from hfa_aircraft.waveform import Waveform
from hfa_flight import ActuatorBank, CommandSteps, MonteCarlo, Scenario, flight_envelope
from hfa_flight.air.gust_equations import own_disturbances, taken_components
from hfa_flight.air.gusts import OneMinusCosine
from hfa_flight.air.names import gust_speed
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant
from hfa_flight.commands.fly import _command
from hfa_flight.envelope import (
    Departure,
    control_excesses,
    departure,
    limits_text,
    refuse_start,
)
from hfa_flight.export.c_text import braced, displaced_state
from hfa_flight.flight import _figures
from hfa_flight.history import Deviations
from hfa_flight.initial_box import start_box
from hfa_flight.limit_cycle import Decay, LimitCycle, duration_for, oscillation
from hfa_flight.options import ScenarioGiven, _turbulence, actuators_of, at_held_altitude, gust_at
from hfa_flight.policies.policy import GainPolicy, function_policy, open_loop
from hfa_flight.problem import flight_problem
from hfa_flight.samples.report import member_report, summary
from hfa_flight.simulation import CompiledLoop

#: Trim: alpha .1 rad, speed 100 ft/s, altitude 1000 ft, elevator .05 rad, throttle .5, flap 0.
ALPHA, SPEED, ELEVATOR, THROTTLE = 0.1, 100.0, 0.05, 0.5
A = np.array([[-2.0, 0.0], [-10.0, -0.5]])
B = np.array([[3.0, 0.0, 1.0], [0.0, 20.0, -4.0]])


def glide(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    a, v, h = x.alpha - ALPHA, x.speed - SPEED, x.altitude - 1000.0
    e, t = u.elevator - ELEVATOR, u.throttle - THROTTLE
    rates = {
        "alpha": A[0, 0] * a + B[0, 0] * e + u.flap + 1e-3 * h,
        "speed": A[1, 0] * a + A[1, 1] * v + B[1, 1] * t - 4.0 * u.flap,
        "altitude": 50.0 * a,
        "distance": v,
    }
    return rates, {"angle_of_attack": x.alpha + w.updraft / 100.0}


GLIDER = Model(
    "glider",
    {
        "alpha": Signal("rad", nominal=0.2, min=-0.3, max=0.5),
        "speed": Signal("ft/s", nominal=100.0, min=50.0, max=300.0, assumed=True),
        "altitude": Signal("ft", nominal=1000.0, min=0.0, max=5000.0),
        "distance": Signal("ft", nominal=1000.0),
    },
    {
        "elevator": Signal("rad", nominal=0.1, min=-0.15, max=0.25),
        "throttle": Signal("1", nominal=0.5, min=0.0, max=1.0, moving="the engine has no lag"),
        "flap": Signal("rad", nominal=0.1, moving="the flap has no lag"),
    },
    glide,
    disturbances={"updraft": Signal("ft/s")},
    outputs={"angle_of_attack": Signal("rad")},
    trim={"alpha": ALPHA, "speed": SPEED, "altitude": 1000.0, "distance": 0.0, "flap": 0.0},
    steady=("alpha", "speed", "altitude"),
    linear=("alpha", "speed"),
)
POINT = hfa.trim(GLIDER)
TRIM = np.array(POINT.states)
ENVELOPE = flight_envelope(GLIDER, POINT)
NOISE = np.array([0.003, -0.7])
REFERENCE = np.array([-0.01, 5.0])


def test_a_flight_summarizes_its_history() -> None:
    """Every figure of a flight with steps of all inputs is that of its time history."""
    # The throttle is beyond its limit 1 from 1 s on, the elevator below -.15 from 3 s on.
    steps = {
        "elevator": [(0.0, 0.02), (3.0, -0.25)],
        "throttle": [(1.0, 0.6)],
    }
    weights = np.diag([3.0, 0.01]), np.diag([2.0, 0.5, 1.0])
    air = {"updraft": Waveform(np.array([5.0]), np.zeros(1))}
    scenario = Scenario(4.0, 0.01, 0.1, np.array([0.02, -3.0, 0.0, 0.0]), air=air)
    flight = hfa.fly(GLIDER, POINT, steps, scenario=scenario, weights=weights)
    x = flight.flight.states
    t = flight.time
    u = np.array([ELEVATOR + 0.02, THROTTLE, 0.0])
    assert flight.departure is None
    np.testing.assert_allclose(flight.inputs[0], u)
    np.testing.assert_allclose(flight["throttle"][t > 1.05], THROTTLE + 0.6)
    np.testing.assert_allclose(flight.states, x + TRIM)
    np.testing.assert_allclose(flight.angles_of_attack, flight["alpha"] + 0.05)
    assert [(e.input, e.value, e.limit, e.unit) for e in flight.exceeded] == [
        ("elevator", pytest.approx(-0.2), -0.15, "rad"),
        ("throttle", pytest.approx(1.1), 1.0, "1"),
    ]
    assert (flight.ok, bool(flight), flight.held, flight.cycle) == (False, False, True, None)
    assert "exceeded control limit: elevator -11.46 deg beyond -8.594" in flight.title()
    shares = flight.share_beyond_control_limits
    assert shares == {
        "elevator": pytest.approx(0.25, abs=0.01),
        "throttle": pytest.approx(0.75, abs=0.01),
        "flap": 0.0,
    }
    assert flight.flown == pytest.approx(4.0)
    assert flight.final["alpha"] == flight["alpha"][-1]
    assert flight.final["angle_of_attack"] == flight.angles_of_attack[-1]
    largest = flight.largest_deviation
    assert largest["speed"] == np.abs(x[:, 1]).max()
    assert largest["angle_of_attack"] == pytest.approx(np.abs(x[:, 0] + 0.05).max())
    half = len(t) // 2
    rms = np.sqrt(np.mean(x[half:, :2] ** 2, axis=0))
    np.testing.assert_allclose(list(flight.rms_error.values()), rms)
    v = flight.flight.inputs
    rate = (x[:, :2] ** 2) @ np.diag(weights[0])
    cost = np.trapezoid(rate, t) + np.sum((v[:-1] ** 2) @ np.diag(weights[1]) * np.diff(t))
    assert flight.cost == pytest.approx(cost, rel=1e-9)
    assert flight.warnings == [*POINT.warnings, "the engine has no lag"]
    np.testing.assert_allclose(flight.predicted.states, x, atol=1e-9)
    moved = replace(flight, predicted=replace(flight.predicted, states=x - [0.0, 2.0, 0.0, 0.0]))
    assert moved.largest_difference_from_linear["speed"] == pytest.approx(2.0)
    report = flight.report()
    (inputs,) = (part for part in report.parts if getattr(part, "header", ("",))[0] == "input")
    low, high = flight.inputs.min(axis=0), flight.inputs.max(axis=0)
    assert [row[2:] for row in inputs.rows] == [
        (f"{math.degrees(low[0]):.4g}", f"{math.degrees(high[0]):.4g}", "25.2 %"),
        (f"{low[1]:.4g}", f"{high[1]:.4g}", f"{100 * shares['throttle']:.3g} %"),
        ("0", "0", "0 %"),
    ]
    history = flight.history().history
    np.testing.assert_allclose(history["times"], 0.1 * np.arange(41))
    np.testing.assert_allclose(history["states"], flight.states[::10])
    records = report.records
    assert records.header[-2:] == ("updraft [ft/s]", "angle_of_attack [rad]")
    row = np.array(records.rows[40], dtype=float)
    np.testing.assert_allclose(row[:5], [4.0, *flight.states[-1]])
    np.testing.assert_allclose(row[-2:], [5.0, flight.angles_of_attack[-1]])


def test_a_figure_draws_values_predictions_references_and_near_limits() -> None:
    """A limit is drawn if the values come within a fifth of the range to it."""
    scenario = Scenario(
        4.0,
        0.01,
        0.1,
        np.array([0.02, -3.0, 0.0, 0.0]),
        reference=Waveform(REFERENCE, np.zeros(2)),
        air={"updraft": Waveform(np.array([5.0]), np.zeros(1))},
    )
    steps = {"elevator": [(0.0, 0.14)], "throttle": [(1.0, -0.31)]}
    flight = hfa.fly(GLIDER, POINT, steps, scenario=scenario)
    axes = flight.figure().axes
    labels = ["alpha over ground, deg", "speed, ft/s", "altitude, ft", "distance, ft"]
    labels += ["deflections, deg", "throttle", "updraft, ft/s", ""]
    assert [each.get_ylabel() for each in axes] == labels
    drawn = dict(zip(labels, axes, strict=True))

    def lines(label: str) -> dict[str, np.ndarray]:
        return {str(line.get_label()): line.get_ydata() for line in drawn[label].get_lines()}

    degree = math.degrees(1.0)
    alpha, speed = (lines(label) for label in labels[:2])
    np.testing.assert_allclose(alpha["nonlinear"], degree * flight["alpha"])
    np.testing.assert_allclose(alpha["reference"], degree * (ALPHA + REFERENCE[0]))
    np.testing.assert_allclose(alpha["angle_of_attack"], degree * flight.angles_of_attack)
    np.testing.assert_allclose(speed["reference"], SPEED + REFERENCE[1])
    np.testing.assert_allclose(speed["linear"], flight.predicted.states[:, 1] + SPEED)
    assert "reference" not in lines("altitude, ft")
    elevator = lines("deflections, deg")["elevator: -8.594 to 14.32 deg"]
    np.testing.assert_allclose(elevator, degree * flight["elevator"])
    assert "flap: no limits" in lines("deflections, deg")
    np.testing.assert_allclose(lines("updraft, ft/s").popitem()[1], flight.flight.updrafts)
    limits = {
        label: [line.get_ydata()[0] for line in each.get_lines() if line.get_gid() == "limit"]
        for label, each in drawn.items()
    }
    near = {label: numbers for label, numbers in limits.items() if numbers}
    assert near == {
        "alpha over ground, deg": [pytest.approx(0.5 * degree)],
        "speed, ft/s": [50.0],
        "deflections, deg": [pytest.approx(0.25 * degree)],
        "throttle": [0.0],
    }
    assert drawn["throttle"].get_title("right") == "limits: 0 to 1"
    assert drawn["alpha over ground, deg"].get_title("right").endswith("-17.19 to 28.65 deg")


def test_options_reach_the_scenario() -> None:
    """Disturbances of linear states are added to their rates, others move the air."""
    given = ScenarioGiven(
        model=GLIDER,
        duration=3.0,
        initial={"speed": 2.0, "altitude": -7.0},
        disturbance={"speed": 0.3, "updraft": 5.0},
        actuators=(0.1, 60.0, 1.0),
        delay=0.014,
        noise={"alpha": 0.01},
    )
    scenario = given.scenario(POINT, {}, drawn=False)
    assert (scenario.duration, scenario.tick, scenario.delay) == (3.0, 0.002, 0.014)
    assert scenario.initial.tolist() == [0.0, 2.0, -7.0, 0.0]
    assert scenario.disturbance.at(1.0).tolist() == [0.0, 0.3]
    assert {name: wave.at(1.0).tolist() for name, wave in scenario.air.items()} == {
        "updraft": [5.0]
    }
    assert scenario.noise.at(1.0).tolist() == [0.01, 0.0]
    assert scenario.actuators.lag.elevator == 0.1
    drawn = replace(given, gust=(400.0, 5.0, 2.0)).scenario(POINT, {}, drawn=True)
    assert drawn.uncertainty.noise == {"alpha": 0.01}
    assert drawn.noise.at(1.0).tolist() == [0.0, 0.0]
    assert (drawn.gust.length, drawn.gust.begin) == (400.0, 2.0)
    for delay in (-0.01, 3.0):
        with pytest.raises(BadInputError, match="give a delay from 0 to less than 3 s"):
            replace(given, delay=delay).scenario(POINT, {}, drawn=False)


def test_a_linear_flight_in_moving_air_follows_its_exponential() -> None:
    """From an initial deviation, the glider follows exp(A t) with its altitude."""
    flight = hfa.fly(GLIDER, POINT, None, 1.0, initial={"alpha": 0.05, "speed": 4.0})
    whole = np.zeros((3, 3))
    whole[:2, :2] = A
    whole[0, 2], whole[2, 0] = 1e-3, 50.0
    np.testing.assert_allclose(
        flight.flight.states[-1, :3], expm(whole) @ [0.05, 4.0, 0.0], rtol=1e-8
    )
    assert "this flight has no disturbance" not in str(flight.report())
    still = hfa.fly(GLIDER, POINT, None, 0.1).report()
    assert "this flight has no disturbance" in str(still)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_gain_acts_on_the_noisy_error(order: int) -> None:
    """At the start, u = -K (x + n - x_d); the actuators of both orders begin at the trim."""
    K = np.array([[0.5, 0.01], [-2.0, 0.03], [0.1, 0.0]])
    x = np.array([0.02, -3.0, 40.0, 0.0])
    values = record(tuple(GLIDER.inputs))
    bank = ActuatorBank(
        values(*[0.1] * 3), values(*[-9.0] * 3), values(*[9.0] * 3), values(*[9e9] * 3)
    )
    scenario = Scenario(
        0.2,
        initial=x,
        reference=Waveform(REFERENCE, np.zeros(2)),
        noise=Waveform(NOISE, np.zeros(2)),
        disturbance=Waveform(np.zeros(2), np.array([0.0, 7.0])),
        actuators=replace(bank, order=order, damping=0.5) if order else None,
    )
    loop = ClosedLoop(NonlinearPlant(GLIDER, POINT), GainPolicy("K", K), scenario.on(GLIDER))
    flight = CompiledLoop(loop).fly()
    z = x[:2] - REFERENCE
    np.testing.assert_allclose(flight.errors[0], z, atol=1e-12)
    np.testing.assert_allclose(flight.errors, flight.states[:, :2] - REFERENCE, atol=1e-12)
    t, y, held = loop.symbols()
    inputs = np.zeros(held.numel())
    loop.hold(0, inputs)
    now = loop.at(t, y, held)
    signals = [now.command, now.measured, now.rate]
    evaluated = ca.Function("now", [t, y, held], signals)(2.0, loop.start(), inputs)
    command, measured, rate = (np.array(each).ravel() for each in evaluated)
    u = -K @ (z + NOISE)
    np.testing.assert_allclose(command, u)
    np.testing.assert_allclose(measured, x + np.array([*NOISE, 0.0, 0.0]))
    moved = u if order == 0 else np.zeros(3)
    expected = A @ x[:2] + B @ moved + [1e-3 * x[2], 14.0]
    np.testing.assert_allclose(rate[:2], expected)
    if order == 1:
        np.testing.assert_allclose(rate[4:], 10.0 * u)
    if order == 2:
        np.testing.assert_allclose(rate[4:], [*np.zeros(3), *(100.0 * u)])
    modes = np.linalg.eigvals(closed_matrix(order, K))
    growing = modes[modes.real > 0.0]
    np.testing.assert_allclose(np.sort(loop.growing_modes()), np.sort(growing), rtol=1e-6)


def closed_matrix(order: int, K: np.ndarray) -> np.ndarray:
    """Return the matrix of the glider with the gain K and actuators of 10 rad/s, damping .5."""
    plant = np.zeros((4, 4))
    plant[:2, :2] = A
    plant[0, 2], plant[2, 0], plant[3, 1] = 1e-3, 50.0, 1.0
    enters = np.vstack([B, np.zeros((2, 3))])
    gain = np.hstack([K, np.zeros((3, 2))])
    one, none = np.eye(3), np.zeros((3, 3))
    if order == 0:
        return plant - enters @ gain
    if order == 1:
        return np.block([[plant, enters], [-10.0 * gain, -10.0 * one]])
    return np.block(
        [
            [plant, enters, np.zeros((4, 3))],
            [np.zeros((3, 4)), none, one],
            [-100.0 * gain, -100.0 * one, -10.0 * one],
        ]
    )


def test_a_function_sees_the_noise() -> None:
    """A Python policy is called with absolute states, and the noise of the linear ones."""
    seen: list[Any] = []

    def watch(t: float, X: Any) -> dict[str, float]:
        seen.append((t, *X))
        return {"throttle": 0.6}

    scenario = Scenario(0.1, 0.01, 0.05, noise=Waveform(NOISE, np.zeros(2)))
    flight = hfa.fly(
        GLIDER, POINT, watch, scenario=scenario, initial={"altitude": 3.0}, predict=False
    )
    times, states = np.split(np.array(seen), [1], axis=1)
    assert times.ravel().tolist() == [0.0, 0.05]
    np.testing.assert_allclose(states, flight.states[[0, 5]] + np.array([*NOISE, 0.0, 0.0]))
    np.testing.assert_allclose(flight["throttle"], 0.6)
    with pytest.raises(BadInputError, match="give 3 finite numbers"):
        hfa.fly(GLIDER, POINT, lambda t, X: {"flap": math.nan}, 0.1)


@pytest.mark.parametrize(
    ("rows", "left"),
    [
        # the first row outside; of several states the largest excess relative to its range
        ([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]], ("alpha", 2.0, 0.6, 0.5)),
        ([[0.0, -60.0, 0.0], [0.5, 0.0, 0.0]], ("speed", 1.0, 40.0, 50.0)),
        ([[0.0, 0.0, 4500.0], [0.0, 0.0, 0.0]], ("altitude", 1.0, 5500.0, 5000.0)),
        ([[0.42, -60.0, -1100.0], [0.0, 0.0, 0.0]], ("speed", 1.0, 40.0, 50.0)),
        ([[-0.44, -51.0, -1100.0], [0.0, 0.0, 0.0]], ("alpha", 1.0, -0.34, -0.3)),
        ([[0.9, math.nan, 0.0], [0.0, 0.0, 0.0]], ("speed", 1.0, math.nan, 300.0)),
    ],
)
def test_the_first_and_largest_departure_is_named(
    rows: list[list[float]], left: tuple[Any, ...]
) -> None:
    limited = TRIM + np.column_stack([[[0.0] * 3, *rows], np.zeros(3)])
    found = departure(ENVELOPE, np.array([0.0, 1.0, 2.0]), limited, moving_air=False)
    assert found[:4] == pytest.approx(left, nan_ok=True)
    assert found.unit == GLIDER.unit(found.state)
    assert found.assumed == (found.state == "speed")
    moving = departure(ENVELOPE, np.array([0.0, 1.0, 2.0]), limited, moving_air=True)
    assert moving.state == {"alpha": "angle_of_attack"}.get(found.state, found.state)
    with pytest.raises(BadInputError, match=f"the initial {found.state} is"):
        refuse_start(ENVELOPE, limited[int(found.time)])


def test_no_departure_is_found_inside() -> None:
    assert departure(ENVELOPE, np.zeros(1), TRIM[None], moving_air=False) is None


def test_the_largest_excesses_of_inputs_come_first() -> None:
    """Per range: flap has no limits, elevator exceeds .4 by .1, throttle 1 by .5."""
    inputs = np.array([[0.0, 1.5, 99.0], [0.35, -0.2, -99.0], [-0.2, 0.5, 0.0]])
    found = [(e.input, e.value, e.limit) for e in control_excesses(GLIDER, inputs)]
    assert found == [("throttle", 1.5, 1.0), ("elevator", 0.35, 0.25)]
    low = [(e.input, e.value, e.limit) for e in control_excesses(GLIDER, inputs[2:])]
    assert low == [("elevator", -0.2, -0.15)]


def test_figures_are_relative_to_a_thousandth_of_the_nominal_values() -> None:
    """The least cost is that of this deviation for the duration, the least time a tick."""
    weights = np.diag([3.0, 0.01]), np.eye(3)
    flight = hfa.fly(GLIDER, POINT, None, 2.0, initial={"speed": -49.9}, weights=weights)
    figures = _figures(flight)
    assert figures["the largest deviation of speed"] == (49.9, pytest.approx(0.1))
    assert figures["the largest deviation of angle_of_attack"][1] == pytest.approx(1e-3)
    least = (3.0 * 2e-4**2 + 0.01 * 0.1**2) * 2.0
    assert figures["the cost"] == (flight.cost, pytest.approx(least))
    assert "the time of the departure" not in figures
    left = replace(flight, departure=Departure("speed", 0.7, 49.0, 50.0, "ft/s"))
    assert _figures(left)["the time of the departure"] == (0.7, 0.01)


def test_actuators_of_options_move_the_surfaces() -> None:
    """A rate in deg/s and a fault apply to inputs in rad; limits are those of the model."""
    bank = actuators_of(GLIDER, (0.1, 60.0, 2.0), (0.2, 0.5, 3.0))
    assert (bank.order, tuple(bank.lag)) == (2, (0.1, 0.1, 0.1))
    assert tuple(bank.rate) == (math.radians(60.0), math.inf, math.radians(60.0))
    assert tuple(bank.lowest) == (-0.15, 0.0, -math.inf)
    assert tuple(bank.highest) == (0.25, 1.0, math.inf)
    (fault,) = bank.faults
    assert (fault.begin, fault.effectiveness, fault.bandwidth) == (3.0, 0.2, 0.5)
    assert fault.inputs == ("elevator", "flap")
    early, late = bank.held_inputs(2.99), bank.held_inputs(3.0)
    np.testing.assert_allclose(early, [10.0] * 3 + [0.7] * 3 + [1.0] * 3)
    np.testing.assert_allclose(late, [0.5, 10.0, 0.5, *[0.7] * 3, 0.2, 1.0, 0.2])
    assert actuators_of(GLIDER, None) is None
    for typed, fault_typed, said in (
        (None, (0.2, 0.5, 3.0), "--fault requires actuators"),
        ((0.1, 0.0, 1.0), None, "rate limit of --actuators is 0 deg/s"),
        ((0.0, 60.0, 1.0), None, "the lag of elevator"),
        ((0.1, 60.0, 3.0), None, "the order of the actuators is 3"),
        ((0.1, 60.0, 1.0), (0.2, 0.5, -1.0), "the start time of a fault is -1 s"),
    ):
        with pytest.raises(BadInputError, match=said):
            actuators_of(GLIDER, typed, fault_typed)
    with pytest.raises(BadInputError, match=r"throttle is 1.5 at trim, outside the limits"):
        bank.refuse_trim(np.array([0.0, 1.5, 0.0]))


def test_gusts_of_options_pass_at_the_speed_of_the_trim() -> None:
    gust = gust_at((400.0, -5.0, 2.0), POINT, 2.1)
    assert (gust.length, gust.peak, gust.speed, gust.begin) == (400.0, -5.0, SPEED, 2.0)
    assert gust_at(None, POINT, 2.1) is None
    for begin in (-0.1, 2.1):
        with pytest.raises(BadInputError, match="outside the flight"):
            gust_at((400.0, 5.0, begin), POINT, 2.1)


def test_gusts_act_through_declared_disturbances() -> None:
    """w is down, a headwind against u; winds to north and east are turned by the heading."""

    def declared(*names: str) -> dict[str, dict[str, float]]:
        winds = {name: Signal("ft/s") for name in names}
        return own_disturbances(replace(GLIDER, disturbances=winds, equations=still), 0.3)

    def still(x: Any, u: Any, p: Any, w: Any) -> Any:
        return dict.fromkeys(GLIDER.states, 0.0 * x.alpha), {"angle_of_attack": x.alpha}

    assert declared("headwind", "updraft") == {"u": {"headwind": -1.0}, "w": {"updraft": -1.0}}
    assert declared("gust_north", "gust_east") == {
        "u": {"gust_north": math.cos(0.3), "gust_east": math.sin(0.3)},
        "v": {"gust_north": -math.sin(0.3), "gust_east": math.cos(0.3)},
    }
    assert declared("gust_north") == {}
    taken = taken_components(GLIDER, 0.0)
    assert taken == {"w": {"updraft": -1.0}}


def test_a_function_is_saturated_and_has_a_gain() -> None:
    """u = sat(pi(z)) within the limits about the trim; K is the negative slope at 0."""
    z = ca.SX.sym("z", 2)
    pi = ca.Function("pi", [z], [ca.vertcat(ca.sin(2.0 * z[0]) + z[1] ** 2, -3.0 * z[1], z[0])])
    policy = function_policy("pi", pi, POINT)
    np.testing.assert_allclose(policy.gain, [[-2.0, 0.0], [0.0, 3.0], [-1.0, 0.0]])
    for at, u in (
        ([0.03, 0.1], [math.sin(0.06) + 0.01, -0.3, 0.03]),
        ([0.5, -1.0], [0.2, 0.5, 0.5]),
        ([-0.5, 1.0], [math.sin(-1.0) + 1.0, -0.5, -0.5]),
    ):
        np.testing.assert_allclose(np.array(policy.limited(at)).ravel(), u)


def test_steps_of_inputs_begin_at_the_next_tick() -> None:
    steps = CommandSteps(
        ("flap", "elevator"), np.array([0.1, 0.21]), np.array([[1.0, 0.0], [2.0, 3.0]])
    )
    law = open_loop(steps, ("elevator", "throttle", "flap"), 0.1, 5)
    expected = [[0.0, 0.0, 0.0], *[[0.0, 0.0, 1.0]] * 2, *[[3.0, 0.0, 2.0]] * 2]
    np.testing.assert_array_equal(law.held, expected)


def test_results_of_a_flight_are_absolute_in_datasets_and_in_c() -> None:
    data = hfa.fly(GLIDER, POINT, {"elevator": [(0.0, 0.01)]}, 0.1).to_xarray()
    for name in ("alpha", "speed"):
        np.testing.assert_allclose(data[name], data[f"{name}_linear"], rtol=1e-9)
    assert float(data["speed_linear"][0]) == SPEED
    assert data["throttle"].attrs["units"] == "1"
    assert braced([1.5, [math.inf, -math.inf]]) == "{1.5, {HUGE_VAL, -HUGE_VAL}}"
    assert displaced_state(GLIDER) == ("speed", 1.0)
    tank = SimpleNamespace(states={"level": Signal("ft", nominal=5.0)}, linear=("level",))
    assert displaced_state(tank) == ("level", 0.05)


def test_members_are_counted_by_their_outcomes() -> None:
    """Six members: one leaves by alpha, two by speed, one exceeds the throttle, one oscillates.

    Quantiles are those of the members inside the envelope.
    """
    plan = MonteCarlo(
        6, 3, GLIDER, POINT, GainPolicy("none", np.zeros((3, 2))), Scenario(2.0, 0.1, 0.1), ENVELOPE
    )
    held = np.array([3, 4, 5])
    lowest = np.tile([0.0, 0.2, -9.0], (6, 1))
    highest = np.tile([0.1, 0.9, 9.0], (6, 1))
    highest[4, 1] = 1.2
    lowest[0, 0] = -0.3
    rows = np.arange(12.0).reshape(6, 2)
    results = {
        "left": np.array([0, 1, 1, -1, -1, -1]),
        "cycle": np.array([-1, -1, -1, -1, -1, 4]),
        "flown": np.array([1.5, 0.4, 0.9, 2.0, 2.0, 2.0]),
        "lowest_input": lowest,
        "highest_input": highest,
        "rms_error": rows,
        "peak_error": 2.0 * rows,
        "effort": np.arange(18.0).reshape(6, 3),
        "final": np.arange(24.0).reshape(6, 4),
        "peak_angle_of_attack": np.arange(6.0),
    }
    found = summary(plan, results.__getitem__)
    assert (found.members, found.seed, found.duration, found.law) == (6, 3, 2.0, "none")
    assert (found.held, found.within_limits, found.first_left) == (3, 1, 0.4)
    assert found.left == {"alpha": 1, "speed": 2, "altitude": 0, "distance": 0}
    assert found.exceeded == {"elevator": 1, "throttle": 1, "flap": 0}
    assert {name for name, count in found.limit_cycle.items() if count} == {"speed"}
    for name, values in (("rms_error", rows), ("peak_error", 2.0 * rows)):
        known = np.quantile(values[held], found.quantiles, axis=0)
        np.testing.assert_allclose(np.transpose(list(getattr(found, name).values())), known)
    report = member_report(plan, results.__getitem__)
    assert report.title.startswith("PASS: 1 of 6 members stayed within limits")
    for said in (
        "left the envelope (members by first state): alpha 1, speed 2; the earliest after 0.4 s",
        "exceeded control limits: elevator 1, throttle 1",
        "limit cycle that does not decay: speed 1",
    ):
        assert said in report.title
    failed = results | {"cycle": np.full(6, 4)}
    assert member_report(plan, failed.__getitem__).title.startswith("FAIL: 0 of 6")
    outside = results | {"left": np.zeros(6, dtype=int)}
    assert summary(plan, outside.__getitem__).rms_error == {"alpha": None, "speed": None}


@pytest.mark.parametrize(
    ("typed", "turbulence"),
    [
        ("light", Turbulence("light")),
        ("severe:500", Turbulence("severe", 500.0)),
        ("moderate:500:30", Turbulence("moderate", 500.0, 30.0)),
        ("karman-light::30", Turbulence("light", None, 30.0, "karman")),
        ("dryden-light:500", Turbulence("light", 500.0)),
        ("own:2:300", Turbulence((2.0, 300.0))),
        ("karman-own:2:300:30", Turbulence((2.0, 300.0), None, 30.0, "karman")),
    ],
)
def test_turbulence_is_typed_in_words_and_numbers(typed: str, turbulence: Turbulence) -> None:
    assert _turbulence(typed) == turbulence
    held = at_held_altitude(_turbulence(typed), {"altitude": 77.0})
    is_open = typed in ("light", "karman-light::30")
    assert held == (replace(turbulence, altitude=77.0) if is_open else turbulence)


@pytest.mark.parametrize("typed", ["own:2", "own:2:300:30:4", "light:1:2:3", "odd-light", "calm:5"])
def test_other_turbulence_is_refused(typed: str) -> None:
    with pytest.raises(BadInputError, match="give LEVEL"):
        _turbulence(typed)


def test_a_title_names_decay_cycle_and_integration_error() -> None:
    flight = hfa.fly(GLIDER, POINT, None, 0.2, initial={"speed": 1.0}, predict=False)
    assert flight.title().startswith("PASS: 0.2 s inside the envelope and the control limits\n")
    at_rest = hfa.fly(GLIDER, POINT, None, 0.2, predict=False)
    assert "nothing moved it" in at_rest.title().splitlines()[0]
    decay = replace(flight, decay=Decay("alpha", 20.0, 4.0))
    assert "alpha oscillates at 4 rad/s and decays: half in 20 s" in decay.title()
    assert (decay.ok, decay.held) == (True, True)
    cycle = replace(flight, cycle=LimitCycle("alpha", math.radians(2.0), 5.0, "rad"))
    assert cycle.title().startswith("FAIL: limit cycle: alpha ±2 deg at 5 rad/s; the flight has")
    assert (cycle.ok, cycle.held) == (False, False)
    coarse = replace(flight, integration=IntegrationError(0.1, 0.5, "the cost"))
    assert "Not resolved: with half the integration step of 100 ms" in coarse.title()
    assert "Not resolved" not in flight.title()
    axes = flight.plot("alpha", "speed")
    assert [each.get_ylabel() for each in axes] == ["alpha, deg", "speed, ft/s"]
    pyplot.close()
    assert flight.to_pandas().index[-1] == pytest.approx(0.2)


def test_an_angle_of_attack_that_depends_on_an_input_is_refused() -> None:
    model = replace(
        GLIDER,
        equations=lambda x, u, p, w: (glide(x, u, p, w)[0], {"angle_of_attack": x.alpha + u.flap}),
    )
    point = hfa.trim(model)
    air = {"updraft": Waveform(np.zeros(1), np.zeros(1))}
    with pytest.raises(BadInputError, match="angle_of_attack depends on an input"):
        hfa.fly(model, point, None, scenario=Scenario(1.0, air=air))
    assert hfa.fly(model, point, None, 0.1, predict=False).departure is None


def test_initial_boxes_are_nominal_or_a_tenth_or_half_the_room() -> None:
    """alpha: its nominal value, but at most half of .4 to its limit. speed: 10 % of 100 ft/s."""
    assert start_box(GLIDER, POINT).tolist() == [pytest.approx(0.2), pytest.approx(10.0)]
    low = replace(POINT, states=POINT.states._replace(alpha=0.4, speed=49.0))
    assert start_box(GLIDER, low).tolist() == [pytest.approx(0.05), 0.0]
    slow = replace(GLIDER, states={**GLIDER.states, "speed": Signal("ft/s", nominal=300.0)})
    assert start_box(slow, POINT)[1] == 300.0


def test_a_problem_has_the_limits_and_rates_of_its_aircraft() -> None:
    """Without the flap, the problem has two inputs; alpha depends on the altitude."""
    problem = flight_problem(
        GLIDER, POINT, inputs=("throttle", "elevator"), limits={"alpha": (-0.1, 0.4)}
    )
    assert (problem.carried, problem.followed) == (("altitude",), ("alpha", "speed", "altitude"))
    assert problem.inputs == ("throttle", "elevator")
    low, high = problem.input_limits
    np.testing.assert_allclose([low, high], [[-0.5, -0.2], [0.5, 0.2]])
    low, high = problem.state_limits
    np.testing.assert_allclose([low, high], [[-0.2, -50.0, -1000.0], [0.3, 200.0, 4000.0]])
    inner = problem.inner_limits(np.array([0.3, -50.0, 0.0]), 0.1)
    np.testing.assert_allclose(inner, [[-0.18, -50.0, -900.0], [0.3, 180.0, 3600.0]])
    np.testing.assert_array_equal(problem.padded(np.ones((2, 2))), [[1.0, 1.0, 0.0]] * 2)
    scaled = np.array(problem.rates([0.5, 0.1, 0.02, 0.4, -0.3])).ravel()
    a, v, h, t, e = 0.1, 10.0, 20.0, 0.2, -0.03
    rates = [-2 * a + 3 * e + 1e-3 * h, -10 * a - 0.5 * v + 20 * t, 50 * a]
    np.testing.assert_allclose(scaled, np.array(rates) / [0.2, 100.0, 1000.0], rtol=1e-12)
    Q, R, P = problem.scaled_weights()
    np.testing.assert_allclose(Q, np.diag([1.0, 1.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(R, np.eye(2))
    size = np.array([0.2, 100.0])
    np.testing.assert_allclose(P[:2, :2], size[:, None] * problem.P * size)
    game = hfa.Game(A, B[:, [1, 0]], np.eye(2), problem.Q, problem.R, math.inf)
    np.testing.assert_allclose(problem.K, hfa.solve(game).K, rtol=1e-6)
    assert problem.deviations({"speed": 4.0}).tolist() == [0.0, 4.0]
    faster = replace(POINT, states=POINT.states._replace(speed=120.0))
    assert problem.deviations(faster).tolist() == [0.0, 20.0]
    higher = replace(POINT, states=POINT.states._replace(altitude=1001.0))
    for start, said in (
        ({}, "equals the final trim"),
        ({"alpha": math.nan}, "the initial deviation of alpha is nan"),
        ({"beta": 0.1}, "no initial deviation of"),
        ({"alpha": 0.31}, "alpha begins at"),
        ({"speed": -51.0}, "speed begins at"),
        (higher, "the two trims differ in altitude"),
    ):
        with pytest.raises(BadInputError, match=said):
            problem.deviations(start)


@pytest.mark.parametrize(
    ("modes", "seconds"),
    [
        ([], 0.0),
        ([1 / 301], 0.0),
        ([0.1], 100.0),
        ([0.09], 120.0),  # 111.1 s
        ([0.05 + 2.0j, 0.05 - 2.0j], 200.0),
        ([1.0 + 0.5j], 210.0),  # 32 pi / .5 = 201 s
        ([1.0, 0.1], 100.0),
        ([0.004], 300.0),
        ([0.5 + 1e-3j], 300.0),
    ],
)
def test_growing_modes_fly_until_their_cycle_is_seen(modes: list[complex], seconds: float) -> None:
    """Ten time constants, and eight quarters of four half-periods, in multiples of 10 s."""
    assert duration_for(np.array(modes, dtype=complex)) == seconds


def test_the_largest_lasting_oscillation_is_found() -> None:
    """Of two variables, the larger relative to its nominal size; a cycle before a larger decay."""
    t = np.arange(0.0, 20.005, 0.01)
    sine = np.sin(4.0 * t)
    decaying = np.exp(-0.004 * t) * np.sin(5.0 * t)

    def found(until: float = 0.0, **columns: np.ndarray) -> LimitCycle | Decay | None:
        names = [*GLIDER.inputs, *GLIDER.states]
        signals = np.column_stack([columns.get(name, np.zeros(len(t))) for name in names])
        inputs, states = signals[:, :3], signals[:, 3:]
        flight = Deviations(t, states, states, inputs, states[:, :0], states, {})
        return oscillation(GLIDER, flight, until)

    cycle = found(alpha=0.01 * sine, speed=4.0 * sine)
    assert (cycle.name, cycle.unit) == ("alpha", "rad")
    assert cycle[1:3] == pytest.approx((0.01, 4.0), rel=1e-3)
    assert found(alpha=0.01 * sine, speed=6.0 * sine).name == "speed"
    assert found(alpha=0.01 * sine, speed=60.0 * decaying).name == "alpha"
    decay = found(elevator=0.3 - 0.02 * t + 0.01 * decaying, speed=6.0 * decaying)
    assert decay.name == "elevator"
    assert decay[1:] == pytest.approx((math.log(2.0) / 0.004, 5.0), rel=1e-2)
    drifting = found(alpha=0.2 - 0.03 * t + 0.01 * sine)
    assert drifting[1:3] == pytest.approx((0.01, 4.0), rel=1e-3)
    assert found(alpha=0.0019 * sine) is None
    assert isinstance(found(10.0, alpha=0.0021 * sine), LimitCycle)
    assert found(10.1, alpha=0.1 * sine) is None
    late = found(alpha=np.where(t < 10.0, 5.0, 1.0) * 0.01 * sine)
    assert late[:2] == ("alpha", pytest.approx(0.01, rel=1e-3))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: ClosedLoop(LinearPlant(A, B), GainPolicy("K", np.zeros((3, 4)))), "give 3 x 2"),
        (
            lambda: ClosedLoop(
                LinearPlant(A, B),
                GainPolicy("K", np.zeros((3, 2))),
                Scenario(reference=Waveform(np.zeros(3), np.zeros(3))),
            ),
            "the reference has 3 channels; give 2",
        ),
        (
            lambda: CompiledLoop(
                ClosedLoop(
                    LinearPlant(A, B),
                    GainPolicy("K", np.zeros((3, 2))),
                    Scenario(initial=np.ones(3)),
                )
            ).fly(),
            "the initial state has 3 elements; give 2",
        ),
        (lambda: Scenario(initial=np.ones(3)).on(GLIDER), r"initial has shape \(3,\); give 4"),
        (lambda: Scenario(delay=math.inf), "delay is inf s"),
        (lambda: Scenario(delay=-0.01), "delay is -0.01 s"),
        (lambda: Scenario(gust=5.0), "gust is 5.0; give a gust"),
        (lambda: Scenario(duration=-1.0), "duration"),
        (lambda: Scenario(errors={"mass": 0.0}), "the factor on mass"),
        (lambda: Scenario(errors={"mass": 1.1}).on(GLIDER), "unknown parameter 'mass'"),
        (lambda: CommandSteps(("a",), np.array([-0.1]), np.ones((1, 1))), "from 0 s or later"),
        (lambda: CommandSteps(("a",), np.array([1.0, 2.0, 2.0]), np.ones((3, 1))), "increase"),
        (
            lambda: CommandSteps(("a", "b"), np.array([1.0]), np.array([[math.nan, 1.0]])),
            "give 1 rows of 2 finite numbers",
        ),
        (lambda: OneMinusCosine(400.0, math.nan, 100.0), "give finite numbers"),
        (lambda: OneMinusCosine(400.0, 5.0, 100.0, math.inf), "give finite numbers"),
        (lambda: GainPolicy("K", np.array([[1.0, math.nan]])), "a matrix of finite numbers"),
        (lambda: _command(GLIDER, "flap", "1:2,2:3,1.5:4"), "give increasing times"),
        (lambda: _command(GLIDER, "flap", "-1:2,2:3"), "give increasing times"),
        (lambda: _command(GLIDER, "flap", "1:2,3"), "give NAME=TIME:VALUE"),
        (lambda: hfa.fly(GLIDER, POINT, {"flap": lambda t: t}, 1.0), "given as a function"),
        (
            lambda: hfa.fly(GLIDER, POINT, {"flap": [(0, 1), (2, 1), (1, 1)]}, 1.0),
            "give increasing times",
        ),
        (lambda: hfa.fly(GLIDER, POINT, {"flap": [(-0.5, 1.0)]}, 1.0), "give increasing times"),
        (lambda: flight_problem(GLIDER, POINT, inputs=("rudder",)), "there is no input"),
        (lambda: NonlinearPlant(replace(GLIDER, name="other"), POINT), "other"),
    ],
)
def test_what_does_not_fit_the_aircraft_is_refused(make: Any, said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        make()


def test_a_gust_needs_the_speed_of_the_trim() -> None:
    assert gust_speed(POINT) == SPEED
    of_output = replace(
        GLIDER,
        states={name: each for name, each in GLIDER.states.items() if name == "distance"},
        equations=lambda x, u, p, w: ({"distance": 0.0 * x.distance}, {"speed": 7.0 + x.distance}),
        outputs={"speed": Signal("ft/s")},
        trim={"distance": 2.0},
        steady=("distance",),
        linear=("distance",),
        modes={},
    )
    point = SimpleNamespace(model=of_output, values={}, states=[2.0], inputs=[0.0] * 3)
    assert gust_speed(point) == 9.0
    with pytest.raises(BadInputError, match="no state or output named speed"):
        gust_speed(
            SimpleNamespace(
                model=replace(
                    of_output,
                    outputs={},
                    equations=lambda x, u, p, w: ({"distance": 0.0 * x.distance}, {}),
                )
            )
        )


def test_limits_of_an_envelope_are_those_of_the_states_or_changed() -> None:
    assert limits_text(-math.inf, math.inf, "rad") == "none"
    assert limits_text(-math.inf, math.radians(20.0), "rad", True) == "-inf to 20, assumed"
    changed = flight_envelope(GLIDER, POINT, {"angle_of_attack": (0.0, 0.2), "speed": (60, 200)})
    assert changed.lowest.tolist() == [0.0, 60.0, 0.0, -math.inf]
    assert changed.highest.tolist() == [0.2, 200.0, 5000.0, math.inf]
    assert isinstance(changed, Limits)
