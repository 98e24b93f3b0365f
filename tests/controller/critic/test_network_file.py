"""State dicts read as networks: torch's files, safetensors, .npz and .json; the order of their
layers, LayerNorms, several networks in one file."""

from __future__ import annotations

import json
import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from network_files import refusal, safetensors_file, square_layers, torch_file, two_layers

from controller import Game
from controller.critic.network import from_network
from controller.critic.network_file import network_in
from hfa_support import BadInputError

HERE = Path(__file__).parent
TORCH = json.loads((HERE / "torch_2_13.json").read_text(encoding="utf-8"))
X = np.random.default_rng(0).normal(size=(7, 6))
pytestmark = pytest.mark.usefixtures("folder")


def test_what_torch_wrote_is_read_and_differentiated(game: Game) -> None:
    """V against torch's own, F against differences of V, P against differences of F."""
    critic = from_network(game, HERE / "torch_2_13.pt", activation="tanh")
    assert critic.value is not None
    assert critic.gradient is not None
    V = np.array(critic.value(np.array(TORCH["x"]).T))
    F = np.array(critic.gradient(np.array(TORCH["x"]).T))
    assert V.ravel() == pytest.approx(TORCH["V"], rel=1e-12)
    step = 1e-5
    z = np.array(TORCH["x"][0])
    moved = np.array(critic.value(z[:, None] + step * np.hstack([np.eye(6), -np.eye(6)]))).ravel()
    assert F[:, 0] == pytest.approx((moved[:6] - moved[6:]) / (2 * step), abs=1e-9)
    ends = np.array(critic.gradient(step * np.hstack([np.eye(6), -np.eye(6)])))
    assert np.allclose(critic.P, (ends[:, :6] - ends[:, 6:]) / (4 * step), atol=1e-9)
    assert critic.precision == "float32"


# The order of layers.


def test_safetensors_sorts_names_and_the_layers_keep_their_order(game: Game) -> None:
    """As the library writes them, "10.weight" comes before "2.weight"; wide enough, either order
    would fit."""
    rng = np.random.default_rng(3)
    tensors = {f"{place}.weight": rng.normal(size=(6, 6)) for place in (0, 2, 10)} | {
        "12.weight": np.ones((1, 6))
    }
    sorted_names = {name: tensors[name] for name in sorted(tensors)}
    expected = from_network(game, torch_file("a.pt", tensors), activation="tanh").K
    found = from_network(game, safetensors_file("a.safetensors", sorted_names), activation="tanh").K
    assert list(sorted_names) != list(tensors)
    assert np.array_equal(found, expected)


def test_layers_of_an_npz_run_in_the_order_of_their_numbers(game: Game) -> None:
    right = square_layers("0", "2", "10", "12")
    np.savez("sorted.npz", **{name: right[name] for name in sorted(right)})  # 0, 10, 12, 2
    expected = from_network(game, torch_file("a.pt", right), activation="tanh")
    critic = from_network(game, "sorted.npz", activation="tanh")
    assert np.array_equal(critic.K, expected.K)
    assert critic.origin == (
        "network sorted.npz: 6 -> tanh 6 -> tanh 6 -> tanh 6 -> 1 (layers 0, 2, 10, 12)"
    )


@pytest.mark.parametrize("write", [safetensors_file, np.savez])
def test_layers_whose_names_do_not_tell_their_order_are_refused(game: Game, write: Any) -> None:
    """Formats that sort their names, or may have been written from a sorted dictionary."""
    layers = square_layers("hidden", "embed", "out")
    path = "letters.npz" if write is np.savez else "letters.safetensors"
    if write is np.savez:
        np.savez(path, **layers)
    else:
        write(path, layers)
    with pytest.raises(BadInputError, match="fit together in more than one order"):
        from_network(game, path, activation="tanh")


def test_names_do_not_matter_where_the_widths_leave_one_order(game: Game) -> None:
    layers = {"w.weight": np.ones((4, 6)), "b.weight": np.ones((3, 4)), "a.weight": np.ones((1, 3))}
    np.savez("widths.npz", **{name: layers[name] for name in sorted(layers)})
    expected = from_network(game, torch_file("a.pt", layers), activation="tanh")
    assert np.array_equal(from_network(game, "widths.npz", activation="tanh").K, expected.K)


def test_a_module_declared_in_another_order_than_its_numbers_is_refused(game: Game) -> None:
    path = torch_file("declared.pt", square_layers("fc2", "fc1", "out"))
    with pytest.raises(BadInputError, match="'fc1' stands after 'fc2': the file does not tell"):
        from_network(game, path, activation="tanh")


# Names, and several networks in one file.


@pytest.mark.parametrize("name", ["v", "net", "critic.model", "critic.model.0.net"])
def test_names_of_layers_are_free(name: str) -> None:
    tensors = two_layers(name)
    found = network_in(torch_file("critic.pt", tensors), 6, "tanh").functions[""]
    first, bias, last, end = tensors.values()
    for x in X:
        assert float(found(x)) == pytest.approx(
            float((last @ np.tanh(first @ x + bias) + end)[0]), rel=1e-12
        )


def test_actors_and_critics_of_one_file_and_of_stable_baselines() -> None:
    """A3C-like heads: each network by a word in its names, parts with + between them."""
    value_net = two_layers("mlp_extractor.value_net", 3)
    policy = two_layers("mlp_extractor.policy_net", 3)
    heads = {
        "action_net.weight": np.ones((5, 3)),
        "action_net.bias": np.zeros(5),
        "log_std": np.zeros(5),
    }
    heads |= {"value_net.weight": np.ones((1, 3)), "value_net.bias": np.ones(1)}
    torch_file("policy.pth", policy | value_net | heads)
    with zipfile.ZipFile("ppo.zip", "w") as archive:
        archive.write("policy.pth")
        archive.writestr("data", "{}")
        archive.writestr("policy.optimizer.pth", b"no pickle")
    parts = {"V": "value_net", "policy": "policy_net+action_net"}
    found = network_in("ppo.zip", 6, "tanh", parts).functions
    assert {name: each.numel_out(0) for name, each in found.items()} == {"V": 1, "policy": 5}
    first, bias, last, end = value_net.values()
    inside = np.tanh(last @ np.tanh(first @ X[0] + bias) + end)
    assert float(found["V"](X[0])) == pytest.approx(inside.sum() + 1.0, rel=1e-12)


# Refused in one line.


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("executed",)


@pytest.mark.parametrize("packed", [True, False])
def test_a_pickle_that_would_run_code_is_refused_and_nothing_runs(packed: bool) -> None:
    content = pickle.dumps({"0.weight": Evil()})
    for path in map(Path, ("evil.pkl", "evil.pt", "evil.pth")):
        if packed:
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("evil/data.pkl", content)
        else:
            path.write_bytes(content)
        assert (
            "mkdir, which is not done: save state_dict() alone" if packed else "since torch 1.6"
        ) in refusal(path)
        assert not Path("executed").exists()
    pickle.loads(content)  # as torch.load without weights_only
    assert Path("executed").exists()


def test_wrong_state_dicts_are_refused() -> None:
    good = np.zeros((1, 6), "float32")
    wrong = {
        "has 10 inputs": {"weight": np.zeros((1, 10))},
        "is float16; give weights as float32": {"weight": good.astype("float16")},
        "not finite": {"weight": good + np.nan},
        "'conv.weight' (3, 1, 1) is no weight or bias": {
            "0.weight": good,
            "conv.weight": np.zeros((3, 1, 1)),
        },
        "'1.weight' (4,) is no weight or bias": {
            "0.weight": np.zeros((4, 6)),
            "1.weight": np.ones(4),
        },
        "has more than 4194304 numbers": {"weight": np.zeros((700_000, 6))},
        "the layer before gives 1": {"0.weight": good, "1.weight": good},
    }
    for said, tensors in wrong.items():
        assert said in refusal(torch_file("wrong.pt", tensors)), said
    assert "is float16" in refusal(
        safetensors_file("half.safetensors", {"weight": good.astype("float16")})
    )
    for name, content in (
        ("a.pt", b"PK\3\4"),
        ("b.pt", b"text"),
        ("c.safetensors", b"\xff" * 20),
        ("d.pkl", b""),
    ):
        Path(name).write_bytes(content)
        refusal(name)
    with Path("large.pt").open("wb") as stream:
        stream.truncate(2**27)
    assert "larger than 64 MiB" in refusal("large.pt")
    with zipfile.ZipFile("script.pt", "w") as archive:
        for name in ("script/data.pkl", "script/constants.pkl", "script/code/__torch__.py"):
            archive.writestr(name, b"")
    assert "it is TorchScript, a program; save state_dict" in refusal("script.pt")
