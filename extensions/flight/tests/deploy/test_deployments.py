"""Errors in deployment files, and files that are read without executing their code."""

import base64
import dataclasses
import io
import json
import math
import os
import pickle
import shutil
import zipfile

import casadi as ca
import numpy as np
import pytest
from policy_cases import FOLDER, GTM, gtm_deployment, model_of, stored_deployment
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
        ("[timing]", "[timming]", "unknown table 'timming'; did you mean timing?"),
        ("[timing]\ndt = 0.02", "", "the table [timing] is missing"),
        ('normalizer = "ppo_gtm.pkl"', "squash = 1", "policy.squash is 1; give true or false"),
        ('normalizer = "ppo_gtm.pkl"', "normalizer = 1", "policy.normalizer is"),
        ("dt = 0.02", "dt = 0.0", "timing.dt is 0.0; give a finite number of at least 0.0001, at most 10"),
        ("dt = 0.02", "dt = 0.02\ndelay = 1e9", "timing.delay is 1e+09 s; give at most 2 s (100 samples)"),
        ("dt = 0.02", "delay = 0.02", "timing.dt is missing"),
        ("dt = 0.02", "dt = 0.02\ndelay = -1", "timing.delay is -1"),
        ('file = "ppo_gtm.zip"', "", "policy.file is missing"),
        ('file = "ppo_gtm.zip"', 'file = "other.zip"', "other.zip"),
        ('normalizer = "ppo_gtm.pkl"', 'normalizer = "no.pkl"', "no.pkl cannot be read"),
        ('file = "ppo_gtm.zip"', "file = {name = 1}", "give the path of the file that contains the policy"),
        ('file = "ppo_gtm.zip"', 'file = "ppo_gtm.py"', "give a file with the suffix .zip"),
        ("speed = {scale = 20.0}", "sped = {}", "contains the unknown name 'sped'"),
        ("speed = {scale = 20.0}", "speed = {skale = 20.0}", "did you mean scale?"),
        ("speed = {scale = 20.0}", "speed = {scale = 0}", "observation.speed.scale is 0"),
        ("speed = {scale = 20.0}", 'speed = {about = "start"}', 'give "trim" or a number'),
        ("speed = {scale = 20.0}", "", "requires 4 observations, but the deployment file lists 3"),
        ("throttle = {box", "elevator_2 = {box", "action names the unknown input 'elevator_2'"),
        ("box = [-1, 1], map = \"trim + 14", "box = [-2, 1], map = \"trim + 14", "but the policy contains"),
        ("box = [-1, 1], map = \"trim + 14", "box = [1, -1], map = \"trim + 14", "[lowest, highest]"),
        ('"trim + 14 * a"', '"trim + 14 * b"', "contains the unknown name 'b'"),
        ('"trim + 14 * a"', '"trim"', "does not contain the action"),
        ("[timing]", 'extra = 1\n[timing]', "action.extra is 1"),
        ('normalizer = "ppo_gtm.pkl"', 'activation = "relu"', "'tanh'; remove policy.activation"),
        ('normalizer = "ppo_gtm.pkl"', "squash = true", "False; remove policy.squash"),
        ('normalizer = "ppo_gtm.pkl"', "layout = [32, 32]", "[16, 16]; remove policy.layout"),
        ('normalizer = "ppo_gtm.pkl"', 'normalizer = "ppo_c172.pkl"', "normalizes 8 observations"),
        ('"ppo_gtm.pkl"', "{mean = [0, 0]}", "policy.normalizer: variance is missing"),
        ('"ppo_gtm.pkl"', "{mean = [0], variance = [-1]}", "variance[0] is -1"),
        ("Q = {speed", "Q = {sped", "cost.Q names the unknown state or output 'sped'"),
        ("R = {elevator = 1.11, ", "R = {", "cost.R has no weight for elevator"),
    ],
)  # fmt: skip
def test_mistakes_in_deployment_files_are_refused(folder, typed, instead, said):
    """A mistake in a deployment file is refused with a message that names the entry and the
    correction.
    """
    assert typed in DEPLOYMENT
    assert said in message_of(folder, DEPLOYMENT.replace(typed, instead))


@pytest.mark.parametrize(
    "formula",
    [
        "__import__('os').system('true')",
        "(1).__class__",
        "speed if alpha else 0",
        "[speed for speed in (1,)]",
        "lambda: 0",
        "speed; alpha",
        "'speed' * 9",
        "open('x')",
        "speed[0]",
        "9**9**9**9 + exec('1')",
        "1" * 400 + "e999 + speed",
        "(" * 260 + "speed" + ")" * 260,
        "True + speed",
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
    """The formulas of observations and actions are evaluated at a state and its trim."""
    entries = {"flow": {"formula": "pitch - alpha", "about": 0.0}, "gamma": {"about": 0.0}}
    o = ca.SX.sym("o", 2)
    deployment = gtm_deployment(
        {"file": ca.Function("policy", [o], [o[0]])},
        observation=entries,
        action={"elevator": {"map": "trim + 0.1 * sin(a) - 2 ** 2 * pitch_rate"}},
    )
    deployed = Deployed(deployment, model_of(GTM))
    X = np.array([45.0, 0.05, 0.1, 0.07])
    trim = np.array([45.0, 0.05, 0.0, 0.05, 0.02, 15.0])
    observed = np.array(deployed.observe(X, trim[4:], trim)).ravel()
    np.testing.assert_allclose(observed, [0.02, 0.02], atol=1e-15)
    inputs = np.array(deployed.command(X, trim[4:], trim)).ravel()
    np.testing.assert_allclose(inputs, [0.02 + 0.1 * np.sin(0.02) - 0.4, 15.0], rtol=FEW_ROUNDINGS)


class Caller:
    """Object whose pickle calls a function when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (self.path, "w")


def test_a_pickle_with_a_call_is_not_run(folder):
    """A pickle that would call a function is refused, and the function is not called."""
    made = folder / "made"
    (folder / "calls.pkl").write_bytes(pickle.dumps(Caller(str(made))))
    said = message_of(folder, DEPLOYMENT.replace("ppo_gtm.pkl", "calls.pkl"))
    assert "would call" in said
    assert not made.exists()


def rewrite_zip(folder, changed):
    """Rewrite the policy's zip in a folder with changed data.

    changed: data of the zip -> changed data
    """
    rewritten = io.BytesIO()
    with (
        zipfile.ZipFile(folder / "ppo_gtm.zip") as archive,
        zipfile.ZipFile(rewritten, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        new.writestr("data", json.dumps(changed(json.loads(archive.read("data")))))
        new.writestr("policy.pth", archive.read("policy.pth"))
    (folder / "ppo_gtm.zip").write_bytes(rewritten.getvalue())


def test_a_zip_with_a_call_is_not_run(folder):
    """A zip whose data would call a function is refused, and the function is not called."""
    made = folder / "made"
    call = base64.b64encode(pickle.dumps(Caller(str(made)))).decode()
    rewrite_zip(folder, lambda data: data | {"action_space": {":serialized:": call}})
    assert "would call" in message_of(folder, DEPLOYMENT)
    assert not made.exists()


def test_an_empty_normalizer_is_refused(folder):
    """An empty pickle is refused, with the name of its file."""
    (folder / "empty.pkl").write_bytes(b"")
    said = message_of(folder, DEPLOYMENT.replace("ppo_gtm.pkl", "empty.pkl"))
    assert "empty.pkl: the data are not a pickle" in said


@pytest.mark.parametrize(
    ("stored", "said"),
    [
        (b"epsilon", "does not contain a VecNormalize object"),
        (b"clip_obs", "does not contain a VecNormalize object"),
        (b"obs_rms", "contains no obs_rms"),
        (b"mean", "its mean does not consist of rows of real numbers"),
        (b"var", "its var does not consist of rows of real numbers"),
    ],
)
def test_a_normalizer_without_its_numbers_is_refused(folder, stored, said):
    """A normalizer file in which one required entry has another name of equal length is refused."""
    content = (folder / "ppo_gtm.pkl").read_bytes()
    name = b"\x8c" + bytes([len(stored)]) + stored
    assert name in content
    (folder / "odd.pkl").write_bytes(content.replace(name, name[:-1] + b"z", 1))
    assert said in message_of(folder, DEPLOYMENT.replace("ppo_gtm.pkl", "odd.pkl"))


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"action_space": {":serialized:": 5}}, "action_space: the entry is not base64"),
        ({"policy_kwargs": [1]}, "policy_kwargs is not a dictionary"),
    ],
)
def test_a_zip_entry_of_wrong_type_is_refused(folder, entries, said):
    """A zip with an entry of a wrong type is refused, with the name of the entry."""
    rewrite_zip(folder, lambda data: data | entries)
    assert said in message_of(folder, DEPLOYMENT)


@pytest.mark.parametrize(
    ("entries", "named"),
    [
        ({"policy_class": pickle.dumps(BadInputError)}, "hfa_support.errors.BadInputError"),
        ({"policy_class": pickle.dumps(json.JSONEncoder)}, "policy_class"),
        ({"policy_kwargs": pickle.dumps({"scale_inputs": True})}, "'scale_inputs'"),
        (
            {"policy_kwargs": pickle.dumps({"features_extractor_class": "Own"})},
            "features_extractor_class",
        ),
    ],
)
def test_a_zip_of_another_class_is_refused(folder, entries, named):
    """A zip that contains another class is refused, with the name of the class."""
    stored = {
        name: {":serialized:": base64.b64encode(content).decode()}
        for name, content in entries.items()
    }
    rewrite_zip(folder, lambda data: data | stored)
    assert named in message_of(folder, DEPLOYMENT)


def test_a_checkpoint_with_a_scale_of_actions_is_refused(folder):
    """Tensors besides the layers, such as CleanRL's action_scale, are left to ONNX."""
    weights = {"fc_mu.weight": np.ones((2, 4)), "fc_mu.bias": np.zeros(2)}
    np.savez(folder / "actor.npz", **weights, action_scale=np.ones(2))
    with pytest.raises(BadInputError, match=r"'action_scale' .* is not a weight or bias"):
        _ = gtm_deployment({"file": folder / "actor.npz"}).actor


def test_a_zip_with_a_wrong_size_is_refused(folder):
    """A zip whose directory states a wrong size is refused."""
    rewrite_zip(folder, lambda data: data | {"more": " " * 10**6})
    content = (folder / "ppo_gtm.zip").read_bytes()
    entry = content.index(b"PK\x01\x02")
    size = slice(entry + 24, entry + 28)
    lying = content[: size.start] + (100).to_bytes(4, "little") + content[size.stop :]
    (folder / "ppo_gtm.zip").write_bytes(lying)
    assert "not a zip file of Stable-Baselines3" in message_of(folder, DEPLOYMENT)


@pytest.mark.parametrize("suffix", ["zip", "npz", "pt", "pkl"])
def test_a_fifo_is_refused(folder, suffix):
    """A named pipe is refused as a policy file, for each suffix."""
    os.mkfifo(folder / f"fifo.{suffix}")
    said = message_of(folder, DEPLOYMENT.replace("ppo_gtm.zip", f"fifo.{suffix}"))
    assert "not a regular file" in said


def test_a_zip_bomb_is_refused(folder):
    """A zip whose unpacked size exceeds the limit is refused."""
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w") as archive:
        archive.writestr("data", b"0")
        archive.writestr("policy.pth", b"0")
        archive.getinfo("data").file_size = 2**28 + 1
    (folder / "ppo_gtm.zip").write_bytes(bomb.getvalue())
    assert "unpacks to" in message_of(folder, DEPLOYMENT)


def test_a_network_of_nan_is_refused(folder):
    """A gain and a network with entries that are not finite are refused."""
    K = np.full((2, 4), np.nan)
    np.savez(folder / "nan.npz", K=K)
    assert "finite numbers" in message_of(folder, DEPLOYMENT.replace("ppo_gtm.zip", "nan.npz"))
    np.savez(folder / "net.npz", **{"0.weight": K, "0.bias": np.zeros(2)})
    assert "not finite" in message_of(folder, DEPLOYMENT.replace("ppo_gtm.zip", "net.npz"))


@pytest.mark.parametrize(
    ("name", "said"),
    [("data", "not a zip file of Stable-Baselines3"), ("policy.pth", "not written by torch.save")],
)
def test_a_damaged_zip_is_refused(folder, name, said):
    """A damaged member of the zip is reported in a message with the names of both files."""
    rewritten = io.BytesIO()
    with zipfile.ZipFile(folder / "ppo_gtm.zip") as archive, zipfile.ZipFile(rewritten, "w") as new:
        for member in ("data", "policy.pth"):
            new.writestr(member, b"{" if member == name else archive.read(member))
    (folder / "ppo_gtm.zip").write_bytes(rewritten.getvalue())
    message = message_of(folder, DEPLOYMENT)
    assert message.startswith(f"{folder}/deployment.toml: {folder}/ppo_gtm.zip: ")
    assert said in message


def test_gains_and_state_dicts_give_equal_actions(tmp_path):
    """A gain K and a state dict with the weights -K both give the action -K o."""
    K = np.array([[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8]])
    np.savez(tmp_path / "gain.npz", K=K)
    np.savez(tmp_path / "layer.npz", **{"weight": -K, "bias": np.zeros(2)})
    observation = np.array([1.0, -2.0, 0.5, 3.0])
    for name in ("gain.npz", "layer.npz"):
        deployment = gtm_deployment({"file": tmp_path / name})
        action = np.array(Deployed(deployment, model_of(GTM)).act(observation)).ravel()
        np.testing.assert_allclose(action, -K @ observation, rtol=FEW_ROUNDINGS)


@pytest.mark.parametrize(
    ("name", "activation"), [("ReLU", "relu"), ("ELU", "elu"), ("Tanh", "tanh"), ("Odd", None)]
)
def test_the_activation_of_a_zip_is_read_or_refused(folder, name, activation):
    """`policy_kwargs` with a class of PyTorch, which is not imported, as the layers alone with it."""
    pickled = f"(dS'activation_fn'\nctorch.nn.modules.activation\n{name}\ns.".encode()
    entry = {":serialized:": base64.b64encode(pickled).decode()}
    rewrite_zip(folder, lambda data: data | {"policy_kwargs": entry})
    if activation is None:
        assert "Odd is not supported" in message_of(folder, DEPLOYMENT)
        return
    with zipfile.ZipFile(folder / "ppo_gtm.zip") as archive:
        archive.extract("policy.pth", folder)
    layers = {"file": folder / "policy.pth", "network": "policy_net+action_net"}
    known = gtm_deployment({**layers, "activation": activation}).actor.function
    found = gtm_deployment({"file": folder / "ppo_gtm.zip"}).actor.function
    o = np.array([1.0, -2.0, 0.5, 3.0])
    np.testing.assert_array_equal(found(o), known(o))


def test_spaces_that_are_no_flat_box_are_refused(folder):
    """Another kind of space, a box of two axes, and limits in the wrong order."""
    spaces = pytest.importorskip("gymnasium").spaces
    turned = spaces.Box(-1.0, 1.0, (2,))
    turned.low = np.array([2.0, -1.0])
    for space, said in (
        (spaces.Discrete(3), "is a Discrete, but only a Box is supported"),
        (spaces.Box(-1.0, 1.0, (2, 2)), "the Box of the actions has 2 axes"),
        (turned, "the Box of the actions has a lower limit above the upper limit"),
    ):
        stored = {":serialized:": base64.b64encode(pickle.dumps(space)).decode()}
        shutil.copy(FOLDER / "ppo_gtm.zip", folder)
        rewrite_zip(folder, lambda data, stored=stored: data | {"action_space": stored})
        assert said in message_of(folder, DEPLOYMENT)


def test_a_deployment_read_from_files_is_pickled(folder):
    """A deployment whose files were read can be pickled, with its network."""
    read = stored_deployment("ppo_gtm")
    o = np.linspace(-0.4, 0.5, 4)
    known = read.actor.function(o)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(read)).actor.function(o), known)


@pytest.mark.parametrize(
    ("policy", "said"),
    [
        ({"file": 5}, "policy.file is 5"),
        (
            {"file": ca.Function("f", [ca.SX.sym("o", 3)], [ca.SX.zeros(2)])},
            "requires 3 observations",
        ),
        ({"file": ca.Function("f", [ca.SX.sym("o", 4)], [ca.SX.zeros(3)])}, "returns 3 actions"),
        ({"file": "flat.npz"}, "is not a matrix of finite numbers"),
        ({"file": "nan.npz"}, "is not a matrix of finite numbers"),
        ({"file": "text.npz"}, "text.npz cannot be read as .npz"),
    ],
)
def test_policies_that_do_not_fit_are_refused(tmp_path, policy, said):
    np.savez(tmp_path / "flat.npz", K=np.ones(4))
    np.savez(tmp_path / "nan.npz", K=np.array([[1.0, np.nan, 0.0, 2.0], [0.0, 1.0, 2.0, 3.0]]))
    (tmp_path / "text.npz").write_text("K")
    deployment = gtm_deployment({**policy, "squash": False})
    with pytest.raises(BadInputError, match=said):
        _ = dataclasses.replace(deployment, folder=tmp_path).actor


def test_the_usual_deployment_moves_inputs_by_half_their_range():
    """From the trim by a in [-1, 1]; by the nominal value of an input without limits."""
    model = dataclasses.replace(
        model_of(GTM),
        inputs={
            **model_of(GTM).inputs,
            "throttle": hfa.Signal("%", nominal=7.0),
        },
    )
    deployment = Deployment.usual(model, 0.05)
    assert deployment.dt == 0.05
    entries = deployment.observation
    assert {name: each["scale"] for name, each in entries.items()} == {
        name: model.states[name].nominal for name in model.linear
    }
    assert deployment.action["elevator"]["map"] == f"trim + {(0.35 + 0.5) / 2!r} * a"
    assert deployment.action["throttle"] == {"box": [-1.0, 1.0], "map": "trim + 7.0 * a"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mean": [[0.0, 1.0, 0.0, 0.0]]}, r"mean\[0\] is \[0.0, 1.0"),
        ({"variance": [1.0, 1.0, 1.0, math.inf]}, r"variance\[3\] is inf"),
        ({"mean": [0.0]}, "has 1 means and 4 variances"),
        ({"epsilon": math.nan}, "epsilon is nan"),
        ({"variance": [1.0, -1.0, 1.0, 1.0]}, r"variance\[1\] is -1.0"),
        ({"variance": [1.0, 0.0, 1.0, 1.0], "epsilon": 0.0}, "every variance plus epsilon is posi"),
        ({"clip": 0.0}, "clip is 0.0"),
    ],
)
def test_numbers_that_define_no_normalizer_are_refused(changes, said):
    numbers = {"mean": [0.0] * 4, "variance": [1.0] * 4, **changes}
    o = ca.SX.sym("o", 4)
    policy = {"file": ca.Function("f", [o], [o[:2]]), "normalizer": numbers}
    with pytest.raises(BadInputError, match=said):
        assess(model_of(GTM), gtm_deployment(policy), [45.0], samples=0)


def test_squashed_actions_need_a_box_and_reach_its_ends():
    """a = low + (tanh + 1) / 2 (high - low); actions that are no numbers are refused at the trim."""
    o = ca.SX.sym("o", 4)
    policy = {"file": ca.Function("f", [o], [o[:2]]), "squash": True}
    with pytest.raises(BadInputError, match="squashed actions requires a box for each action"):
        _ = gtm_deployment(policy, action={"elevator": {"box": [-1, 3]}, "throttle": {}}).box
    action = {"elevator": {"box": [-1, 3]}, "throttle": {"box": [0, 5]}}
    act = Deployed(gtm_deployment(policy, action=action), model_of(GTM)).act
    for raw in (-0.3, 0.0, 2.0):
        share = 0.5 * (np.tanh(raw) + 1.0)
        found = np.array(act([raw, raw, 0.0, 0.0])).ravel()
        np.testing.assert_allclose(found, [-1.0 + 4.0 * share, 5.0 * share], atol=1e-12)
    nan = {"file": ca.Function("f", [o], [ca.log(o[:2] - 1.0)])}
    with pytest.raises(BadInputError, match="not finite at the trim"):
        assess(model_of(GTM), gtm_deployment(nan), samples=0)


def test_policies_for_frame_stacks_are_refused():
    """A policy for a stack of frames is refused. The message states the required `history`."""
    one = gtm_deployment({"file": FOLDER / "ppo_raw.zip"}, observation={"speed": {}})
    with pytest.raises(BadInputError, match=r"history = 4"):
        _ = one.actor


def test_a_squash_without_gsde_has_no_tanh_and_is_refused(tmp_path):
    """As in Stable-Baselines3 before 2.2, which mapped such an output to the box as it is; later
    versions do not load it.
    """
    with zipfile.ZipFile(FOLDER / "ppo_squash.zip") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(members["data"])
    old = {"use_sde": False, "policy_kwargs": {"squash_output": True}}
    members["data"] = json.dumps(data | old).encode()
    with zipfile.ZipFile(tmp_path / "old.zip", "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(BadInputError, match=r"old\.zip: .* without tanh or clip"):
        _ = gtm_deployment({"file": str(tmp_path / "old.zip")}).actor
