"""Flights in `assess` with sensor noise, a gust or turbulence."""

import json

import numpy as np
import pytest
from policy_cases import FOLDER, GTM, aircraft, stored_deployment, trims

import hfa
from hfa import Turbulence, assess
from hfa.main import main
from hfa_flight import OneMinusCosine, Scenario, Uncertainty

NOISE = Uncertainty(noise={"pitch_rate": 0.02})


@pytest.fixture(scope="module")
def noisy_assessment():
    """Return the assessment of a policy with two flights of half a second with sensor noise."""
    point = trims("ppo_gtm")[1]
    scenario = Scenario(duration=0.5, uncertainty=NOISE)
    return assess(
        aircraft("ppo_gtm"),
        stored_deployment("ppo_gtm"),
        [point],
        2,
        seed=3,
        scenario=scenario,
        best=0,
    )


def test_rms_with_noise_equals_that_of_fly(noisy_assessment):
    """The root mean squares with sensor noise equal those of `fly` with the same seed.

    Without noise, the root mean squares are less than half as large.
    """
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    found = noisy_assessment.points[0].rough
    assert (found.flights, found.inside, found.disturbed_by) == (2, 2, "noise")
    ticks = Scenario(duration=0.5, tick=0.02, step=0.02, uncertainty=NOISE).on(model)
    flights = [
        hfa.fly(model, point, stored_deployment("ppo_gtm"), scenario=ticks.drawn(3, member, point))
        for member in range(2)
    ]
    for name in ("alpha", "elevator"):
        off = [(flight[name] - point[name])[: -1 : round(0.02 / flight.step)] for flight in flights]
        rms = np.sqrt(np.mean(np.square(off)))
        assert found.rms[name] == pytest.approx(rms, rel=1e-5)
        assert found.calm[name] < 0.5 * found.rms[name]
    assert noisy_assessment.ok
    said = ("note", "every flight with noise stays inside the envelope")
    assert said in noisy_assessment.findings


@pytest.mark.slow
def test_a_flight_that_leaves_in_a_gust_fails():
    """The assessment fails if a flight leaves the envelope in a gust."""
    (point,) = trims("ppo_hfa")
    gust = OneMinusCosine(200.0, -80.0, 68.0)
    happens = Scenario(duration=5.0, gust=gust)
    failing = assess(
        aircraft("ppo_hfa"), stored_deployment("ppo_hfa"), [point], 1, scenario=happens, best=0
    )
    rough = failing.points[0].rough
    assert (rough.flights, rough.inside) == (1, 0)
    assert 0.0 < rough.departure.time < 5.0
    assert not failing.ok
    assert any(
        "with a gust" in each.text for each in failing.findings if each.severity == "failure"
    )


@pytest.mark.parametrize(
    ("scenario", "samples", "said"),
    [
        (Scenario(), 2, "has no noise, gust or turbulence"),
        (Scenario(uncertainty=NOISE), 0, "samples is 0"),
        (
            Scenario(uncertainty=Uncertainty(turbulence=Turbulence("light"))),
            2,
            "has no state altitude",
        ),
        (Scenario(uncertainty=Uncertainty(noise={"q": 1.0})), 2, "unknown noise of state 'q'"),
    ],
)
def test_a_scenario_without_disturbances_is_refused(scenario, samples, said):
    """Scenarios without disturbances, without flights or for missing states are refused."""
    with pytest.raises(hfa.BadInputError, match=said):
        assess(
            aircraft("ppo_gtm"),
            stored_deployment("ppo_gtm"),
            [45.0],
            samples,
            scenario=scenario,
            best=0,
        )


def test_flights_of_an_assessment_are_behind_the_filter(capsys):
    """--filter is the filter of --noise and --turbulence; without the noise it is refused."""
    words = ["assess", str(FOLDER / "ppo_gtm.toml"), "--aircraft", GTM, "--at", "45", "--best", "0"]
    words += ["--samples", "1", "--filter"]
    assert main(words) == 2
    assert "add --noise STATE=VALUE" in capsys.readouterr().err
    noise = [f"--noise={name}=0.1" for name in ("speed", "alpha", "pitch", "pitch_rate")]
    assert main([*words, *noise, "--json"]) == 0
    rough = json.loads(capsys.readouterr().out)["points"][0]["rough"]
    assert rough["disturbed_by"] == "noise, behind a Kalman filter"
    assert rough["inside"] == 1
