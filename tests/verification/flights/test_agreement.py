"""The linear model to second order, and the fixed step against an adaptive integrator."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from cli import hfa
from flight_cases import SMALL, FlownCase, flown, signal
from game_samples import failed_names

from controller import Actuators, Dryden, Harmonic, OneMinusCosine, Scenario, Signal
from controller.flight.plants import LinearizedAircraft
from controller.flight.simulation import CompiledLoop
from hfa_cli.main import BAD_INPUT, DONE
from hfa_model import LINEAR_STATES, STATES, Input
from trim import CONTROL_LIMITS, find_operating_point, level_flight
from verification.flights import agreement
from verification.flights.agreement import (
    INTEGRATION,
    adaptive_states,
    agreement_checks,
    deviations,
    integration_checks,
    slope_checks,
)

N = len(LINEAR_STATES)
FLY = ("fly", "--dihedral", "15", "--law", "exact")


@pytest.fixture
def two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of flight, in which the slopes are as they are after five."""
    monkeypatch.setattr(agreement, "DURATION", 2.0)


@pytest.mark.usefixtures("two_seconds")
def test_the_linear_prediction_is_wrong_to_second_order_only(at_15: FlownCase) -> None:
    errors = deviations(at_15.aircraft, at_15.point, at_15.law)
    assert all(check.ok and 1.9 < check.value < 2.1 for check in slope_checks(errors))
    assert errors[0].max() < 1e-4


@pytest.mark.usefixtures("two_seconds")
def test_a_prediction_for_another_dihedral_is_wrong_to_first_order(
    newton: FlownCase, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = find_operating_point(newton.aircraft, level_flight(float(np.radians(15.5))))
    wrong = LinearizedAircraft.at(newton.aircraft, other)
    monkeypatch.setattr(agreement, "LinearizedAircraft", SimpleNamespace(at=lambda *_: wrong))
    checks = slope_checks(deviations(newton.aircraft, newton.point, newton.law))
    assert failed_names(checks) >= {f"slope_{name}_at_least" for name in ("alpha", "pitch", "pitch_rate", "dihedral")}
    found = {check.name: check.value for check in checks}
    assert found["slope_pitch_rate_at_least"] == pytest.approx(1.0, abs=0.15)


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


@pytest.mark.parametrize(
    "scenario",
    [pytest.param(each, id=name, marks=[pytest.mark.slow] * (name == "released")) for name, each in SCENARIOS.items()],
)
def test_the_fixed_step_agrees_with_an_adaptive_integrator(at_15: FlownCase, scenario: Scenario) -> None:
    result = flown(at_15, scenario)
    assert result.departure is None
    loop = CompiledLoop(result.loop)
    adaptive = adaptive_states(loop, scenario.initial, at_15.law, tick=scenario.tick, ticks=scenario.ticks)
    fixed = result.flight.states[:: scenario.steps_per_tick]
    checks = integration_checks(fixed, adaptive)
    assert [check.name for check in checks if not check.ok] == []
    # The check can fail: the same flight with one state off by twice what is allowed.
    off = adaptive + 2 * INTEGRATION * np.abs(adaptive).max(axis=0) * (np.arange(len(STATES)) == 3)
    assert [check.name for check in integration_checks(off, adaptive) if not check.ok] == ["integration_pitch"]


def test_the_same_flight_twice_gives_the_same_bits(newton: FlownCase) -> None:
    one, two = (flown(newton, one_flight_of_everything(0.5)) for _ in range(2))
    for name in ("times", "states", "errors", "inputs", "memory", "updrafts"):
        assert np.array_equal(getattr(one.flight, name), getattr(two.flight, name)), name
    assert np.any(one.flight.updrafts != 0.0)


def test_a_step_that_is_too_long_fails_the_check(newton: FlownCase) -> None:
    scenario = Scenario(duration=1.0, step=0.01, initial=SMALL)
    checks = agreement_checks(newton.aircraft, newton.law, flown(newton, scenario))
    failed = failed_names(checks)
    assert "integration_pitch_rate" in failed
    assert not any(name.startswith("slope") for name in failed)


def test_a_flight_at_rest_passes_its_checks() -> None:
    said = hfa(*FLY, "--duration", "2", "--check", "--json")
    assert said.code == DONE
    assert all(check["ok"] for check in json.loads(said.out)["checks"])


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("fly", "--initial", "speed=-70"), "begins with speed -2, beyond the limit of 34 ft/s"),
        (("fly", "--initial", "pitch=-70", "--check"), "begins with pitch -67.2"),
        (
            ("schedule", "--to", "16", "--over", "1", "--initial", "dihedral=-90"),
            "begins with dihedral -75, beyond the limit of -60 deg",
        ),
    ],
)
def test_a_start_outside_the_envelope_is_refused(words: tuple[str, ...], told: str) -> None:
    said = hfa(*words, *FLY[1:])
    assert (said.code, said.out) == (BAD_INPUT, "")
    assert told in said.err
    assert said.err.count("\n") == 1
