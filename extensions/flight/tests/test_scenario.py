"""Random scenarios: distributions, seeds, gusts and turbulence, and refused scenarios."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from member_plans import EVERYTHING, PARAMETERS, with_scenario

from hfa import BadInputError, fly, trim
from hfa_aircraft.model import Model
from hfa_aircraft.waveform import Harmonic
from hfa_flight import (
    ActuatorBank,
    ActuatorFault,
    CommandSteps,
    GainPolicy,
    MonteCarlo,
    OneMinusCosine,
    Scenario,
    Uncertainty,
    Waveform,
)
from hfa_flight.scenario import with_errors
from hfa_flight.signals import CommandedStates
from hfa_model import LINEAR_STATES, Input, Parameters

ACTUATORS = ActuatorBank(*(Input(*[each] * 5) for each in (0.1, -0.5, 0.4, 1.0)))
TIMES = np.array([1.0, 4.0])


def sampled_factors(plan: MonteCarlo, members: int) -> np.ndarray:
    return np.array(
        [plan.scenario.uncertainty.factors(plan.seed, member) for member in range(members)]
    )


def complaints_about_draws(plan: MonteCarlo, members: int = 2000) -> list[str]:
    """Return the faults of a plan's random parameters as texts, or an empty list.

    Faults are equal flights, correlated errors, and a distribution that is not log-normal with mean
    1.
    """
    from scipy.stats import kstest

    factors = sampled_factors(plan, members)
    found = [] if len(np.unique(factors, axis=0)) == members else ["members are alike"]
    sigmas = np.sqrt(np.log1p(np.square(list(plan.scenario.uncertainty.errors.values()))))
    for name, column, sigma in zip(
        plan.scenario.uncertainty.errors, factors.T, sigmas, strict=True
    ):
        # For one seed in a thousand, a correct distribution would fail. The seed is fixed.
        if kstest((np.log(column) + sigma**2 / 2) / sigma, "norm").pvalue < 1e-3:
            found.append(f"{name} does not have its law")
    correlation = np.corrcoef(factors.T) - np.eye(len(sigmas))
    if np.abs(correlation).max() > 4.0 / np.sqrt(members):
        found.append("errors are correlated")
    return found


def test_random_factors_have_the_specified_distribution(plan: MonteCarlo) -> None:
    """Random factors have the specified distribution, and only the listed parameters are changed."""
    assert complaints_about_draws(plan) == []
    member = plan.member(5)
    nominal = np.array(PARAMETERS, dtype=float)
    parameters = with_errors(plan.model, member).p
    changed = [Parameters._fields[i] for i in np.flatnonzero(parameters != nominal)]
    assert set(changed) == set(plan.scenario.uncertainty.errors)
    index = Parameters._fields.index("lift_slope")
    assert parameters[index] == nominal[index] * member.errors["lift_slope"]
    drawn = plan.scenario.uncertainty.factors(plan.seed, 5)
    heavy = with_scenario(plan, errors={"panel_mass": 2.0}).member(5)
    assert list(heavy.errors) == ["panel_mass", "lift_slope", "hinge_stiffness"]
    np.testing.assert_allclose(list(heavy.errors.values()), drawn * [2.0, 1.0, 1.0])
    wide = replace(plan.scenario.uncertainty, errors={"panel_mass": 3.0})
    logarithms = np.log([wide.factors(0, number)[0] for number in range(400)])
    # The mean ratio is 1. The mean of 400 logarithms has the deviation .08.
    assert logarithms.mean() == pytest.approx(-np.log(10.0) / 2.0, abs=0.3)
    assert member.gust.ticks == member.ticks
    assert member.gust.interval == member.tick


def test_seed_and_member_determine_the_scenario(plan: MonteCarlo) -> None:
    """The scenario of a member depends on seed and member alone, and each random quantity has its
    own sequence.
    """
    one = plan.member(3)
    again = replace(plan, members=99).member(3)
    next_one = plan.member(4)
    other_seed = replace(plan, seed=8).member(3)
    for of in (
        lambda each: list(each.errors.values()),
        lambda each: with_errors(plan.model, each).p,
        lambda each: each.samples,
    ):
        assert np.array_equal(of(one), of(again))
        assert not np.array_equal(of(one), of(next_one))
        assert not np.array_equal(of(one), of(other_seed))
    assert one.gust == again.gust
    assert len({one.gust.seed, next_one.gust.seed, other_seed.gust.seed}) == 3
    # Removing one kind of random quantity does not change the others.
    calm = with_scenario(plan, uncertainty=replace(EVERYTHING, noise={}, turbulence=None)).member(3)
    assert calm.errors == one.errors
    assert calm.samples is None
    assert calm.gust is None


def test_noise_and_turbulence_have_specified_deviations(plan: MonteCarlo) -> None:
    """Drawn noise and turbulence have the specified standard deviations."""
    members = [plan.member(number) for number in range(200)]
    noise = np.stack([each.samples for each in members])
    deviation = noise.std(axis=(0, 1))
    assert deviation[LINEAR_STATES.index("alpha")] == pytest.approx(0.002, rel=0.03)
    assert deviation[LINEAR_STATES.index("pitch_rate")] == pytest.approx(0.004, rel=0.03)
    assert np.count_nonzero(deviation) == 2
    assert abs(np.corrcoef(noise[0, :, 1], noise[1, :, 1])[0, 1]) < 0.5
    winds = [each.gust.winds(0.0, each.gust.held_inputs(0)) for each in members]
    for name in ("updraft", "headwind"):
        assert np.std([float(wind[name]) for wind in winds]) == pytest.approx(3.0, rel=0.15)
    assert members[0].gust.speed == plan.point.states.speed


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: Uncertainty({"lift_slope": -0.1}),
            "deviation of lift_slope is -0.1; give a number of at least 0",
        ),
        (lambda: Scenario(step=0.003), "whole number of steps"),
        (lambda: Scenario(duration=np.inf), "duration is inf"),
        (lambda: OneMinusCosine(10.0, np.nan, 68.0), "peak of the gust is nan"),
        (lambda: Uncertainty(turbulence=(3.0, 1750.0)), "give hfa.Turbulence"),
        (
            lambda: replace(ACTUATORS, lag=Input(0.1, 0.0, 0.1, 0.1, 0.1)),
            "lag of aileron_center is 0.0",
        ),
        (
            lambda: replace(ACTUATORS, highest=Input(1.0, 1.0, 1.0, -0.5, 1.0)),
            "position limits of elevator_center",
        ),
        (
            lambda: replace(ACTUATORS, rate=Input(1.0, 0.0, 1.0, 1.0, 1.0)),
            "the rate limit of aileron_center is 0.0; give a positive rate",
        ),
        (
            lambda: replace(ACTUATORS, rate=Input(1.0, 1.0, np.nan, 1.0, 1.0)),
            "the rate limit of aileron_outer is nan",
        ),
        (lambda: replace(ACTUATORS, order=3), "the order of the actuators is 3"),
        (lambda: ActuatorFault(damping=np.nan), "damping after a fault is nan"),
        (lambda: replace(ACTUATORS, faults=(ActuatorFault(inputs=("flap",)),)), "no input 'flap'"),
        (lambda: CommandSteps(("speed", "speed"), TIMES, np.zeros((2, 2))), "speed is given twice"),
        (
            lambda: CommandSteps(("speed",), TIMES, np.zeros((1, 1))),
            r"shape \(1, 1\); give 2 rows of 1 finite",
        ),
        (
            lambda: GainPolicy("bad", np.full((5, 6), np.nan)),
            "the gain has shape .*; give a matrix of finite numbers, inputs x states",
        ),
        (lambda: Waveform(np.zeros(2), np.zeros(3)), "the parts of a waveform have shapes"),
    ],
)
def test_unusable_scenarios_are_refused(make: Callable[[], object], said: str) -> None:
    """Scenarios, gusts, actuators and commands with unusable values are refused."""
    with pytest.raises(BadInputError, match=said):
        make()


def test_a_scenario_is_driven_until_its_last_signal_ends() -> None:
    """Steps end at their last time, gusts with their length, sines and noise never."""
    steps = CommandedStates(CommandSteps(("speed",), TIMES, np.ones((2, 1))), ("speed", "alpha"))
    gust = OneMinusCosine(length=400.0, peak=1.0, speed=80.0, begin=2.0)
    sine = Waveform(np.zeros(1), np.zeros(1), (Harmonic(1.0, np.ones(1), np.ones(1)),))
    for given, until in (
        ({}, 0.0),
        ({"reference": steps}, 4.0),
        ({"gust": gust}, 7.0),
        ({"reference": steps, "gust": gust}, 7.0),
        ({"air": {"rain": sine}}, np.inf),
        ({"samples": np.zeros((1, 2))}, np.inf),
        ({"disturbance": Waveform(np.ones(2), np.zeros(2))}, 0.0),
    ):
        scenario = Scenario(**given)
        assert scenario.driven_until == until, given
        assert scenario.moving_air == bool({"gust", "air"} & set(given))
    t = np.array([0.0, 0.9, 1.1, 3.9, 4.1, 30.0])
    late = [np.array(ca.DM(steps.at(each))).ravel() for each in t]
    assert late[0].tolist() == [0.0, 0.0]
    assert late[-1].tolist() == pytest.approx([1.0, 0.0], abs=0.05)
    sharp = replace(steps, filtered=False)
    assert [float(ca.DM(sharp.at(each))[0]) for each in t] == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    data = Scenario(air={"rain": sine}, delay=0.03).to_dict()
    assert (data["delay"], list(data["air"]), data["gust"]) == (0.03, ["rain"], None)
    assert Scenario(delay=0.03).delayed_ticks == 3


# The 1-cosine gust.


def test_one_minus_cosine_gust_equals_its_formula() -> None:
    """During the gust, the updraft is (peak/2) (1 - cos). Before and after, the updraft is 0."""
    gust = OneMinusCosine(length=400.0, peak=-10.0, speed=80.0, begin=2.0)
    times = np.linspace(0.0, 10.0, 1001)
    values = np.array([float(gust.updraft(t)) for t in times])
    passing = (times > 2.0) & (times < 7.0)
    wave = -5.0 * (1.0 - np.cos(2 * np.pi * (times - 2.0) / 5.0))
    np.testing.assert_allclose(values, np.where(passing, wave, 0.0), atol=1e-12)
    assert np.all(values[~passing] == 0.0)
    assert gust.until == pytest.approx(7.0)


def test_a_gust_is_added_to_a_disturbance_of_the_same_wind(published_aircraft: Model) -> None:
    gust = OneMinusCosine(length=20.0, peak=3.0, speed=68.0, begin=0.05)
    rising = Waveform(np.array([0.5]), np.array([0.25]))
    scenario = Scenario(duration=0.3, gust=gust, air={"updraft": rising})
    flown = fly(
        published_aircraft, trim(published_aircraft, dihedral=math.radians(10.0)), scenario=scenario
    ).flight
    both = [float(gust.updraft(t)) + 0.5 + 0.25 * t for t in flown.times]
    np.testing.assert_allclose(flown.winds["updraft"], both, rtol=1e-9)
