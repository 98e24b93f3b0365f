"""Deployment files as critics of `hfa verify`."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from policy_cases import FOLDER, GTM, ROOT, aircraft, stored_deployment, trims

import hfa as toolchain
from hfa import BadInputError
from hfa.main import BAD_INPUT, FAILED

PPO_FILE = FOLDER / "ppo_hfa.toml"
#: Observation -> scale in this file, and moved input -> factor of its map, in the order of the file.
SCALES = {
    **{"speed": 10.0, "alpha": 0.1, "pitch": 0.1, "pitch_rate": 0.2},
    **{"dihedral": 0.1, "dihedral_rate": 0.2},
}
MOVED = {
    **{"throttle": 15.0, "aileron_outer": 0.15},
    **{"elevator_center": 0.15, "elevator_outer": 0.15},
}


def test_a_deployment_file_is_read_as_a_critic_of_deviations_and_inputs_in_their_units():
    """The file's policy observes z / scale and returns actions, which its map multiplies by a factor. The
    critic has u(z) of deviations z: at z = scale times a stored observation it is the factor times the
    stored action of Stable-Baselines3 in float64. Its slope at 0 is -K.

    The game has the four inputs that the file moves, MOVED, in reversed order.
    """
    linear = toolchain.trim(toolchain.aircraft(), dihedral=np.radians(8.0)).linearize()
    game = toolchain.paper.published_game(linear).select(tuple(reversed(MOVED)))
    critic = toolchain.read_critic(PPO_FILE, game, linear=linear)
    for entry in json.loads((FOLDER / "slopes.json").read_text())["ppo_hfa"]:
        values = entry["observation"] * np.array([*SCALES.values()])
        deviations = dict(zip(SCALES, values, strict=True))
        u = critic.u([deviations[name] for name in linear.states])
        expected = entry["action"] * np.array([*MOVED.values()])
        assert u == pytest.approx(expected[::-1], abs=1e-10)
    z = np.zeros(6)
    slope = np.array([(critic.u(z + e) - critic.u(z - e)) / 2e-6 for e in 1e-6 * np.eye(6)]).T
    assert pytest.approx(-slope, rel=1e-6, abs=1e-5) == critic.K


def test_a_weight_of_an_option_replaces_that_of_the_deployment(folder):
    """A typed R replaces that of the deployment file, whose Q remains."""
    np.savez("K.npz", K=[[2.0, 0.6]])
    Path("stated.toml").write_text(
        "[policy]\nfile = 'K.npz'\n[observation]\nangle = {}\nrate = {}\n"
        "[action]\ntorque = {}\n[timing]\ndt = 0.02\n"
        "[cost]\nQ = {angle = 2.0}\nR = {torque = 3.0}\n"
    )
    plant = f"{ROOT}/examples/pendulum.py:PENDULUM"
    words = ("--aircraft", plant, "--hold", "angle=0", "--weights", "stated.toml", "--R", "5")
    data = answer("verify", *words, code=FAILED)
    assert (data["Q"], data["R"]) == ([[2.0, 0.0], [0.0, 0.0]], [[5.0]])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--weights stated.toml --flights 0 --inputs throttle", "add --inputs elevator,throttle"),
        ("--weights observed.toml", "an observation depends on the inputs"),
        ("--weights stated.toml --inputs throttle,flap", "unknown input 'flap'"),
        ("--weights stated.toml --network policy=actor", "remove --basis, --network"),
    ],
)
def test_contradictions_with_a_deployment_are_refused(folder, words, said):
    """Other inputs, an observation of an input, and options of a critic: one line says the remedy."""
    text = (FOLDER / "td3_gtm.toml").read_text().replace("td3_gtm.", f"{FOLDER}/td3_gtm.")
    Path("stated.toml").write_text(text)
    # This one observes the throttle, an input, in place of the output gamma.
    Path("observed.toml").write_text(text.replace("gamma = {", "throttle = {"))
    assert_refused(hfa("verify", "--aircraft", GTM, *words.split()), BAD_INPUT, said)


def test_the_deployment_of_an_environment_is_saved_with_a_policy(tmp_path):
    """The file has the files of the policy and the cost 1/nominal². Without a policy's file, or with
    another suffix than .toml, nothing is written.
    """
    model = aircraft("ppo_gtm")
    made = toolchain.environment(model, points=trims("ppo_gtm")[:1]).unwrapped.deployment
    with pytest.raises(BadInputError, match=r'changed\(policy=\{"file": "ppo.zip"\}\)'):
        made.save(tmp_path / "none.toml")
    with pytest.raises(BadInputError, match=r"x\.json: a deployment file is TOML"):
        made.save(tmp_path / "x.json")
    assert not [*tmp_path.iterdir()]
    files = {"file": FOLDER / "ppo_gtm.zip", "normalizer": FOLDER / "ppo_gtm.pkl"}
    made.changed(policy=files).save(tmp_path / "ppo.toml")
    saved = toolchain.Deployment.load(tmp_path / "ppo.toml")
    for weights, signals in (("Q", model.states), ("R", model.inputs)):
        expected = {name: signal.nominal**-2.0 for name, signal in signals.items()}
        assert saved.cost[weights] == pytest.approx(expected)
    o = np.linspace(-0.4, 0.5, 4)
    actor = stored_deployment("ppo_gtm").actor
    for each in (saved, pickle.loads(pickle.dumps(saved))):
        np.testing.assert_array_equal(each.actor.function(o), actor.function(o))
