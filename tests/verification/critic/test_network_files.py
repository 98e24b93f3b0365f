"""Files of networks as other tools write them: names, several networks in one, old operator sets, bases in words."""

from __future__ import annotations

import zipfile
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, small as small_plant, stored
from network_files import onnx_file, torch_file
from planted_critics import gain, value, weights_of

from controller import Game, load_game
from controller.game.user_files import StoredCritic, critic_in
from hfa_cli.main import FAILED
from hfa_support import BadInputError
from verification import check_critic, from_network, from_weights, solve_game
from verification.critic.candidate import features_of
from verification.critic.network_file import network_in

pytestmark = pytest.mark.usefixtures("folder")
RNG = np.random.default_rng(0)
X = RNG.normal(size=(7, 6)).astype("float32")


def small(name: str, of: int = 1) -> dict[str, Any]:
    """Linear layers 6-4-k of a network with this name."""
    sizes = {f"{name}.0": (4, 6), f"{name}.2": (of, 4)}
    weights = {f"{key}.weight": RNG.normal(size=size) for key, size in sizes.items()}
    return {
        key: each
        for name in weights
        for key, each in ((name, weights[name]), (f"{name[:-6]}bias", weights[name][:, 0]))
    }


@pytest.mark.parametrize("name", ["v", "net", "critic.model", "critic.model.0.net"])
def test_names_of_layers_are_free(name: str) -> None:
    tensors = small(name)
    found = network_in(torch_file("critic.pt", tensors), 6, "tanh").functions[""]
    first, bias, last, end = tensors.values()
    for x in X:
        assert float(found(x)) == pytest.approx(float((last @ np.tanh(first @ x + bias) + end)[0]), rel=1e-12)


def test_actors_and_critics_of_one_file_and_of_stable_baselines() -> None:
    """A3C-like heads: each network by a word in its names, parts with + between them."""
    value_net, policy = small("mlp_extractor.value_net", 3), small("mlp_extractor.policy_net", 3)
    heads = {"action_net.weight": np.ones((5, 3)), "action_net.bias": np.zeros(5), "log_std": np.zeros(5)}
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
    words = ("verify", *AT_15, "--weights", "ppo.zip", "--set", "activation=tanh", "--network")
    assert (
        answer(*words, "V=value_net,policy=policy_net+action_net", code=FAILED)["network"]["output"] == "V and policy"
    )
    assert "name one by --network: " in hfa(*words[:-1]).err
    assert "before = stands one of V, gradient, policy, V+policy" in hfa(*words, "W=value_net").err


def test_v_and_a_policy_are_judged_together(game: Game) -> None:
    """Two outputs of one graph: a right V does not hide a policy of the wrong sign."""
    nodes = [("MatMul", "x P", "h"), ("Mul", "x h", "t"), ("ReduceSum", "t axes", "V"), ("MatMul", "x K", "u")]
    for sign, ok in ((-1.0, True), (1.0, False)):
        constants = {"P": value(game), "axes": np.array([1]), "K": sign * gain(game).T}
        path = onnx_file("both.onnx", [*nodes, ("Concat", "V u", "y", {"axis": 1})], constants, 6)
        check = check_critic(game, from_network(game, path, network="V+policy="), flights=1)
        assert check.ok == ok
        assert check.diagnosis == ("" if ok else "the gain has the wrong sign: the policy is u = -K z")
    assert from_network(game, path).nonlinear is not None  # six outputs of six states are a gradient unless it is said


def test_a_layer_norm_and_a_program_are_refused_by_name(game: Game) -> None:
    norm = small("net") | {"net.1.weight": np.ones(4), "net.1.bias": np.zeros(4)}
    with pytest.raises(BadInputError, match=r"'net.1.weight' \(4,\) is a norm, not a linear layer"):
        network_in(torch_file("norm.pt", norm), 6, "tanh")
    with zipfile.ZipFile("script.pt", "w") as archive:
        for name in ("script/data.pkl", "script/constants.pkl", "script/code/__torch__.py"):
            archive.writestr(name, b"")
    with pytest.raises(BadInputError, match="it is TorchScript, a program; save state_dict"):
        network_in("script.pt", 6, "tanh")
    with pytest.raises(BadInputError, match="the network has 21 outputs; on this plant V has 1"):
        from_network(game, torch_file("L.pt", small("L", 21)), activation="tanh")
    constants = {"s": np.ones(6, "float32"), "b": np.zeros(6, "float32")}
    with pytest.raises(BadInputError, match="operator LayerNormalization is not known"):
        network_in(onnx_file("norm.onnx", [("LayerNormalization", "x s b", "y")], constants, 6), 6)


@pytest.mark.parametrize("opset", [9, 11, 13, 20])
def test_graphs_of_old_and_new_operator_sets_are_those_of_onnx_runtime(opset: int) -> None:
    runtime = pytest.importorskip("onnxruntime", reason="the package onnxruntime is not installed")
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    W, b = (RNG.normal(size=size).astype("float32") for size in ((6, 4), (4,)))
    axes = {"axes": [0]} if opset < 13 else {}
    nodes: list[tuple[Any, ...]] = [
        ("Flatten", "x", "f", {"axis": 1}),
        ("MatMul", "f W", "m"),
        ("Add", "m b", "a"),
        ("Tanh", "a", "t"),
        ("Squeeze", "t" if opset < 13 else "t zero", "s", axes),
        ("Unsqueeze", "s" if opset < 13 else "s zero", "w", axes),
        ("Cast", "w", "c", {"to": 1}),
        ("Gather", "c place", "g", {"axis": 1}),
        ("Clip", "g", "k", {"min": -0.5, "max": 0.5}) if opset < 11 else ("Clip", "g low high", "k"),
        ("Erf", "k", "e"),
        ("Identity", "e", "y"),
    ]
    constants = {"W": W, "b": b, "place": np.array([0, 2]), "zero": np.array([0])}
    constants |= {"low": np.array(-0.5, "float32"), "high": np.array(0.5, "float32")}
    used = {word for _, inputs, *_ in nodes for word in inputs.split()}
    path = onnx_file("a.onnx", nodes, {name: each for name, each in constants.items() if name in used}, 2)
    model = onnx.load(path)
    del model.opset_import[:]
    model.opset_import.append(onnx.helper.make_opsetid("", opset))
    onnx.save(model, path)
    session, found = runtime.InferenceSession(path, providers=["CPUExecutionProvider"]), network_in(path, 6).functions
    for x in X:
        theirs = session.run(None, {"x": x[None]})[0].ravel()
        assert np.array(found["y"](x) if "y" in found else found[""](x)).ravel() == pytest.approx(theirs, abs=1e-6)


FEATURES = ", ".join(["1", *(f"x{i}*x{j}" for i in range(1, 7) for j in range(i, 7))])


def test_a_basis_in_words_or_as_a_function_and_a_constant(game: Game) -> None:
    plant, P = small_plant("plant.json", states=["speed", "alpha"]), solve_game(load_game("plant.json")).P
    words = ("verify", "--model", plant, "--weights", stored("W.npz", weights=[*weights_of(P), -1.0]), "--basis")
    assert answer(*words, "speed**2, speed*x2, x2**2, sin(alpha)**4", code=FAILED)["ok"] is False
    weights = np.append(-3.0, weights_of(value(game)))
    check = check_critic(game, from_weights(game, weights, features_of(FEATURES, 6)), flights=1)
    assert check.ok
    assert check.network is not None
    assert check.network.value_at_origin == -3.0
    z = ca.SX.sym("z", 6)
    squares = ca.Function("squares", [z], [z**2])
    assert not check_critic(game, from_weights(game, np.diag(value(game)), squares), flights=1).ok
    with pytest.raises(BadInputError, match="there are 6 weights and 6 states; the features are 22 functions"):
        from_weights(game, np.ones(6), features_of(FEATURES, 6))


@pytest.mark.parametrize("text", ["__import__('os')", "x7", "x1.real", "x1 if x1 else x2", "[x1]", "x1**", ""])
def test_what_is_no_basis_is_refused_and_not_run(text: str) -> None:
    with pytest.raises(BadInputError, match="features") as caught:
        features_of(text, 6)
    assert "\n" not in str(caught.value)


def test_an_npy_file_of_any_name_is_what_its_shape_says(game: Game) -> None:
    for entry, right in {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}.items():
        np.save("mine.npy", right)
        found = critic_in("mine.npy", game)
        assert isinstance(found, StoredCritic)
        assert np.array_equal(getattr(found, entry), right)
    np.save("odd.npy", np.ones((4, 3)))
    assert "odd.npy: the array of shape (4, 3) is neither" in hfa("verify", *AT_15, "--weights", "odd.npy").err
