"""Errors in deployment files, and files that are read without executing their code."""

import base64
import io
import json
import pickle
import shutil
import zipfile

import casadi as ca
import numpy as np
import pytest
from policy_cases import FOLDER, GTM, ZIPS, gtm_deployment, model_of, stored_deployment
from tolerances import FEW_ROUNDINGS

import hfa
from hfa import BadInputError, Deployment, assess
from hfa_flight import Deployed

DEPLOYMENT = """
[policy]
file = "ppo_gtm.zip"
normalizer = "ppo_gtm.pkl"
[observation]
speed = {scale = 20.0}
alpha = {scale = 0.35}
pitch_rate = {scale = 1.0}
pitch = {scale = 0.35}
[action]
elevator = {box = [-1, 1], map = "trim + 0.3 * a"}
throttle = {box = [-1, 1], map = "trim + 14 * a"}
[timing]
dt = 0.02
[cost]
Q = {speed = 0.0025}
R = {elevator = 1.11, throttle = 0.00051}
"""


@pytest.fixture
def folder(tmp_path):
    for name in ("ppo_gtm.zip", "ppo_gtm.pkl", "sac_gtm.zip", "td3_gtm.pkl", "ppo_c172.pkl"):
        shutil.copy(FOLDER / name, tmp_path)
    return tmp_path


def compiled(path):
    """Load a deployment file and return its command, compiled for the GTM."""
    return Deployed(Deployment.load(path), model_of(GTM)).command


def message_of(folder, text):
    """Write a deployment file, and return the message with which the file is refused.

    Asserts that the message is one line.
    """
    (folder / "deployment.toml").write_text(text)
    with pytest.raises(BadInputError) as caught:
        compiled(folder / "deployment.toml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("typed", "instead", "said"),
    [
        ("[timing]", "[timming]", "unknown entry timming; did you mean timing?"),
        ("[timing]\ndt = 0.02", "", "timing is missing; add the table"),
        ("dt = 0.02", "dt = 0.02\ndelay = 1e9", "timing.delay is 1e+09 s; give at most 2 s (100 samples)"),
        ('file = "ppo_gtm.zip"', 'file = "ppo_gtm.py"', "give a file with the suffix .onnx"),
        ("speed = {scale = 20.0}", "speed = {scale = 0}", "observation.speed.scale is 0"),
        ("speed = {scale = 20.0}", 'speed = {about = "start"}', 'give "trim" or a number'),
        ("box = [-1, 1], map = \"trim + 14", "box = [1, -1], map = \"trim + 14", "[lowest, highest]"),
        ('normalizer = "ppo_gtm.pkl"', 'activation = "relu"', "contains 'tanh'; remove activation"),
        ('normalizer = "ppo_gtm.pkl"', 'normalizer = "ppo_c172.pkl"', "normalizes 8 observations"),
        ('"ppo_gtm.pkl"', "{mean = [0, 0]}", "policy.normalizer: variance is missing"),
        ("R = {elevator = 1.11, ", "R = {", "cost.R has no weight for elevator"),
    ],
)  # fmt: skip
def test_mistakes_in_deployment_files_are_refused(folder, typed, instead, said):
    """A mistake, `instead` of what is `typed` in DEPLOYMENT, is refused in one line that names the entry
    and the correction.
    """
    assert typed in DEPLOYMENT
    assert said in message_of(folder, DEPLOYMENT.replace(typed, instead))


@pytest.mark.parametrize(
    "formula",
    [
        "__import__('os').system('true')",
        "speed if alpha else 0",
        "lambda: 0",
        "open('x')",
        "9**9**9**9 + exec('1')",
        "1" * 400 + "e999 + speed",
        "(" * 260 + "speed" + ")" * 260,
        "speed +",
        "sin(speed, 2)",
    ],
)
def test_formulas_that_are_code_are_refused(formula):
    """Formulas that are more than arithmetic of numbers, names and supported functions are refused."""
    observation = {"speed": {}, "alpha": {}, "pitch": {}, "odd": {"formula": formula}}
    deployment = gtm_deployment({"file": FOLDER / "ppo_raw.zip"}, observation=observation)
    with pytest.raises(BadInputError, match=r"formula|unknown name|calls|arithmetic"):
        Deployed(deployment, model_of(GTM))


def test_formulas_are_evaluated():
    """The formulas of observations and actions are evaluated at a state and its trim. The output gamma
    is pitch - alpha, too, and the action is the first observation.
    """
    entries = {"flow": {"formula": "pitch - alpha", "about": 0.0}, "gamma": {"about": 0.0}}
    o = ca.SX.sym("o", 2)
    deployment = gtm_deployment(
        {"file": ca.Function("policy", [o], [o[0]])},
        observation=entries,
        action={"elevator": {"map": "trim + 0.1 * sin(a) - 2 ** 2 * pitch_rate"}},
    )
    deployed = Deployed(deployment, model_of(GTM))
    X = np.array([45.0, 0.05, 0.1, 0.07])  # speed, alpha, pitch rate and pitch
    trim = np.array([45.0, 0.05, 0.0, 0.05, 0.02, 15.0])  # these, elevator and throttle
    observed = np.array(deployed.observe(X, trim[4:], trim)).ravel()
    np.testing.assert_allclose(observed, [0.02, 0.02], atol=1e-15)
    inputs = np.array(deployed.command(X, trim[4:], trim)).ravel()
    np.testing.assert_allclose(inputs, [0.02 + 0.1 * np.sin(0.02) - 0.4, 15.0], rtol=FEW_ROUNDINGS)


class Caller:
    """Object whose pickle calls a function when it is loaded."""

    def __reduce__(self):
        return open, ("made", "w")


def pickled(value):
    """Return a Python object, or its pickle, as an entry of the data of a zip."""
    content = value if isinstance(value, bytes) else pickle.dumps(value)
    return {":serialized:": base64.b64encode(content).decode()}


def rewrite_zip(folder, more=None):
    """Rewrite the policy's zip in a folder with more data."""
    rewritten = io.BytesIO()
    with (
        zipfile.ZipFile(FOLDER / "ppo_gtm.zip") as archive,
        zipfile.ZipFile(rewritten, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        new.writestr("data", json.dumps(json.loads(archive.read("data")) | (more or {})))
        new.writestr("policy.pth", archive.read("policy.pth"))
    (folder / "ppo_gtm.zip").write_bytes(rewritten.getvalue())


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"action_space": pickled(Caller())}, "would call"),
        ({"action_space": {":serialized:": 5}}, "action_space: the entry is not base64"),
        ({"policy_kwargs": [1]}, "policy_kwargs is not a dictionary"),
        ({"policy_class": pickled(BadInputError)}, "hfa_support.errors.BadInputError"),
        ({"policy_class": pickled(json.JSONEncoder)}, "policy_class"),
        ({"policy_kwargs": pickled({"scale_inputs": True})}, "'scale_inputs'"),
        (
            {
                "policy_kwargs": pickled(
                    b"(dS'activation_fn'\nctorch.nn.modules.activation\nOdd\ns."
                )
            },
            "unknown activation 'Odd'",
        ),
    ],
)
def test_a_zip_that_stable_baselines3_does_not_write_is_refused_and_not_run(
    folder, monkeypatch, more, said
):
    """Zips that would call a function, with entries that Stable-Baselines3 does not write, or with
    other classes are refused, and nothing is called: a call of `Caller` would make the file `made`.
    """
    monkeypatch.chdir(folder)
    rewrite_zip(folder, more)
    assert said in message_of(folder, DEPLOYMENT)
    assert not (folder / "made").exists()


@pytest.fixture
def damaged(folder, monkeypatch):
    """Write damaged files beside the deployment file, and work in their folder."""
    monkeypatch.chdir(folder)
    (folder / "calls.pkl").write_bytes(pickle.dumps(Caller()))
    (folder / "empty.pkl").write_bytes(b"")
    K = np.full((2, 4), np.nan)
    np.savez("K.npz", K=K)
    np.savez("flat.npz", K=np.ones(4))
    np.savez("net.npz", **{"0.weight": K, "0.bias": np.zeros(2)})
    # Tensors besides the layers, such as CleanRL's action_scale, are left to ONNX.
    layers = {"fc_mu.weight": np.ones((2, 4)), "fc_mu.bias": np.zeros(2)}
    np.savez("actor.npz", **layers, action_scale=np.ones(2))


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("calls.pkl", "would call"),
        ("empty.pkl", "empty.pkl: the file is damaged or has another format"),
        ("K.npz", "give finite entries"),
        ("flat.npz", "returns 1 actions"),
        ("net.npz", "not finite"),
        ("actor.npz", "is not a weight or bias"),
    ],
)
def test_damaged_files_are_refused(folder, damaged, file, said):
    """Normalizers whose pickles call or are empty, and policies that are of another size
    or contain numbers that are not finite, are refused in one line, and nothing is called.
    """
    replaced = "ppo_gtm.pkl" if file.endswith(".pkl") else "ppo_gtm.zip"
    assert said in message_of(folder, DEPLOYMENT.replace(replaced, file))
    assert not (folder / "made").exists()


NORMALIZED = {"mean": [0.0] * 4, "variance": [1.0] * 4}


@pytest.mark.parametrize(
    ("policy", "said"),
    [
        ({"file": 5}, "policy.file is 5"),
        ({"file": ca.Function("f", [ca.SX.sym("o", 3)], [ca.SX.zeros(2)])}, "requires 3 observa"),
        ({"file": ca.Function("f", [ca.SX.sym("o", 4)], [ca.SX.zeros(3)])}, "returns 3 actions"),
        ({"file": ca.Function("f", [o := ca.SX.sym("o", 4)], [ca.log(o[:2] - 1.0)])}, "not finite"),
        (
            {"normalizer": NORMALIZED | {"variance": [0.0] * 4, "epsilon": 0.0}},
            "plus epsilon is po",
        ),
    ],
)
def test_policies_that_do_not_fit_are_refused(policy, said):
    """A policy of other sizes, one that is nan at the trim, where the observations are 0, and a wrong
    normalizer are refused in one line.
    """
    o = ca.SX.sym("o", 4)
    usual = {"file": ca.Function("f", [o], [o[:2]])}
    with pytest.raises(BadInputError) as caught:
        assess(model_of(GTM), gtm_deployment(usual | policy), [45.0], samples=0)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_squashed_actions_need_a_box_and_reach_its_ends():
    """Squashed actions are low + (tanh + 1) / 2 (high - low). Without a box they are refused."""
    o = ca.SX.sym("o", 4)
    policy = {"file": ca.Function("f", [o], [o[:2]]), "squash": True}
    with pytest.raises(BadInputError, match="squashed actions requires a box for each action"):
        _ = gtm_deployment(policy, action={"elevator": {"box": [-1, 3]}, "throttle": {}}).box
    action = {"elevator": {"box": [-1, 3]}, "throttle": {"box": [0, 5]}}
    act = Deployed(gtm_deployment(policy, action=action), model_of(GTM)).act
    for raw in (-40.0, -0.3, 0.0, 2.0, 40.0):  # tanh of ±40 is ±1
        share = 0.5 * (np.tanh(raw) + 1.0)
        found = np.array(act([raw, raw, 0.0, 0.0])).ravel()
        np.testing.assert_allclose(found, [-1.0 + 4.0 * share, 5.0 * share], atol=1e-12)


@pytest.mark.parametrize("name", ["ppo", "ppo_squash", "sac"])
def test_a_deployment_of_a_zip_has_the_actions_of_its_critic(name):
    """A deployment of a zip has the actions of `read_critic` bit by bit, with the tanh (squash), clip and
    box of the file. Another box or squash in the deployment is refused.
    """
    file = ZIPS / f"{name}.zip"
    tables = {"observation": {name: {} for name in ("speed", "alpha", "pitch")}}
    deployment = gtm_deployment({"file": file}, **tables)
    game = hfa.Game(-np.eye(3), np.ones((3, 2)), Q=np.ones(3), R=np.ones(2))
    observed = 2.0 * np.random.default_rng(2).normal(size=(50, 3))
    actions = np.array(Deployed(deployment, model_of(GTM)).act(observed.T)).T
    np.testing.assert_array_equal(actions, hfa.read_critic(file, game).u(observed))
    assert deployment.actor.declared.notes == hfa.read_critic(file, game).declared.notes
    for policy, box, said in (
        ({}, [-1.0, 1.0], "contains the box"),
        ({"squash": name == "ppo"}, [-1.0, 2.0], "remove policy.squash"),
    ):
        action = {"elevator": {"box": box}, "throttle": {}}
        with pytest.raises(BadInputError, match=said):
            _ = gtm_deployment({"file": file, **policy}, action=action, **tables).actor


def test_a_normalizer_of_dictionary_observations_acts_as_that_of_stable_baselines3():
    """The observations of this policy are a dictionary, whose entries are in the order of its space. With
    the normalizer it acts as the policy alone does on observations that Stable-Baselines3 has
    normalized (`VecNormalize.normalize_obs`, clip 1.5), and otherwise than alone on the same ones.
    """
    stored = json.loads((ZIPS / "actions.json").read_text())
    observed, normalized = stored["observations"], stored["normalized by sac_dict.pkl"]
    tables = {"observation": {name: {} for name in ("speed", "alpha", "pitch")}}
    behind, alone = (
        Deployed(gtm_deployment({"file": ZIPS / "sac_dict.zip", **entry}, **tables), model_of(GTM))
        for entry in ({"normalizer": ZIPS / "sac_dict.pkl"}, {})
    )
    actions = np.array(behind.act(np.transpose(observed)))
    np.testing.assert_allclose(actions, alone.act(np.transpose(normalized)), atol=1e-6)
    assert np.abs(actions - np.array(alone.act(np.transpose(observed)))).max() > 0.1


def test_a_normalizer_that_saw_more_observations_than_the_training_is_noted(folder):
    """A normalizer that was saved with a policy of PPO has seen an observation of each training step, and
    at most one more of each environment. One that has seen more is noted, also by `hfa verify`.
    """
    steps = json.loads(zipfile.ZipFile(FOLDER / "ppo_gtm.zip").read("data"))["num_timesteps"]
    (folder / "deployment.toml").write_text(DEPLOYMENT)
    point = hfa.trim(model_of(GTM), at=45.0)
    linear = hfa.linearize(model_of(GTM), point)
    game = hfa.game(linear, Q=np.ones(4), R=np.ones(2))
    # The training is said to have had so many steps less than the normalizer has seen.
    for less, environments, is_told in ((0, 16, False), (2000, 5000, False), (2000, 16, True)):
        rewrite_zip(folder, {"num_timesteps": steps - less, "n_envs": environments})
        critic = hfa.read_critic(folder / "deployment.toml", game, linear=linear)
        noted = f"but the policy was trained with {steps - less}: it was not saved with this policy"
        assert any(noted in note for note in critic.declared.notes) == is_told
    assert noted in " ".join(hfa.verify(game, critic, flights=0).report().text().split())


def test_an_assessment_warns_of_a_missing_normalizer_and_of_one_of_another_training():
    """A missing normalizer and one of another training give one warning each. Only with that of its own
    training the loop has the spectral radius of the stored deployment.
    """
    stored = stored_deployment("ppo_gtm")
    radius = assess(model_of(GTM), stored, [45.0], samples=0).points[0].radius
    for policy, said in (
        ({}, "trained behind a VecNormalize"),
        ({"normalizer": FOLDER / "ppo_squash.pkl"}, "saw 516 observations"),  # of another training
        ({"normalizer": FOLDER / "ppo_gtm.pkl"}, ""),
    ):
        files = {"file": FOLDER / "ppo_gtm.zip", **policy}
        found = assess(model_of(GTM), stored.changed(policy=files), [45.0], samples=0)
        warned = [finding.text for finding in found.findings if "normali" in finding.text.lower()]
        assert len(warned) == bool(said)
        assert all(said in text for text in warned)
        assert (found.points[0].radius == radius) == (said == "")
