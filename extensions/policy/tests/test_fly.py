"""Simulation of deployment files with `hfa fly --policy`."""

import shutil

import casadi as ca
import numpy as np
import pytest
from policy_cases import FOLDER, GTM, aircraft, stored_deployment, trims

import hfa
from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.waveform import Waveform
from hfa_flight.flight import fly
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.policy import DeployedPolicy, sampled_scenario
from hfa_flight.scenario import Scenario
from hfa_support.errors import BadInputError


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


def test_a_command_that_arrives_at_a_sample_is_not_yet_observed():
    """U_k = 0.3 U_(k-2) + 0.1 of a policy that observes its torque, with a delay of one sample."""
    model = load_model("examples/pendulum.py:PENDULUM")
    o = ca.SX.sym("o", 1)
    deployment = Deployment(
        policy={"file": ca.Function("own", [o], [0.3 * o + 0.1])},
        observation={"torque": {}},
        action={"torque": {"box": [-1.0, 1.0]}},
        timing={"dt": 0.02, "delay": 0.02},
    )
    flight = fly(model, hfa.trim(model), deployment, 0.1, predict=False)
    np.testing.assert_allclose(flight.time[:5], 0.02 * np.arange(5))
    np.testing.assert_allclose(flight.inputs[:5, 0], [0.0, 0.1, 0.1, 0.13, 0.13], rtol=1e-9)


def test_moving_air_and_actuators_are_flown_in_fine_steps():
    policy = deployed_policy(0.02, 0.03)
    rain = {"gust_forward": Waveform(np.zeros(1), np.zeros(1))}
    still, moving = (
        sampled_scenario(policy, Scenario(0.123, 0.001, 0.041, air=air), policy.point)
        for air in ({}, rain)
    )
    assert still.duration == moving.duration == pytest.approx(0.12)
    assert still.step > moving.step
    assert moving.step <= 0.001
    assert moving.step * moving.steps_per_tick == pytest.approx(0.01)


def file_without_normalizer(folder):
    """Write a deployment file without its policy's VecNormalize, and return its path."""
    right = (FOLDER / "ppo_gtm.toml").read_text()
    named = 'normalizer = "ppo_gtm.pkl"'
    assert named in right
    shutil.copy(FOLDER / "ppo_gtm.zip", folder)
    path = folder / "ppo_gtm.toml"
    path.write_text(right.replace(named, ""))
    return path


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
