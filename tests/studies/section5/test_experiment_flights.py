"""Flights of Section 5 against independent integrators, and their numbers against another study."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from experiment_configurations import BRIEF, COARSE, NOTHING, Changes, changed

from studies.section5.claims import (
    Evidence,
)
from studies.section5.configuration import section5_configuration
from studies.section5.critic_policy import CriticPolicy
from studies.section5.experiment_flights import FlightPlan, FlightRecord, simulate_plan
from studies.section5.flown_laws import (
    CERTIFIED,
    CERTIFIED_FF,
    EXACT,
    EXACT_FF,
    INTEGRAL,
    MODIFIED,
    PRINTED,
    REWEIGHTED,
    law_of,
)
from studies.section5.measures import gain_error
from studies.section5.metrics import TRACKED
from studies.section5.setting import Setting, exosystem_of, feedforward, generator, make_setting
from verification import paper_reference, simulate, solve_game

STILL_AIR: Changes = {"disturbance": {"sine": (NOTHING,), "cosine": (NOTHING,)}}


@cache
def default_setting() -> Setting:
    return make_setting(section5_configuration())


def rms(record: FlightRecord) -> list[float]:
    return [record.metrics.rms_error[state] for state in TRACKED]


# Numbers. -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dihedral", "law", "changes", "expected"),
    [
        (15.0, EXACT, {}, (0.071, 0.074, 0.086)),
        (15.0, EXACT_FF, {}, (0.011, 0.061, 0.095)),
        pytest.param(15.0, EXACT, STILL_AIR, (0.063, 0.105, 0.011), marks=pytest.mark.slow),
        (15.0, EXACT_FF, STILL_AIR, (4e-5, 0.091, 0.008)),
        pytest.param(5.0, EXACT, {}, (0.061, 0.080, 0.060), marks=pytest.mark.slow),
        (5.0, EXACT_FF, {}, (0.009, 0.073, 0.102)),
    ],
)
def test_tracking_is_what_another_study_found(
    dihedral: float, law: str, changes: Changes, expected: tuple[float, float, float]
) -> None:
    """Printed matrices; the study was made with the other sign of one entry of A, which moves the third digit."""
    setting = make_setting(changed(COARSE, changes), "printed")
    record = simulate_plan(setting, FlightPlan(dihedral, law), "5.1")
    assert rms(record) == pytest.approx(expected, abs=2e-3 if expected[0] > 1e-3 else 3e-3)
    assert (record.metrics.rms_error["speed"] < 1e-4) == (expected[0] < 1e-4)


def test_the_optimum_tracks_alpha_only_with_another_weight() -> None:
    setting = make_setting(changed(COARSE))
    optimum, reweighted = (
        simulate_plan(setting, FlightPlan(15.0, law), "5.1").metrics.relative_error["alpha"]
        for law in (EXACT_FF, REWEIGHTED)
    )
    assert optimum > 0.5
    assert reweighted < 0.05


@pytest.mark.parametrize("law", [EXACT, EXACT_FF])
def test_a_flight_agrees_with_an_independent_simulation(law: str) -> None:
    """LSODA on the error equation with the forcing of the reference: states, cost and metrics."""
    setting = make_setting(changed(COARSE))
    case, configuration = setting.case(5.0), setting.configuration
    record = simulate_plan(setting, FlightPlan(5.0, law), "5.1")
    reference, disturbance, w = (
        configuration.reference.signal,
        configuration.disturbance.signal,
        generator(configuration.reference.signal),
    )
    F = feedforward(case, reference) * (law == EXACT_FF)
    other = simulate(
        case.game,
        lambda t, z: -case.exact.K @ z + F @ w.at(t),
        lambda t, z: np.asarray(disturbance.at(t)),
        configuration.initial - reference.at(0.0),
        record.times,
        forcing=lambda t: case.game.A @ reference.at(t) - reference.rate().at(t),
    )
    scale = np.abs(other.states).max(axis=0)
    assert np.all(np.abs(record.errors - other.states).max(axis=0) <= 1e-5 * scale)
    energy = np.trapezoid(np.sum(other.disturbances**2, axis=1), other.times)
    assert record.metrics.cost == pytest.approx(other.cost[-1] + case.game.delta**2 * energy, rel=1e-3)
    assert record.metrics.attenuation == pytest.approx(record.metrics.cost / energy, rel=1e-3)


def test_the_disturbance_alone_costs_less_than_the_game_promises() -> None:
    setting = make_setting(changed(COARSE))
    for dihedral in (15.0, 5.0):
        metrics = simulate_plan(setting, FlightPlan(dihedral, EXACT, commanded=False), "5.1").metrics
        assert 0.0 < metrics.attenuation < metrics.delta_squared


# Integration. ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", [pytest.param(EXACT_FF, marks=pytest.mark.slow), CERTIFIED_FF])
def test_the_fixed_step_agrees_with_an_adaptive_integrator(law: str) -> None:
    """The paper's step against DOP853 at rtol 1e-10, restarted where a gain changes: 1e-6 on every state."""
    from scipy.integrate import solve_ivp

    setting = default_setting()
    case, configuration = setting.case(5.0), setting.configuration
    record = simulate_plan(setting, FlightPlan(5.0, law), "5.2")
    constants, w = constants_of(setting, law, 5.0), generator(configuration.reference.signal)
    d, reference = configuration.disturbance.signal, configuration.reference.signal
    x, rows = configuration.initial, [configuration.initial]
    tick = configuration.flight.tick
    begin, ticks = 0, len(record.times) - 1
    while begin < ticks:
        end = begin + 1
        while end < ticks and np.array_equal(constants(end), constants(begin)):
            end += 1
        p = constants(begin)
        K, F = p[:30].reshape(6, 5).T, p[30:].reshape(-1, 5).T

        def rate(t: float, x: np.ndarray, K: np.ndarray = K, F: np.ndarray = F) -> np.ndarray:
            return case.game.A @ x + case.game.B @ (F @ w.at(t) - K @ (x - reference.at(t))) + d.at(t)

        times = tick * np.arange(begin, end + 1)
        found = solve_ivp(rate, (times[0], times[-1]), x, method="DOP853", rtol=1e-10, atol=1e-12, t_eval=times[1:])
        rows += list(found.y.T)
        x, begin = found.y[:, -1], end
    adaptive = np.array(rows)
    assert np.all(np.abs(record.states - adaptive).max(axis=0) <= 1e-6 * np.abs(adaptive).max(axis=0))


def constants_of(setting: Setting, law: str, predefined_time: float) -> Any:
    reference = setting.configuration.reference.signal
    return law_of(setting, setting.case(5.0), law, predefined_time, False, reference)[0].constants


# Laws. ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dihedral", [15.0, 5.0])
def test_the_law_as_printed_overflows_at_once(dihedral: float) -> None:
    record = simulate_plan(default_setting(), FlightPlan(dihedral, PRINTED), "5.1")
    assert not record.held
    assert record.lost_at <= 3e-4
    assert len(record.times) == 1
    assert record.metrics.rms_error["speed"] == np.inf
    assert record.metrics.learning.facts["alpha2"] > 1e20


@pytest.mark.parametrize(("law", "knows"), [(PRINTED, True), (MODIFIED, False)])
def test_only_the_drift_of_the_law_as_printed_carries_the_reference(law: str, knows: bool) -> None:
    setting = default_setting()
    case, reference = setting.case(5.0), setting.configuration.reference.signal
    policy = law_of(setting, case, law, 1.0, False, reference)[0].policy
    assert isinstance(policy, CriticPolicy)
    told = case.game.A @ reference.at(2.0) - reference.rate().at(2.0)
    np.testing.assert_allclose(np.ravel(policy.forcing.at(2.0)), told * knows, atol=1e-12)


def test_the_modified_law_learns_in_flight_and_can_be_frozen() -> None:
    setting = make_setting(changed(BRIEF))
    free = simulate_plan(setting, FlightPlan(5.0, MODIFIED), "5.1")
    frozen = simulate_plan(setting, FlightPlan(5.0, MODIFIED), "5.3")
    assert free.held
    assert frozen.held
    assert free.metrics.learning.late_change > 0.0
    assert frozen.metrics.learning.late_change == 0.0
    at_end = int(np.searchsorted(frozen.times, 0.5))
    assert free.critic is not None
    assert frozen.critic is not None
    np.testing.assert_array_equal(free.critic.weights[:at_end], frozen.critic.weights[:at_end])


def test_the_certified_law_applies_a_baseline_and_then_the_exact_gain() -> None:
    setting = make_setting(changed(BRIEF))
    constants = constants_of(setting, CERTIFIED, 0.5)
    record = simulate_plan(setting, FlightPlan(5.0, CERTIFIED), "5.2")
    exact = setting.case(5.0).exact.K
    first, last = (constants(tick)[:30].reshape(6, 5).T for tick in (0, 99))
    forward = constants_of(setting, CERTIFIED_FF, 0.5)
    assert not forward(0)[30:].any()
    assert forward(99)[30:].any()
    assert np.linalg.norm(first - exact) > 0.5 * np.linalg.norm(exact)
    assert np.linalg.norm(last - exact) < 1e-9 * np.linalg.norm(exact)
    assert 0.0 < record.learned_from < 0.5
    assert record.metrics.learning.facts["status"] == "converged"
    assert (
        gain_error(lambda setting, law: (record.plan,))(Evidence(setting, "5.2", {record.plan: record}), CERTIFIED)
        < 1e-9
    )
    np.testing.assert_allclose(record.inputs[-1], -exact @ record.errors[-1], rtol=1e-6)


def test_integral_learning_applies_its_start_until_it_has_data() -> None:
    setting = default_setting()
    constants = constants_of(setting, INTEGRAL, 5.0)
    baseline = constants_of(setting, CERTIFIED, 5.0)(0)
    np.testing.assert_allclose(constants(799), baseline, rtol=1e-9, atol=1e-12)
    last = constants(1999)[:30].reshape(6, 5).T
    lq = solve_game(setting.case(5.0).game.with_delta(np.inf)).K
    assert np.linalg.norm(last - lq) < 1e-6 * np.linalg.norm(lq)


def test_uncertainty_and_noise_reach_the_plant_and_the_sensor() -> None:
    setting = make_setting(changed(COARSE, BRIEF))
    plain, wrong, noisy = (
        simulate_plan(setting, plan, "5.3")
        for plan in (
            FlightPlan(5.0, EXACT),
            FlightPlan(5.0, EXACT, uncertainty=0.3),
            FlightPlan(5.0, EXACT, noise=True),
        )
    )
    K, n = setting.case(5.0).exact.K, setting.configuration.noise.signal
    assert (plain.critic, plain.residual.size) == (None, 0)
    np.testing.assert_allclose(plain.inputs, -plain.errors @ K.T, atol=1e-12)
    np.testing.assert_allclose(wrong.inputs, -wrong.errors @ K.T, atol=1e-12)
    np.testing.assert_allclose(noisy.inputs, -(noisy.errors + n.sampled(noisy.times)) @ K.T, atol=1e-12)
    assert np.abs(wrong.states - plain.states).max() > 1e-3


# Feedforward. ---------------------------------------------------------------------------------------------------


def test_the_exosystem_is_that_of_the_paper() -> None:
    reference = section5_configuration().reference.signal
    ours, paper = exosystem_of(reference), paper_reference()
    for t in (0.0, 2.0, 19.0):
        np.testing.assert_allclose(ours.reference(t), reference.at(t), atol=1e-12)
        np.testing.assert_allclose(paper.reference(t), reference.at(t), atol=1e-12)
        np.testing.assert_allclose(generator(reference).at(t), ours.state(t), atol=1e-12)


def test_a_reference_of_two_frequencies_has_an_exosystem() -> None:
    noise = section5_configuration().noise.signal
    for t in (0.0, 7.0):
        np.testing.assert_allclose(exosystem_of(noise).reference(t), noise.at(t), atol=1e-12)
