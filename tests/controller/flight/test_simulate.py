"""Flights of the nonlinear aircraft: right to second order, right to the integrator, clear about where they end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from controller.flight.actuators import Actuators
from controller.flight.envelope import Envelope, flight_envelope
from controller.flight.gain_plan import GainPlan, baseline_gain, frozen_plan, learned_value, online_plan
from controller.flight.gusts import Dryden, OneMinusCosine
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.signals import Harmonic, Signal
from controller.flight.simulate import NonlinearFlight, Scenario, fly, loop_of
from controller.flight.trials import TrialLoop
from controller.game.zero_sum import Game, published_game
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError, NoSolutionError
from hfa_model.vectors import LINEAR_STATES, STATES, Input
from trim.linear.linearize import linearize
from trim.point.condition import CONTROL_LIMITS, level_flight
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point
from verification.flights.agreement import (
    INTEGRATION,
    adaptive_states,
    agreement_checks,
    deviation_study,
    integration_checks,
)
from verification.flights.recoverable import RecoverableMap, recoverable_map
from verification.riccati.gare import solve_game

N = len(LINEAR_STATES)
SMALL = np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02])


@dataclass(frozen=True, eq=False)
class Case:
    """One trim with its game, exact gain and envelope."""

    aircraft: Aircraft
    point: OperatingPoint
    game: Game
    plan: GainPlan
    envelope: Envelope


def case(parameters: Parameters, dynamics: str, degrees: float) -> Case:
    aircraft = Aircraft(parameters, dynamics)
    point = find_operating_point(aircraft, level_flight(float(np.radians(degrees))))
    model = linearize(aircraft, point)
    game = published_game(model.A, model.B)
    plan = GainPlan("exact", solve_game(game).K[None])
    return Case(aircraft, point, game, plan, flight_envelope(parameters, point))


@pytest.fixture(scope="module", params=["published", "newton"])
def at_15(request: pytest.FixtureRequest, parameters: Parameters) -> Case:
    return case(parameters, request.param, 15.0)


@pytest.fixture(scope="module")
def newton(parameters: Parameters) -> Case:
    return case(parameters, "newton", 15.0)


def flown(on: Case, scenario: Scenario) -> NonlinearFlight:
    return fly(on.aircraft, on.point, on.plan, scenario, on.envelope)


def signal(**values: float) -> Signal:
    return Signal(np.array([values.get(name, 0.0) for name in LINEAR_STATES]), np.zeros(N))


# Second order.


def test_the_linear_prediction_is_wrong_to_second_order_only(at_15: Case) -> None:
    study = deviation_study(at_15.aircraft, at_15.point, at_15.plan, duration=2.0)
    assert np.all((study.slopes > 1.9) & (study.slopes < 2.1)), study.slopes
    assert all(check.ok for check in study.checks())
    assert study.errors[0].max() < 1e-4


def test_a_prediction_for_another_dihedral_is_wrong_to_first_order(newton: Case) -> None:
    other = find_operating_point(newton.aircraft, level_flight(float(np.radians(15.5))))
    wrong = LinearizedAircraft.at(newton.aircraft, other)
    study = deviation_study(newton.aircraft, newton.point, newton.plan, model=wrong, duration=2.0)
    failed = {check.name for check in study.checks() if not check.ok}
    assert failed >= {f"slope_{name}_at_least" for name in ("alpha", "pitch", "pitch_rate", "dihedral")}
    assert study.slopes[STATES.index("pitch_rate")] == pytest.approx(1.0, abs=0.15)


def test_the_linearized_aircraft_is_the_derivative_of_the_nonlinear_one(at_15: Case) -> None:
    full = linearize(at_15.aircraft, at_15.point, full=True)
    model = LinearizedAircraft.at(at_15.aircraft, at_15.point)
    np.testing.assert_allclose(model.A, full.A, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(model.B, full.B, rtol=1e-13, atol=1e-13)
    plant = NonlinearPlant(at_15.aircraft, at_15.point)
    rise = 1e-3
    up, down = (np.array(plant.rate(np.zeros(7), np.zeros(5), np.zeros(N), w)).ravel() for w in (rise, -rise))
    np.testing.assert_allclose((up - down) / (2 * rise), model.gust, rtol=1e-6, atol=1e-9)


# The integrator.


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


SCENARIOS = {
    "released": Scenario(duration=3.0, initial=SMALL),
    "gust": Scenario(duration=5.0, gust=OneMinusCosine(200.0, 4.0, 68.0, 0.5)),
    "wrong parameters": Scenario(duration=3.0, errors={"panel_mass": 1.05, "lift_slope": 0.95}),
    "everything": one_flight_of_everything(),
}


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_the_fixed_step_agrees_with_an_adaptive_integrator(at_15: Case, scenario: Scenario) -> None:
    result = flown(at_15, scenario)
    assert result.departure is None
    loop = loop_of(at_15.aircraft, at_15.point, scenario)
    adaptive = adaptive_states(loop, scenario.initial, at_15.plan.constants, tick=scenario.tick, ticks=scenario.ticks)
    fixed = result.flight.states[:: scenario.steps_per_tick]
    checks = integration_checks(fixed, adaptive)
    assert [check.name for check in checks if not check.ok] == []
    # The check can fail: the same flight with one state off by twice what is allowed.
    off = adaptive + 2 * INTEGRATION * np.abs(adaptive).max(axis=0) * (np.arange(len(STATES)) == 3)
    assert [check.name for check in integration_checks(off, adaptive) if not check.ok] == ["integration_pitch"]


def test_a_step_that_is_too_long_fails_the_check(newton: Case) -> None:
    scenario = Scenario(duration=1.0, step=0.01, initial=SMALL)
    checks = agreement_checks(newton.aircraft, newton.plan, scenario, flown(newton, scenario))
    failed = {check.name for check in checks if not check.ok}
    assert "integration_pitch_rate" in failed
    assert not any(name.startswith("slope") for name in failed)


def test_the_same_flight_twice_gives_the_same_bits(newton: Case) -> None:
    one, two = (flown(newton, one_flight_of_everything(0.5)) for _ in range(2))
    for name in ("times", "states", "errors", "inputs", "memory", "updrafts"):
        assert np.array_equal(getattr(one.flight, name), getattr(two.flight, name)), name
    assert np.any(one.flight.updrafts != 0.0)
    assert one.predicted is not None
    assert np.any(one.flight.states != one.predicted.states)


# What a scenario does.


def test_at_rest_nothing_moves(at_15: Case) -> None:
    result = flown(at_15, Scenario(duration=0.5))
    assert result.departure is None
    assert np.abs(result.flight.states).max() < 1e-10


def test_altitude_is_flown_and_an_updraft_lifts(newton: Case) -> None:
    result = flown(newton, Scenario(duration=8.0, gust=OneMinusCosine(200.0, 4.0, 68.0)))
    gained = result.states[-1, STATES.index("altitude")] - newton.point.states.altitude
    # The air rises 4/2 ft/s on average for 200/68 s; the aircraft, held in pitch, goes with it.
    assert gained == pytest.approx(2.0 * 200.0 / 68.0, rel=0.05)


def test_errors_are_those_of_the_flown_aircraft_alone(newton: Case) -> None:
    """The heavier aircraft is out of trim and sinks; the prediction, of the design, stays."""
    result = flown(newton, Scenario(duration=2.0, errors={"panel_mass": 1.05}))
    assert result.predicted is not None
    assert np.abs(result.predicted.states).max() < 1e-12
    assert result.flight.states[-1, STATES.index("altitude")] < -0.01


def test_the_measured_error_has_noise_and_the_flown_one_has_none(newton: Case) -> None:
    result = flown(newton, Scenario(duration=0.1, noise=signal(speed=0.01)))
    np.testing.assert_array_equal(result.flight.errors[0], np.zeros(N))
    gain = newton.plan.gains[0]
    np.testing.assert_allclose(result.flight.inputs[0], -gain[:, 0] * 0.01, rtol=1e-12)


# Where it ends.


def test_a_flight_ends_where_its_first_state_leaves(newton: Case) -> None:
    result = flown(newton, Scenario(initial=SMALL * np.array([10.0, 1, 1, 1, 1, 1, 1])))
    departure = result.departure
    assert departure is not None
    assert departure.state == "pitch_rate"
    before = result.flight.times < departure.time
    assert newton.envelope.inside(result.states[before]).all()
    row = int(np.argmin(before))
    assert result.states[row, STATES.index("pitch_rate")] == departure.value
    assert abs(departure.value) > abs(departure.limit)
    assert result.flight.times[-1] < departure.time + 0.02


@pytest.mark.parametrize("name", STATES)
def test_each_state_can_be_the_first(newton: Case, name: str) -> None:
    """A planted path that leaves in one state, and later in another: the first one is named."""
    index, later = STATES.index(name), (STATES.index(name) + 1) % len(STATES)
    middle = (np.array(newton.envelope.lowest) + np.array(newton.envelope.highest)) / 2
    path = np.tile(middle, (10, 1))
    path[4:, index] = newton.envelope.highest[index] * 1.01 + 1e-3
    path[6:, later] = np.nan
    departure = newton.envelope.departure(0.1 * np.arange(10), path)
    assert departure is not None
    assert (departure.state, departure.limit) == (name, newton.envelope.highest[index])
    assert departure.time == pytest.approx(0.4)
    assert newton.envelope.departure(np.arange(4.0), path[:4]) is None


def test_the_envelope_can_be_changed_and_must_hold_the_trim(newton: Case) -> None:
    p, point = newton.aircraft.parameters, newton.point
    narrow = flight_envelope(p, point, {"dihedral": (0.2, 0.3)})
    assert (narrow.lowest.dihedral, narrow.highest.dihedral) == (0.2, 0.3)
    assert narrow.highest.alpha == newton.envelope.highest.alpha
    with pytest.raises(BadInputError, match="no state 'roll'"):
        flight_envelope(p, point, {"roll": (0.0, 1.0)})
    with pytest.raises(BadInputError, match=r"has dihedral 15 deg, outside the envelope's 0 deg to 5\.72958 deg"):
        flight_envelope(p, point, {"dihedral": (0.0, 0.1)})


# Learning.


def test_a_frozen_learned_gain_is_the_exact_one(newton: Case) -> None:
    plan = frozen_plan("certified", learned_value(newton.game, "certified", 0))
    assert not plan.online
    np.testing.assert_allclose(plan.gains[0], newton.plan.gains[0], rtol=1e-8, atol=1e-10)


def test_learning_in_flight_flies_the_baseline_then_certified_gains_and_knows_nothing_of_the_future(
    newton: Case,
) -> None:
    learned = learned_value(newton.game, "certified", 0, predefined_time=2.0)
    plan = online_plan(newton.game, "certified", learned, 0.01)
    assert 0.0 < plan.certified_from < 2.0
    first = round(plan.certified_from / 0.01)
    baseline = baseline_gain(newton.game)
    assert all(np.array_equal(gain, baseline) for gain in plan.gains[:first])
    assert not np.array_equal(plan.gains[first], baseline)
    for gain in plan.gains:
        assert np.linalg.eigvals(newton.game.A - newton.game.B @ gain).real.max() < 0.0
    np.testing.assert_array_equal(plan.gains[-1], learned.K)
    cut = replace(learned, times=learned.times[:120], weights=learned.weights[:120])
    assert np.array_equal(online_plan(newton.game, "certified", cut, 0.01).gains[:119], plan.gains[:119])
    result = fly(newton.aircraft, newton.point, plan, Scenario(duration=3.0, initial=0.5 * SMALL), newton.envelope)
    assert result.departure is None
    np.testing.assert_allclose(result.flight.inputs[0], -baseline @ result.flight.errors[0], rtol=1e-12)


def test_the_integral_law_flies_from_the_baseline(newton: Case) -> None:
    """At 15 degrees the aircraft alone is unstable: the law starts from the policy that keeps it flying."""
    plan = frozen_plan("irl", learned_value(newton.game, "irl", 0))
    np.testing.assert_allclose(plan.gains[0], newton.plan.gains[0], rtol=1e-4, atol=1e-5)
    with pytest.raises(NoSolutionError, match="not certified here"):
        learned_value(newton.game, "irl", 0, iterations=1)


def test_a_plant_that_no_input_moves_has_no_baseline() -> None:
    game = Game(np.eye(2), np.zeros((2, 1)), np.eye(2), np.eye(2), np.eye(1), 10.0)
    with pytest.raises(NoSolutionError, match="no baseline gain"):
        baseline_gain(game)


# The recoverable set.


@pytest.fixture(scope="module")
def recoverable(newton: Case) -> RecoverableMap:
    return recoverable_map(
        newton.aircraft,
        newton.point,
        newton.plan.gains[0],
        newton.envelope,
        speeds=np.array([-2.0, 0.0, 0.3, 2.0]),
        dihedrals=np.radians([-10.0, 0.0, 10.0]),
        commands=np.radians([-30.0, -5.0, 0.0, 5.0]),
    )


def test_the_map_is_what_single_flights_say(newton: Case, recoverable: RecoverableMap) -> None:
    """The compiled trials, at their longer step, against `fly`: who leaves, what leaves, and when."""
    left, held = recoverable.left("nonlinear"), recoverable.held("nonlinear")
    for i, dihedral in enumerate(recoverable.dihedrals):
        for j, speed in enumerate(recoverable.speeds):
            start = np.zeros(len(STATES))
            start[STATES.index("speed")], start[STATES.index("dihedral")] = speed, dihedral
            departure = flown(newton, Scenario(duration=3.0, initial=start)).departure
            assert (departure is None) == (left[i, j] == -1)
            assert held[i, j] == (departure is None)
            if departure is not None:
                assert STATES[left[i, j]] == departure.state
    assert held.any()
    assert not held.all()


def test_the_edges_are_where_flights_begin_to_leave(newton: Case, recoverable: RecoverableMap) -> None:
    edges = {(edge.plant, edge.axis, edge.sign): edge for edge in recoverable.edges}
    for sign in (-1, 1):
        edge = edges["nonlinear", "speed", sign]
        for part, stays in ((0.97, True), (1.03, False)):
            start = np.zeros(len(STATES))
            start[0] = sign * part * edge.held
            departure = flown(newton, Scenario(duration=2.0, initial=start)).departure
            assert (departure is None) == stays
            assert stays or (departure is not None and departure.state == edge.state)
        assert edge.returned > edge.held
        command = edges["nonlinear", "dihedral command", sign]
        scenario = Scenario(duration=2.0, reference=signal(dihedral=0.97 * sign * command.held))
        assert flown(newton, scenario).departure is None


def test_the_linear_model_recovers_from_everywhere_and_alike_on_both_sides(recoverable: RecoverableMap) -> None:
    assert recoverable.returned("linear").all()
    assert not recoverable.returned("nonlinear").all()
    linear = {(edge.axis, edge.sign): edge.held for edge in recoverable.edges if edge.plant == "linear"}
    nonlinear = {(edge.axis, edge.sign): edge.held for edge in recoverable.edges if edge.plant == "nonlinear"}
    for axis in ("speed", "dihedral", "dihedral command"):
        assert linear[axis, 1] == pytest.approx(linear[axis, -1], rel=1e-6)
    assert nonlinear["speed", 1] > 1.5 * nonlinear["speed", -1]


def test_commands_arrive_or_not(recoverable: RecoverableMap) -> None:
    trials = recoverable.nonlinear_commands
    assert trials.arrived(recoverable.commands).tolist() == [False, True, True, True]
    assert trials.held.tolist() == [False, True, True, True]
    # At rest elsewhere is not arrived: a planted end on the other side of trim.
    final = trials.final.copy()
    final[1, STATES.index("dihedral")] *= -1
    assert replace(trials, final=final).arrived(recoverable.commands).tolist() == [False, False, True, True]


def test_machine_code_says_what_the_virtual_machine_says(newton: Case) -> None:
    plant = NonlinearPlant(newton.aircraft, newton.point)
    starts = np.zeros((3, len(STATES)))
    starts[:, 0] = (0.3, 1.0, -3.0)
    found = [
        TrialLoop(plant, newton.point, newton.envelope, compile_code=compile_code).fly(
            newton.plan.gains[0], starts, np.zeros((3, N)), 2.0
        )
        for compile_code in (True, False)
    ]
    assert (
        found[0].left.tolist() == found[1].left.tolist() == [-1, STATES.index("pitch_rate"), STATES.index("pitch_rate")]
    )
    np.testing.assert_allclose(found[0].when, found[1].when)
    np.testing.assert_allclose(found[0].final[:2], found[1].final[:2], rtol=1e-6, atol=1e-9)


def test_maps_without_points_and_gains_that_do_not_stabilize_are_refused(newton: Case) -> None:
    ranges = {"speeds": np.zeros(1), "dihedrals": np.zeros(1), "commands": np.zeros(1)}

    def build(gain: np.ndarray, **changes: np.ndarray) -> RecoverableMap:
        given: dict[str, Any] = ranges | changes
        return recoverable_map(newton.aircraft, newton.point, gain, newton.envelope, **given)

    with pytest.raises(BadInputError, match="speeds are empty"):
        build(newton.plan.gains[0], speeds=np.zeros(0))
    with pytest.raises(BadInputError, match="at most 50000"):
        build(newton.plan.gains[0], speeds=np.zeros(1000), dihedrals=np.zeros(1000))
    with pytest.raises(BadInputError, match="abscissa"):
        build(-newton.plan.gains[0])


# Refusals.


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"step": 0.0}, "step is 0.0"),
        ({"step": 0.003}, "whole number of steps"),
        ({"duration": 1.005}, "whole number of ticks"),
        ({"duration": np.inf}, "duration is inf"),
        ({"errors": {"span": 0.9}}, "unknown parameter 'span'"),
        ({"errors": {"lift_slope": 0.0}}, "factor of 0.0"),
    ],
)
def test_scenarios_that_cannot_be_flown_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        Scenario(**change)
