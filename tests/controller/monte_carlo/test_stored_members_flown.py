"""A member of a Monte Carlo is the flight that it claims to be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from member_plans import PARAMETERS, with_scenario

from controller import Actuators, MonteCarlo, OneMinusCosine, Scenario, Uncertainty, flight_envelope, fly, gain_law
from controller.flight import watched_loop
from controller.flight.closed_loop import ClosedLoop, CompiledLoop
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.monte_carlo import stored_members
from controller.monte_carlo.stored_members import fly_member, fly_members
from controller.policy.signals import zero
from hfa_model import LINEAR_STATES, STATES, Aircraft, Input, Parameters, State
from hfa_model.dynamics import rates
from hfa_model.variants import variant_named
from hfa_support import BadInputError
from hfa_support.native import machine_code as generated
from studies.section5.critic_policy import CriticPolicy, critic_law
from trim import CONTROL_LIMITS, find_operating_point, level_flight

ALPHA = STATES.index("alpha")
SEEN = [STATES.index(name) for name in LINEAR_STATES]
Rate = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]
RateOf = Callable[[MonteCarlo, Scenario], Rate]


def nonlinear_rate(plan: MonteCarlo, member: Scenario) -> Rate:
    """x' by the equations of motion in plain numbers, without any compiled function."""
    X0, U0 = np.array(plan.point.states), np.array(plan.point.inputs)
    p, variant = Parameters(*plan.parameters_of(member).tolist()), variant_named(plan.dynamics)

    def rate(x: np.ndarray, u: np.ndarray, d: np.ndarray, w: float) -> np.ndarray:
        value = np.array([float(row) for row in rates(State(*(X0 + x)), Input(*(U0 + u)), p, variant, w)])
        value[SEEN] += d
        return value

    return rate


def linear_rate(plan: MonteCarlo, member: Scenario) -> Rate:
    """f0 + A x + B u + b w + d of the aircraft that is flown, about the trim of the nominal one."""
    wrong = Aircraft(Parameters(*plan.parameters_of(member).tolist()), plan.dynamics)
    model = LinearizedAircraft.at(wrong, plan.point)
    offset = wrong.rates(np.array(plan.point.states), np.array(plan.point.inputs))

    def rate(x: np.ndarray, u: np.ndarray, d: np.ndarray, w: float) -> np.ndarray:
        value = offset + model.A @ x + model.B @ u + model.gust * w
        value[SEEN] += d
        return value

    return rate


def flown_plainly(plan: MonteCarlo, member: Scenario, rate_of: RateOf) -> Mapping[str, object]:
    """The summary of a member under u = -K z, by a Runge-Kutta loop in NumPy on the history of every step."""
    assert member.samples is not None
    h, lowest, highest = member.step, np.array(plan.envelope.lowest), np.array(plan.envelope.highest)
    K, rate, air = plan.law.gains[0], rate_of(plan, member), member.gust
    x, filter_ = member.initial.copy(), np.zeros(0) if air is None else air.start()
    errors, inputs, angles, left, flown = [], [], [], -1, member.duration

    def slope(t: float, x: np.ndarray, f: np.ndarray, tick: int) -> tuple[np.ndarray, np.ndarray]:
        z = x[SEEN] - member.reference.at(t)
        u = -K @ (z + member.samples[tick])
        w, filter_rate = 0.0, np.zeros(0)
        if air is not None:
            held = air.constants(tick)
            w = float(air.updraft(t, f, held))
            filter_rate = np.array(air.memory_rate(t, f, held)).ravel() if len(f) else f
        return rate(x, u, member.disturbance.at(t), w), filter_rate

    def limited(t: float, x: np.ndarray, f: np.ndarray, tick: int) -> np.ndarray:
        """X with the angle of attack through the air, from the velocity of the air in north and down, for alpha."""
        X = State(*(x + np.array(plan.point.states)))
        w = 0.0 if air is None else float(air.updraft(t, f, air.constants(tick)))
        path = X.pitch - X.alpha
        north, down = X.speed * np.cos(path), w - X.speed * np.sin(path)
        return np.array(X._replace(alpha=X.pitch + np.arctan2(down, north)))

    for step in range(member.ticks * member.steps_per_tick):
        t, tick = step * h, step // member.steps_per_tick
        z = x[SEEN] - member.reference.at(t)
        errors.append(z)
        inputs.append(-K @ (z + member.samples[tick]))
        angles.append(limited(t, x, filter_, tick)[ALPHA] - plan.point.states.alpha)
        k1 = slope(t, x, filter_, tick)
        k2 = slope(t + h / 2, x + h / 2 * k1[0], filter_ + h / 2 * k1[1], tick)
        k3 = slope(t + h / 2, x + h / 2 * k2[0], filter_ + h / 2 * k2[1], tick)
        k4 = slope(t + h, x + h * k3[0], filter_ + h * k3[1], tick)
        x = x + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        filter_ = filter_ + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        X = limited(t + h, x, filter_, tick)
        outside = np.maximum(X - highest, lowest - X) / (highest - lowest)
        if outside.max() > 0.0:
            left, flown = int(np.argmax(outside)), t + h
            break
    return {
        "left": left,
        "flown": flown,
        "rms_error": np.sqrt(np.mean(np.square(errors), axis=0)),
        "peak_error": np.max(np.abs(errors), axis=0),
        "peak_angle_of_attack": np.max(np.abs(angles)),
        "effort": np.sqrt(np.mean(np.square(inputs), axis=0)),
        "final": x + np.array(plan.point.states),
    }


def assert_same_flight(plan: MonteCarlo, member: int, rate_of: RateOf) -> None:
    scenario, summary = fly_member(plan, member)
    found = summary._asdict() | {"final": summary.final + np.array(plan.point.states)}
    for name, value in flown_plainly(plan, scenario, rate_of).items():
        np.testing.assert_allclose(found[name], value, rtol=1e-8, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize(("plant", "rate_of"), [("nonlinear", nonlinear_rate), ("linear", linear_rate)])
def test_a_member_is_its_flight_step_by_step(plan: MonteCarlo, dynamics: str, plant: str, rate_of) -> None:
    point = find_operating_point(Aircraft(PARAMETERS, dynamics), level_flight(plan.point.states.dihedral))
    flown = replace(plan, dynamics=dynamics, plant=plant, point=point)
    assert_same_flight(with_scenario(flown, duration=0.05), 3, rate_of)


@pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")
def test_machine_code_gives_the_same_flight(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    long = replace(plan, members=1000)
    assert_same_flight(with_scenario(long, duration=0.5, tick=0.1, step=0.005), 3, nonlinear_rate)
    assert len(list(tmp_path.rglob("*.so"))) == 1


def test_a_member_that_leaves_its_envelope_ends_there(plan: MonteCarlo) -> None:
    away = replace(plan, law=gain_law("wrong sign", -np.array(plan.law.identity["K"])), plant="linear")
    member, summary = fly_member(away, 0)
    assert 0.0 < summary.flown < away.scenario.duration
    assert STATES[summary.left] in ("pitch_rate", "alpha")
    assert_same_flight(away, 0, linear_rate)
    assert member.samples.shape == (50, 6)


def test_the_envelope_counts_on_the_angle_through_the_air(plan: MonteCarlo) -> None:
    """A sharp gust turns the air before it turns the path; turbulence may do so at the start already."""
    alpha, near = plan.point.states.alpha, np.radians(0.5)
    narrow = flight_envelope(PARAMETERS, plan.point, {"alpha": (alpha - near, alpha + near)})
    plan = with_scenario(replace(plan, envelope=narrow), duration=0.05, initial=np.zeros(7))
    gust = OneMinusCosine(10.0, 3.0, plan.point.states.speed)
    tight = with_scenario(plan, gust=gust, uncertainty=replace(plan.scenario.uncertainty, turbulence=None))
    scenario, summary = fly_member(tight, 3)
    assert summary.left == ALPHA
    assert_same_flight(tight, 3, nonlinear_rate)
    alone = fly(Aircraft(PARAMETERS), plan.point, gain_law("exact", plan.law.gains[0]), scenario, narrow)
    assert alone.departure is not None
    assert (alone.departure.state, alone.departure.time) == ("angle_of_attack", pytest.approx(summary.flown))
    assert np.abs(alone.states[alone.flight.times <= summary.flown, ALPHA] - alpha).max() < near
    scenario, at_once = fly_member(plan, 3)
    assert (at_once.left, at_once.flown, at_once.effort.tolist()) == (ALPHA, 0.0, [0.0] * 5)
    with pytest.raises(BadInputError, match="begins with angle_of_attack"):
        fly(Aircraft(PARAMETERS), plan.point, gain_law("exact", plan.law.gains[0]), scenario, narrow)


def test_the_flight_test_sees_a_wrong_parameter(plan: MonteCarlo) -> None:
    def forgetful(plan: MonteCarlo, member: Scenario) -> Rate:
        return nonlinear_rate(plan, replace(member, errors={}))

    with pytest.raises(AssertionError, match=r"rms_error|peak_error|effort"):
        assert_same_flight(with_scenario(plan, duration=0.05), 3, forgetful)


def test_a_member_is_one_scenario_simulated_alone(plan: MonteCarlo) -> None:
    """The draw of a member, simulated with its whole history, is the flight that the Monte Carlo summed up."""
    member, summary = fly_member(plan, 3)
    K = plan.law.gains[0]
    result = fly(Aircraft(PARAMETERS), plan.point, gain_law("exact", K), member, plan.envelope)
    np.testing.assert_allclose(result.flight.states[-1], summary.final, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.abs(result.flight.errors[:-1]).max(axis=0), summary.peak_error, rtol=1e-9)
    assert np.any(result.flight.updrafts)
    with pytest.raises(BadInputError, match="still to be drawn"):
        fly(Aircraft(PARAMETERS), plan.point, gain_law("exact", K), plan.scenario, plan.envelope)


def test_a_member_has_the_actuators_of_its_scenario(plan: MonteCarlo) -> None:
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    slow = Actuators(Input(*[0.02] * 5), lowest, highest, Input(*[np.inf] * 5))
    member, summary = fly_member(with_scenario(plan, actuators=slow), 3)
    K = plan.law.gains[0]
    result = fly(Aircraft(PARAMETERS), plan.point, gain_law("exact", K), member, plan.envelope)
    np.testing.assert_allclose(result.flight.states[-1], summary.final, rtol=1e-9, atol=1e-12)
    at_once = fly_member(with_scenario(plan, actuators=None), 3)[1]
    assert np.abs(at_once.final - summary.final).max() > 1e-4


def test_the_published_critic_learns_in_each_member(plan: MonteCarlo, critic: CriticPolicy) -> None:
    learning = with_scenario(
        replace(plan, law=critic_law("published", critic)), uncertainty=Uncertainty(), duration=0.05
    )
    _, summary = fly_member(learning, 0)
    loop = ClosedLoop(
        NonlinearPlant(Aircraft(PARAMETERS), plan.point),
        critic,
        plan.scenario.reference,
        plan.scenario.disturbance,
        zero(6),
    )
    start = critic.law.start()["weights"]
    flight = CompiledLoop(loop).fly(
        plan.scenario.initial, lambda tick: np.ones(1), step=0.001, steps_per_tick=10, ticks=5, memory=start
    )
    np.testing.assert_allclose(summary.memory, flight.memory[-1], rtol=1e-10)
    np.testing.assert_allclose(summary.final, flight.states[-1], rtol=1e-9, atol=1e-12)
    assert np.abs(summary.memory - start).max() > 1e-6


def test_all_members_fly_one_compiled_function(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(stored_members, "COMPILE_FROM_STEPS", 1)
    monkeypatch.setattr(watched_loop, "machine_code", lambda function: made.append(function) or function)
    result = fly_members(replace(plan, seed=99), 0, 4)  # no other test has this plan's loop made
    assert len(made) == 1
    assert len(np.unique(result["final"][:, 0])) == 4
    _, alone = fly_member(replace(plan, seed=99), 2)
    np.testing.assert_array_equal(result["final"][2], alone.final + np.array(plan.point.states))
