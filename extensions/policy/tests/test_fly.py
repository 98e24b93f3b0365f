"""Simulation of deployment files with `hfa fly --policy`."""

import shutil
import warnings

import numpy as np
import pytest
from policy_cases import FOLDER, GTM, aircraft, flown_samples, stored_deployment, trims

from hfa.main import main
from hfa_flight.envelope import flight_envelope
from hfa_flight.flight import fly
from hfa_flight.held_step import held_step, parts_of_a_sample
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.policy import DeployedPolicy, flown_deployment, sampled_scenario
from hfa_flight.scenario import Scenario
from hfa_policy.episodes import Episodes
from hfa_policy.flights import SampledFlight
from hfa_support.errors import BadInputError

START = np.array([2.0, 0.03, 0.1, -0.05])


@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_fly_and_assess_simulate_equal_flights(tmp_path, delay):
    """`fly` and the flights of `assess` give equal states for one initial condition, with and
    without delay.
    """
    text = (FOLDER / "ppo_gtm.toml").read_text()
    text = text.replace('"ppo_gtm', f'"{FOLDER}/ppo_gtm')
    path = tmp_path / "deployment.toml"
    path.write_text(text.replace("dt = 0.02", f"dt = 0.02\ndelay = {delay}"))
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[0]
    policy = flown_deployment(path, point)
    scenario = Scenario(duration=4.0, initial=START).on(model)
    scenario = sampled_scenario(policy, scenario, point)
    flown = fly(
        model,
        point,
        policy,
        scenario=scenario,
        envelope=flight_envelope(model, point),
        predict=False,
    )
    deployed = Deployed(Deployment.load(path), model)
    flight = SampledFlight(deployed, 0.02, delay, parts_of_a_sample([point], 0.02))
    trim = deployed.trim_vector(point)
    start = np.array(point.states) + START
    path_of_rows = flown_samples(flight, start, trim, 200)[1:, flight.slices[0]]
    every_sample = round(0.02 / scenario.step)
    assert len(flown.states) == 200 * every_sample + 1
    np.testing.assert_allclose(flown.states[every_sample::every_sample], path_of_rows, rtol=1e-9)
    if delay == 0.0:
        differences = flown.states[every_sample::every_sample] - path_of_rows
        assert np.abs(differences).max() < 1e-12 * np.abs(path_of_rows).max()


def test_a_half_sample_delay_halves_integration_steps():
    """With a delay of 2.5 samples, a sample consists of two integration steps of half a sample.

    In floating point, 0.025 s minus two samples of 0.01 s is slightly above 0.005 s.
    """
    deployed = Deployed(stored_deployment("ppo_gtm"), aircraft("ppo_gtm"))
    point = trims("ppo_gtm")[0]
    flight = SampledFlight(deployed, 0.01, 0.025, parts=2)
    X = np.array(point.states) + START
    _, after = flown_samples(flight, X, deployed.trim_vector(point), 1)[:, flight.slices[0]]
    half = held_step(deployed.model, 0.005, 1)
    for _ in range(2):
        X = half(X, point.inputs, np.zeros(4), point.model.p)
    np.testing.assert_allclose(after, np.array(X).ravel(), rtol=1e-14)


def test_an_action_formula_undefined_at_trim_is_refused(tmp_path):
    """A deployment whose action formula has no value at the trim is refused in flights and in
    episodes.
    """
    text = (FOLDER / "ppo_gtm.toml").read_text().replace('"ppo_gtm', f'"{FOLDER}/ppo_gtm')
    path = tmp_path / "deployment.toml"
    path.write_text(text.replace("trim + 14*a", "trim + 14 * a + log(pitch_rate)"))
    model = aircraft("ppo_gtm")
    with pytest.raises(
        BadInputError, match=r"action\.throttle: the formula or the derivative is not finite"
    ):
        flown_deployment(path, trims("ppo_gtm")[0])
    with pytest.raises(
        BadInputError, match=r"action\.throttle: the formula or the derivative is not finite"
    ):
        Episodes(Deployed(Deployment.load(path), model), trims("ppo_gtm")[:1], 1)


@pytest.mark.parametrize(
    ("dt", "delay", "parts"),
    [(0.02, 0.03, 2), (1.0 / 60.0, 0.0, 1), (1.0 / 60.0, 0.5 / 60.0, 2), (1.0 / 60.0, 0.02, 5)],
)
def test_the_tick_divides_sample_time_and_delay(dt, delay, parts):
    """A tick is the greatest common divisor of sample time and delay, also at 60 Hz."""
    policy = deployed_policy(dt, delay)
    assert policy.tick == pytest.approx(dt / parts, rel=1e-12)
    scenario = sampled_scenario(policy, Scenario(), policy.point)
    assert scenario.tick == policy.tick


def test_a_delay_that_is_no_fraction_of_the_sample_time_is_refused():
    """A delay that no tick divides is refused, with the nearest delay that is possible."""
    with pytest.raises(BadInputError, match=r"timing\.delay is 0.013123456 s.*give 0\.0131"):
        _ = deployed_policy(0.02, 0.013123456).tick


def deployed_policy(dt, delay):
    """Return a policy for the GTM with this sample time and delay."""
    name = "ppo_gtm"
    timed = stored_deployment(name).changed(timing={"dt": dt, "delay": delay})
    deployed = Deployed(timed, aircraft(name))
    return DeployedPolicy("timed", deployed, trims(name)[0], held=np.zeros((1, 2)))


def file_without_normalizer(folder):
    """Write a deployment file without its policy's VecNormalize, and return its path."""
    right = (FOLDER / "ppo_gtm.toml").read_text()
    named = 'normalizer = "ppo_gtm.pkl"'
    assert named in right
    shutil.copy(FOLDER / "ppo_gtm.zip", folder)
    path = folder / "ppo_gtm.toml"
    path.write_text(right.replace(named, ""))
    return path


def test_a_flight_warns_of_a_proved_contradiction(tmp_path):
    """A flight of a deployment file warns of a contradiction that the policy's files prove.

    A correct deployment file causes no warning.
    """
    point = trims("ppo_gtm")[1]
    with pytest.warns(UserWarning, match="the policy was trained with a VecNormalize"):
        flown_deployment(file_without_normalizer(tmp_path), point)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flown_deployment(FOLDER / "ppo_gtm.toml", point)


@pytest.mark.parametrize("words", [["fly", "--start", "speed=1"], ["export", "-o", "FOLDER"]])
def test_fly_and_export_note_proved_contradictions(tmp_path, capsys, words):
    """`hfa fly` and `hfa export` print a note on a contradiction that the files prove."""
    given = [str(tmp_path / "out") if word == "FOLDER" else word for word in words]
    path = file_without_normalizer(tmp_path)
    where = ["--aircraft", GTM, "--hold", "speed=45", "--policy", str(path)]
    assert main([*given, *where]) == 0
    assert "note: the policy was trained with" in capsys.readouterr().err


def test_fly_accepts_the_path_of_a_policy(tmp_path):
    """`hfa.fly` with the path of a deployment file or a gain gives the flight of its content.

    A missing file is refused.
    """
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[0]
    path = FOLDER / "ppo_gtm.toml"
    by_name = fly(model, point, path, 0.2, initial={"alpha": 0.01})
    deployed = fly(model, point, Deployment.load(path), 0.2, initial={"alpha": 0.01})
    assert np.array_equal(by_name.states, deployed.states)
    K = np.full((len(model.inputs), len(model.linear)), 0.01)
    np.savez(tmp_path / "K.npz", K=K)
    by_name = fly(model, point, str(tmp_path / "K.npz"), 0.2, initial={"alpha": 0.01})
    assert np.array_equal(by_name.states, fly(model, point, K, 0.2, initial={"alpha": 0.01}).states)
    with pytest.raises(BadInputError, match=r"none\.toml cannot be read"):
        fly(model, point, "none.toml", 0.2)
