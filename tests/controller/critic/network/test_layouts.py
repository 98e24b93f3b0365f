"""Policies of Stable-Baselines3 and other libraries: what their files say is what is judged.

The zips in zips/ were written by Stable-Baselines3 2.9 for 3 observations and 2 actions, without
training; zips/actions.json has the actions of its `predict`. `ppo_old_squash` was written without
the check of later versions, `sac_old` in the format of torch before 1.6.
"""

import base64
import json
import pickle
import zipfile
from functools import partial
from pathlib import Path

import network_files
import numpy as np
import pytest
from network_files import safetensors_file, torch_file

import hfa

ZIPS = Path(__file__).parent / "zips"
STORED = json.loads((ZIPS / "actions.json").read_text())
OBSERVED = np.array(STORED["observations"])
GAME = hfa.Game(-np.eye(3), np.ones((3, 2)), Q=np.ones(3), R=np.ones(2))
RNG = np.random.default_rng(5)
pytestmark = pytest.mark.usefixtures("folder")


read = partial(network_files.read, states=3, inputs=2)
refusal = partial(network_files.refusal, states=3, inputs=2)


@pytest.mark.parametrize("name", STORED["actions"])
def test_a_zip_gives_the_actions_of_stable_baselines(name):
    """The policy of a zip, read without options, gives the actions of `predict`, which squashes them or
    clips them to their box.

    The critic states the box and the algorithm, the first part of the file's name. All zips but those
    of ARS have parts, such as a value, that are noted as unused.
    """
    critic = read(ZIPS / f"{name}.zip")
    assert critic.u(OBSERVED) == pytest.approx(np.array(STORED["actions"][name]), abs=1e-6)
    assert critic.declared.algorithm == name.partition("_")[0].upper()
    assert critic.declared.action.low == pytest.approx([-1.0, -0.5])
    assert ("ars" in name) == (critic.declared.notes == ())


def test_only_the_activation_of_the_zip_may_be_given():
    """The activation "elu" that a PPO zip contains may be given, too; another one is refused."""
    own = read(ZIPS / "ppo.zip")
    assert pytest.approx(own.K) == read(ZIPS / "ppo.zip", activation="ELU").K
    assert "but the file contains 'elu'" in refusal(ZIPS / "ppo.zip", activation="tanh")


@pytest.mark.parametrize(
    ("name", "said"),
    [("dqn", "one of 3 discrete actions"), ("ppo_normalized", "trained behind a VecNormalize")],
)
def test_policies_that_are_no_function_of_the_states_are_refused(name, said):
    """A zip of DQN, and one whose observations were normalized in training, are refused."""
    assert said in refusal(ZIPS / f"{name}.zip")


def changed_zip(name, change):
    """Write a zip with changed settings, and return its path."""
    with zipfile.ZipFile(ZIPS / f"{name}.zip") as archive:
        members = {each: archive.read(each) for each in archive.namelist()}
    data = json.loads(members["data"])
    change(data)
    members["data"] = json.dumps(data).encode()
    with zipfile.ZipFile("changed.zip", "w") as archive:
        for each, content in members.items():
            archive.writestr(each, content)
    return "changed.zip"


def halved(data):
    """Halve the box of the actions in the settings of a zip."""
    spaces = pytest.importorskip("gymnasium").spaces
    box = spaces.Box(np.array([-0.5, -0.25], "f4"), np.array([1.0, 0.125], "f4"))
    content = base64.b64encode(pickle.dumps(box)).decode()
    data["action_space"] = {":serialized:": content}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("ppo", halved),
        ("ppo_squash", lambda data: data["policy_kwargs"].update(squash_output=False)),
    ],
)
def test_another_box_and_another_squash_are_another_policy(name, change):
    """If the box of the actions in a PPO zip is halved, or its squash is removed, the actions change,
    and so does the policy error that `verify` finds in its box of states.

    Without the squash, K at z = 0 changes, too. It does not change with the box, since actions near 0
    are not clipped.
    """
    own = ZIPS / f"{name}.zip"
    other = read(changed_zip(name, change))
    assert np.abs(other.u(3.0 * OBSERVED) - read(own).u(3.0 * OBSERVED)).max() > 0.05
    errors = [hfa.verify(GAME, critic, flights=0).checks for critic in (read(own), other)]
    one, two = ({each.name: each.value for each in checks} for checks in errors)
    assert one["searched_policy_error"] != pytest.approx(two["searched_policy_error"], rel=1e-3)
    assert (name != "ppo") == (np.abs(other.K - read(own).K).max() > 1e-3)


def test_a_zip_without_its_class_is_refused():
    """A zip is refused if its data lack the policy class, which says which layers are the policy's."""
    assert "policy_class" in refusal(changed_zip("ppo", lambda data: data.pop("policy_class")))


def test_an_old_torch_file_that_claims_large_storages_is_refused():
    """A file of torch before 1.6 is read, and refused if its storages are larger than the file."""
    with zipfile.ZipFile(ZIPS / "sac_old.zip") as archive:
        content = archive.read("policy.pth")
    Path("old.pth").write_bytes(content)
    assert read("old.pth", activation="relu", network="policy=latent_pi+mu").K.shape == (2, 3)
    place = content.index(b"K", content.index(b"cpu"))  # the number of entries of the first storage
    larger = content[:place] + b"J\xff\xff\xff\x7f" + content[place + 2 :]
    Path("larger.pth").write_bytes(larger)
    assert "larger than the file" in refusal("larger.pth", activation="relu")


# Checkpoints of other libraries.


def chain(*names, widths=(3, 5, 4, 2)):
    """Return random weights and biases of layers with these names."""
    return network_files.chain(names, widths, RNG)


def output_of(tensors, names, activation):
    """Return the actions of layers for the observations."""
    return network_files.output_of(tensors, names, activation, OBSERVED)


def relu(x):
    return np.maximum(x, 0.0)


ACTOR = ("actor.0", "actor.2", "actor.4")


@pytest.mark.parametrize("write", [torch_file, safetensors_file])
def test_a_checkpoint_of_cleanrl_is_squashed_and_scaled(write):
    """The policy is tanh(output) action_scale + action_bias; Q functions are noted as unused."""
    names = ("0.fc1", "0.fc2", "0.fc_mu")
    tensors = chain(*names) | chain("1.fc1", "1.fc2", "1.fc3", widths=(5, 6, 6, 1))
    scale = {"0.action_scale": np.array([[2.0, 0.5]]), "0.action_bias": np.array([[1.0, 0.0]])}
    path = write("td3.cleanrl_model" if write is torch_file else "td3.safetensors", tensors | scale)
    critic = read(path, activation="relu")
    expected = np.tanh(output_of(tensors, names, relu)) * [2.0, 0.5] + [1.0, 0.0]
    assert critic.u(OBSERVED) == pytest.approx(expected, rel=1e-9)
    assert critic.declared.notes == ("not used: 1.fc1, 1.fc2, 1.fc3",)


def layers(root, *names, **how):
    """Return random layers of names after a root."""
    return chain(*(f"{root}{name}" for name in names), **how)


#: Library -> tensors of a checkpoint, layers of its policy, and the squash of their output.
LIBRARIES = {
    "SAC of Stable-Baselines3": (
        layers("actor.", "latent_pi.0", "latent_pi.2", "mu")
        | layers("actor.", "log_std", widths=(4, 2))
        | layers("critic.qf0.", "0", "2", widths=(5, 6, 1))
        | {"log_alpha": np.zeros(1)},
        ["actor.latent_pi.0", "actor.latent_pi.2", "actor.mu"],
        np.tanh,
    ),
    "TD3 of Stable-Baselines3": (
        layers("actor.mu.", "0", "2", "4") | layers("critic.qf0.", "0", "2", widths=(5, 6, 1)),
        ["actor.mu.0", "actor.mu.2", "actor.mu.4"],
        np.tanh,
    ),
}


@pytest.mark.parametrize("library", LIBRARIES)
def test_the_policy_in_a_checkpoint_is_that_of_its_library(library):
    """The policy in a file of torch, read without a choice of a network, is that of the
    layers and the squash that `LIBRARIES` lists.

    A note names unused tensors, which all but the TD3 of Stable-Baselines3 have.
    """
    tensors, names, after = LIBRARIES[library]
    critic = read(torch_file("a.pt", tensors), activation="relu")
    assert critic.u(OBSERVED) == pytest.approx(after(output_of(tensors, names, relu)), rel=1e-9)
    assert critic.declared.algorithm
    assert "not used" in " ".join(critic.declared.notes) or "TD3 of Stable" in library


def test_a_checkpoint_of_a_discrete_policy_is_refused():
    """A last layer `logits` of rl_games chooses one of several actions."""
    tensors = layers("model.a2c_network.", "actor_mlp.0", "logits", widths=(3, 5, 2))
    path = torch_file("discrete.pth", tensors)
    assert "one of several discrete actions (logits)" in refusal(path, activation="tanh")


@pytest.mark.parametrize("kind", ["float16", "bfloat16"])
def test_half_precision_is_read(kind):
    """The policy of weights in float16 or bfloat16 is that of the stored weights.

    A number in bfloat16 is the upper half of one in float32.
    """
    tensors = chain(*ACTOR)
    singles = {name: each.astype("f4") for name, each in tensors.items()}
    if kind == "float16":
        stored = {name: each.astype("f2") for name, each in tensors.items()}
        path = torch_file("half.pt", stored)
    else:
        halves = {name: each.view("u4") >> 16 for name, each in singles.items()}
        stored = {name: (each << 16).view("f4") for name, each in halves.items()}
        # safetensors_file writes unsigned integers of 16 bits as bfloat16.
        path = safetensors_file(
            "half.safetensors", {name: each.astype("u2") for name, each in halves.items()}
        )
    critic = read(path, activation="tanh")
    weights = {name: each.astype(float) for name, each in stored.items()}  # as rounded in the file
    assert critic.u(OBSERVED) == pytest.approx(output_of(weights, ACTOR, np.tanh), rel=1e-12)
    assert critic.precision == kind
