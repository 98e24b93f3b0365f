"""Monte Carlo simulations. The flights equal single flights, in any order and number of workers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from member_plans import EVERYTHING, PARAMETERS, with_scenario
from random_points import rates

import hfa
from hfa import BadInputError, fly, trim
from hfa.paper import level_flight
from hfa_aircraft.waveform import zero
from hfa_flight import (
    GainPolicy,
    MonteCarlo,
    OneMinusCosine,
    Scenario,
    Uncertainty,
    flight_envelope,
)
from hfa_flight.samples import store as monte_carlo_store
from hfa_flight.samples.monte_carlo import fly_member, fly_members, member_row
from hfa_flight.samples.report import member_report
from hfa_flight.samples.store import MEMBER_STEPS, chunk_of, run_monte_carlo, stream_members
from hfa_flight.scenario import with_errors
from hfa_model import LINEAR_STATES, STATES, Input, Parameters, State
from hfa_model.kinematics import Wind, Winds
from hfa_model.variants import variant_named
from hfa_support.native import machine_code as generated

ALPHA = STATES.index("alpha")
SEEN = [STATES.index(name) for name in LINEAR_STATES]


def simulated_in_numpy(plan: MonteCarlo, member: Scenario, p: Parameters) -> Mapping[str, object]:
    """Return the results of one flight of a Monte Carlo plan, by a Runge-Kutta loop in NumPy.

    The policy is u = -K z. The equations of motion are evaluated with numbers, without compiled
    functions.
    """
    assert member.samples is not None
    h = member.step
    lowest = np.array(plan.envelope.lowest)
    highest = np.array(plan.envelope.highest)
    X0 = np.array(plan.point.states)
    U0 = np.array(plan.point.inputs)
    K = plan.policy.gains[0]
    air = member.gust
    variant = variant_named(plan.model.name)
    x = member.initial
    errors = []
    inputs = []
    angles = []
    left = -1
    flown = member.duration

    def winds(t: float, tick: int) -> dict[str, float]:
        moving = {} if air is None else air.winds(t, air.held_inputs(tick))
        return {name: float(value) for name, value in moving.items()}

    def slope(t: float, x: np.ndarray, tick: int) -> np.ndarray:
        u = -K @ (x[SEEN] - member.reference.at(t) + member.samples[tick])
        wind = Wind(**winds(t, tick))
        rows = rates(State(*(X0 + x)), Input(*(U0 + u)), p, variant, Winds(wind, wind))
        rate = np.array([float(row) for row in rows])
        rate[SEEN] += member.disturbance.at(t)
        return rate

    def limited(t: float, x: np.ndarray, tick: int) -> np.ndarray:
        """Return the absolute state, with alpha replaced by the angle of attack relative to the
        air.

        This angle follows from the velocities of aircraft and wind, north and down.
        """
        X = State(*(x + X0))
        wind = winds(t, tick)
        path = X.pitch - X.alpha
        north = X.speed * np.cos(path) + wind.get("headwind", 0.0)
        down = wind.get("updraft", 0.0) - X.speed * np.sin(path)
        return np.array(X._replace(alpha=X.pitch + np.arctan2(down, north)))

    for step in range(member.ticks * member.steps_per_tick):
        t = step * h
        tick = step // member.steps_per_tick
        z = x[SEEN] - member.reference.at(t)
        errors.append(z)
        inputs.append(-K @ (z + member.samples[tick]))
        angles.append(limited(t, x, tick)[ALPHA] - plan.point.states.alpha)
        k1 = slope(t, x, tick)
        k2 = slope(t + h / 2, x + h / 2 * k1, tick)
        k3 = slope(t + h / 2, x + h / 2 * k2, tick)
        k4 = slope(t + h, x + h * k3, tick)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        X = limited(t + h, x, tick)
        outside = np.maximum(X - highest, lowest - X) / (highest - lowest)
        if outside.max() > 0.0:
            left = int(np.argmax(outside))
            flown = t + h
            break
    return {
        "left": left,
        "flown": flown,
        "rms_error": np.sqrt(np.mean(np.square(errors), axis=0)),
        "peak_error": np.max(np.abs(errors), axis=0),
        "peak_angle_of_attack": np.max(np.abs(angles)),
        "effort": np.sqrt(np.mean(np.square(inputs), axis=0)),
        "lowest_input": np.min(inputs, axis=0) + U0,
        "highest_input": np.max(inputs, axis=0) + U0,
        "final": x + X0,
    }


def assert_same_flight(plan: MonteCarlo, member: int, p: Parameters | None = None) -> None:
    result = fly_member(plan, member)
    found = member_row(plan, result)
    scenario = result.loop.scenario
    known = p or Parameters(*with_errors(plan.model, scenario).p.tolist())
    for name, value in simulated_in_numpy(plan, scenario, known).items():
        np.testing.assert_allclose(found[name], value, rtol=1e-8, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_a_member_equals_its_single_flight(plan: MonteCarlo, dynamics: str) -> None:
    """Each member of a Monte Carlo simulation equals the single flight of its scenario."""
    aircraft = hfa.aircraft(dynamics, PARAMETERS)
    point = trim(aircraft, level_flight(plan.point.states.dihedral))
    flown = replace(plan, model=aircraft, point=point)
    assert_same_flight(with_scenario(flown, duration=0.05), 3)


@pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")
def test_compiled_code_gives_the_same_flight(
    plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Members simulated by compiled code equal single flights, and one library is compiled."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    long = replace(plan, members=1000)
    assert_same_flight(with_scenario(long, duration=0.5, tick=0.1, step=0.005), 3)
    assert len(list(tmp_path.rglob("*.so"))) == 1


def test_a_member_ends_when_it_leaves_the_envelope(plan: MonteCarlo) -> None:
    """A member that leaves the envelope ends at its departure.

    The summary of the members contains the departure.
    """
    away = replace(
        plan, members=1, policy=GainPolicy("wrong sign", -np.array(plan.policy.identity["K"]))
    )
    departure = fly_member(away, 0).departure
    assert departure is not None
    assert 0.0 < departure.time < away.scenario.duration
    assert departure.state in ("pitch_rate", "angle_of_attack")
    assert_same_flight(away, 0)
    data = member_report(away, run_monte_carlo(away).__getitem__).data
    assert (data["held"], data["first_left"], set(data["effort"].values())) == (
        0,
        departure.time,
        {None},
    )


def test_the_envelope_limits_alpha_relative_to_the_air(plan: MonteCarlo) -> None:
    """The envelope limits the angle of attack relative to the air, not alpha over ground.

    A sharp gust exceeds the limit before alpha does. A flight of a Monte Carlo plan may begin
    beyond the limit because of turbulence. A single flight that begins beyond the limit is refused.
    """
    alpha = plan.point.states.alpha
    near = np.radians(0.5)
    narrow = flight_envelope(plan.model, plan.point, {"alpha": (alpha - near, alpha + near)})
    plan = with_scenario(replace(plan, envelope=narrow), duration=0.05, initial=np.zeros(7))
    gust = OneMinusCosine(10.0, 3.0, plan.point.states.speed)
    tight = with_scenario(
        plan, gust=gust, uncertainty=replace(plan.scenario.uncertainty, turbulence=None)
    )
    flown = fly_member(tight, 3)
    assert flown.departure is not None
    assert flown.departure.state == "angle_of_attack"
    assert (
        np.abs(flown.states[flown.flight.times <= flown.departure.time, ALPHA] - alpha).max() < near
    )
    assert_same_flight(tight, 3)
    at_once = fly_member(plan, 3)
    row = member_row(plan, at_once)
    assert (row["left"], row["flown"], row["effort"].tolist()) == (ALPHA, 0.0, [0.0] * 5)
    for scenario, said in (
        (at_once.loop.scenario, "the initial angle_of_attack is"),
        (plan.scenario, "random quantities of the scenario are not drawn"),
    ):
        with pytest.raises(BadInputError, match=said):
            fly(
                hfa.aircraft(parameters=PARAMETERS),
                plan.point,
                plan.policy,
                scenario=scenario,
                envelope=narrow,
            )


# Plans.


def test_equal_plans_have_equal_hashes(plan: MonteCarlo, gain: np.ndarray) -> None:
    """Equal plans have equal hashes. Each change that affects the results makes a plan
    different.
    """
    assert replace(plan) == plan
    assert hash(replace(plan)) == hash(plan)
    others = [
        replace(plan, seed=8),
        replace(plan, policy=GainPolicy("exact", 1.01 * gain)),
        with_scenario(plan, uncertainty=replace(EVERYTHING, turbulence=None)),
        with_scenario(
            plan, uncertainty=replace(EVERYTHING, errors=dict(reversed(EVERYTHING.errors.items())))
        ),
        with_scenario(plan, step=0.0005),
        with_scenario(plan, reference=zero(6)),
        with_scenario(
            plan,
            gust=OneMinusCosine(100.0, 1.0, 68.0),
            uncertainty=replace(EVERYTHING, turbulence=None),
        ),
        replace(plan, envelope=flight_envelope(plan.model, plan.point, {"alpha": (-0.1, 0.2)})),
    ]
    assert len({plan, *others}) == 1 + len(others)


def test_unusable_monte_carlo_plans_are_refused(plan: MonteCarlo) -> None:
    """Ineffective or unknown parameters, gains of wrong shape and scenarios already drawn are
    refused.
    """
    no_moment = hfa.aircraft(parameters=PARAMETERS._replace(zero_lift_moment=0.0))
    moment = with_scenario(plan, uncertainty=Uncertainty({"zero_lift_moment": 1.0}))
    for said, make in (
        ("has no effect", lambda: replace(moment, model=no_moment)),
        (
            "unknown parameter 'span'",
            lambda: with_scenario(plan, uncertainty=Uncertainty({"span": 0.1})),
        ),
        (
            r"shape \(6, 5\); give 5 x 6",
            lambda: replace(plan, policy=GainPolicy("wide", np.zeros((6, 5)))),
        ),
        ("already drawn", lambda: replace(plan, scenario=plan.member(0))),
    ):
        with pytest.raises(BadInputError, match=said):
            make()


# Stores and reports.


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_chunks_and_workers_do_not_change_results(
    plan: MonteCarlo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    """Members are equal whether they are simulated at once, in chunks, later, or by several
    processes.
    """
    six = replace(plan, members=6)
    steps = MEMBER_STEPS + plan.scenario.ticks * plan.scenario.steps_per_tick
    # A true chunk takes minutes.
    monkeypatch.setattr(monte_carlo_store, "CHUNK_STEPS", 4 * steps)
    assert chunk_of(six) == 4
    whole = fly_members(plan, 0, 6)
    late = fly_members(plan, 4, 6)
    in_memory = run_monte_carlo(six, workers)
    dataset = stream_members(six, tmp_path / "a.zarr", workers=workers)
    for name, values in whole.items():
        np.testing.assert_array_equal(late[name], values[4:])
        np.testing.assert_array_equal(in_memory[name], values)
        if values.size:
            np.testing.assert_array_equal(dataset[name], values)
    assert dataset.peak_error.sel(error_state="alpha").attrs["units_of"] == "error_state_unit"
    assert dataset.factors.error.values.tolist() == list(plan.scenario.uncertainty.errors)
    assert "error_unit" not in dataset.coords
