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
        stored_deployment("ppo_gtm").changed(cost=None),
        [point],
        2,
        seed=3,
        scenario=scenario,
        best=0,
    )


@pytest.mark.slow  # test_flights_of_a_law_are_those_of_fly is fast
def test_rms_with_noise_equals_that_of_fly(noisy_assessment):
    """The root mean squares with sensor noise equal those of `fly` with the same seed."""
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    found = noisy_assessment.points[0].in_air.data
    assert (found["members"], found["held"]) == (2, 2)
    ticks = Scenario(duration=0.5, tick=0.02, step=0.02, uncertainty=NOISE).on(model)
    flights = [
        hfa.fly(model, point, stored_deployment("ppo_gtm"), scenario=ticks.drawn(3, member, point))
        for member in range(2)
    ]
    for name, of in (("alpha", "rms_error"), ("elevator", "effort")):
        off = [(flight[name] - point[name])[: -1 : round(0.02 / flight.step)] for flight in flights]
        largest = np.sqrt(np.mean(np.square(off), axis=1)).max()
        assert found[of][name][-1] == pytest.approx(largest, rel=1e-5)
    assert noisy_assessment.ok


@pytest.mark.slow
def test_a_flight_that_leaves_in_a_gust_fails():
    """The assessment fails if a flight leaves the envelope in a gust."""
    (point,) = trims("ppo_hfa")
    gust = OneMinusCosine(200.0, -80.0, 68.0)
    happens = Scenario(duration=5.0, gust=gust)
    failing = assess(
        aircraft("ppo_hfa"), stored_deployment("ppo_hfa"), [point], 1, scenario=happens, best=0
    )
    found = failing.points[0].in_air.data
    assert (found["members"], found["held"]) == (1, 0)
    assert 0.0 < found["first_left"] < 5.0
    assert not failing.ok


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


@pytest.mark.slow  # test_filter.py flies a deployment behind its filter
def test_flights_of_an_assessment_are_behind_the_filter(capsys):
    """--filter is the filter of --noise and --turbulence; without the noise it is refused."""
    words = ["assess", str(FOLDER / "ppo_gtm.toml"), "--aircraft", GTM, "--at", "45", "--best", "0"]
    words += ["--samples", "1", "--filter"]
    assert main(words) == 2
    assert "add --noise STATE=VALUE" in capsys.readouterr().err
    noise = [f"--noise={name}=0.1" for name in ("speed", "alpha", "pitch", "pitch_rate")]
    assert main([*words, *noise, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["points"][0]["in_air"]
    assert found["filter"]["noise"].keys() == {"speed", "alpha", "pitch", "pitch_rate"}
    assert found["held"] == 1


AIR = ["--turbulence", "moderate:40000"]
SENSORS = [f"--noise={name}" for name in ("speed=.3", "alpha=.17", "pitch=.11", "pitch_rate=.17")]


def flights_of(capsys, command, words):
    """Return the exit code and the data of the flights of a command from a trim."""
    code = main([command, "--dihedral", "10", *words, "--json"])
    data = json.loads(capsys.readouterr().out)
    if command == "assess":
        assert data["ok"] == (code == 0)
        (data,) = data["trims"]
    return code, data


def assert_same(one, other):
    """Assert that two reports have the same entries, numbers to 1e-9."""
    for name in one.keys() - {"provenance", "warnings", "store", "units"}:
        if isinstance(one[name], dict):
            assert_same(one[name], other[name])
        elif isinstance(one[name], (float, list)):
            np.testing.assert_allclose(one[name], other[name], rtol=1e-9, atol=1e-12)
        else:
            assert other[name] == one[name]


@pytest.mark.parametrize(
    ("words", "lost"),
    [
        (["--law", "exact", "--noise=speed=.3", "--samples", "2"], 2),
        pytest.param(["--law", "exact", *AIR, "--samples", "4"], 1, marks=pytest.mark.slow),
        pytest.param(["--law", "none", *AIR, "--samples", "4"], 0, marks=pytest.mark.slow),
        pytest.param(
            ["--law", "predictive", "--filter", *SENSORS, *AIR, "--samples", "1"],
            0,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_flights_of_a_law_are_those_of_fly(capsys, words, lost):
    """`assess --law` and `fly --law --samples` are the same flights, those that are lost too."""
    code, flown = flights_of(capsys, "fly", words)
    assessed = flights_of(capsys, "assess", words)
    assert assessed[0] == code == (1 if lost else 0)
    assert_same(flown, assessed[1])
    assert flown["members"] - flown["held"] == lost


def test_flights_of_a_policy_in_python_are_those_of_the_command(capsys):
    """hfa.assess flies a gain from two trims; the verdict is that of all of them."""
    words = ["--law", "exact", "--noise=speed=.3", "--samples", "2", "--seed", "4"]
    _, commanded = flights_of(capsys, "assess", words)
    model = hfa.aircraft()
    points = [hfa.trim(model, dihedral=np.radians(angle)) for angle in (10.0, 15.0)]
    gain = hfa.solve(hfa.paper.published_game(points[0].linearize())).K
    scenario = Scenario(20.0, uncertainty=Uncertainty(noise={"speed": 0.3}))
    flown = assess(model, gain, points, 2, seed=4, scenario=scenario)
    assert not flown.ok
    report = flown.report()
    assert report.title == "FAIL: law gain passes at 0 of 2 trims"
    assert_same({**commanded, "law": "gain"}, report.data["trims"][0])
    assert report.records.rows[0][1:] == (2, 0, 0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--law", "exact"], "add --noise STATE=VALUE or --turbulence"),
        (["--law", "none", "--noise=speed=.3", "--filter"], "--filter requires a policy"),
        (["--law", "exact", "--noise=speed=.3", "--box=speed=1"], "--box cannot be combined"),
        (["--law", "exact", "--noise=speed=.3", "--need", "margin=.5"], "--need margin cannot"),
        (["--law", "exact", "--noise=speed=.3", "--samples", "0"], "--samples is 0"),
        ([str(FOLDER / "ppo_gtm.toml"), "--law", "exact"], "both give a policy"),
        ([], "or add --law NAME with --noise or --turbulence"),
    ],
)
def test_flights_of_a_law_refuse_other_options(words, said, capsys):
    assert main(["assess", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scenario": None}, "the flights of the policy are all the same"),
        ({"box": {"speed": 1.0}}, "box applies only to a deployment"),
        ({"needs": {"margin": 0.5}}, "margin applies only to a deployment"),
    ],
)
def test_flights_of_a_policy_refuse_other_arguments(options, said):
    options = {"scenario": Scenario(uncertainty=NOISE)} | options
    with pytest.raises(hfa.BadInputError, match=said):
        assess(hfa.aircraft(), np.zeros((5, 6)), **options)
