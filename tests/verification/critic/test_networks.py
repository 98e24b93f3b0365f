"""Critics and policies that are neural networks: read as other tools write them, differentiated,
searched, judged."""

from __future__ import annotations

import json
import math
import os
import pickle
import re
import sys
import zipfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, small, stored
from game_samples import failed_names
from network_files import onnx_file, safetensors_file, torch_file
from planted_critics import gain, value, weights_of

from controller import Game, critic_in, load_game
from controller.critic.activations import ACTIVATIONS
from controller.critic.features import features_of
from controller.critic.network_file import network_in
from controller.hfa_game import ORDINARY_DEVIATIONS
from hfa.main import BAD_INPUT, DONE, FAILED
from hfa_support import BadInputError
from verification import check_critic, from_network, from_weights, solve_game
from verification.critic.network_search import search
from verification.critic.scope import FLIGHTS, Scope
from verification.hfa_box import ordinary_box

HERE = Path(__file__).parent
DATA = json.loads((HERE / "networks.json").read_text(encoding="utf-8"))
GOPS = DATA["gops"]
#: z'Pz: x P, times x, summed.
QUADRATIC = [("MatMul", "x P", "h"), ("Mul", "x h", "terms"), ("MatMul", "terms ones", "y")]
ONES = np.ones((6, 1))
BOX = np.array(ORDINARY_DEVIATIONS)
RNG = np.random.default_rng(0)
X = RNG.normal(size=(7, 6)).astype("float32")
pytestmark = pytest.mark.usefixtures("folder")


def on_the_box(flights: int = FLIGHTS) -> Scope:
    """The box of the aircraft's ordinary deviations."""
    return Scope(box=ordinary_box(), flights=flights)


def linear(weight: np.ndarray, name: str = "policy.pt") -> str:
    return torch_file(name, {"weight": weight})


# Read and differentiated.


def test_what_torch_wrote_is_read_and_differentiated(game: Game) -> None:
    """V against torch's own, F against differences of V, P against differences of F."""
    critic = from_network(game, HERE / "torch_2_13.pt", activation="tanh")
    assert critic.value is not None
    assert critic.gradient is not None
    V = np.array(critic.value(np.array(DATA["torch"]["x"]).T))
    F = np.array(critic.gradient(np.array(DATA["torch"]["x"]).T))
    assert V.ravel() == pytest.approx(DATA["torch"]["V"], rel=1e-12)
    step = 1e-5
    z = np.array(DATA["torch"]["x"][0])
    moved = np.array(critic.value(z[:, None] + step * np.hstack([np.eye(6), -np.eye(6)]))).ravel()
    assert F[:, 0] == pytest.approx((moved[:6] - moved[6:]) / (2 * step), abs=1e-9)
    ends = np.array(critic.gradient(step * np.hstack([np.eye(6), -np.eye(6)])))
    assert np.allclose(critic.P, (ends[:, :6] - ends[:, 6:]) / (4 * step), atol=1e-9)
    assert critic.precision == "float32"


#: Operators, some with attributes.
_OPERATORS: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in ("Tanh", "Relu", "LeakyRelu", "Sigmoid", "Softplus", "Elu", "Gelu")),
    ("Elu", {"alpha": 0.7}),
    ("LeakyRelu", {"alpha": 0.2}),
    ("Gelu", {"approximate": "tanh"}),
    ("Transpose", {"perm": [0, 1]}),
]


def assert_as_onnx_runtime(path: str, **tolerance: float) -> None:
    runtime = pytest.importorskip("onnxruntime", reason="the package onnxruntime is not installed")
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (found,) = network_in(path, 6).functions.values()
    for x in 3.0 * X:
        theirs = session.run(None, {"x": x[None]})[0].ravel()
        assert np.array(found(x)).ravel() == pytest.approx(theirs, **tolerance)


def test_the_operators_are_those_of_onnx_runtime() -> None:
    """Each on the same numbers, its results weighted by others and added."""
    rng = np.random.default_rng(0)
    count = len(_OPERATORS)
    sizes = {"W": (8, 6), "b": (8,), "c": (1,), "rest": (12 * count, 1)}
    constants = {key: rng.normal(size=size).astype("float32") for key, size in sizes.items()}
    constants |= {
        "shape": np.array([0, 2, -1]),
        "begin": np.array([2 * count]),
        "end": np.array([4 * count]),
    }
    constants |= {"axis": np.array([2]), "back": np.array([1, 12 * count])}
    nodes: list[tuple[Any, ...]] = [
        ("Gemm", "x W b", "h", {"transB": 1, "alpha": 0.5, "beta": 2.0}),
        *((name, "h", f"g{place}", how) for place, (name, how) in enumerate(_OPERATORS)),
        ("Concat", " ".join(f"g{place}" for place in range(count)), "g", {"axis": 1}),
        ("Reshape", "g shape", "square"),
        ("Slice", "square begin end axis", "half"),
        ("Concat", "half square", "joined", {"axis": 2}),
        ("Reshape", "joined back", "flat"),
        ("Sub", "flat c", "less"),
        ("Div", "less c", "part"),
        ("Add", "part flat", "sum"),
        ("MatMul", "sum rest", "y"),
    ]
    assert_as_onnx_runtime(onnx_file("one.onnx", nodes, constants), rel=1e-4, abs=1e-3)


def test_normalizations_choices_and_limits_are_those_of_onnx_runtime() -> None:
    """As torch writes LayerNorm, BatchNorm, Softplus with a threshold, SELU and clamps."""
    rng = np.random.default_rng(5)
    shapes = {"W": (6, 8), "scale": (8,), "bias": (8,), "mean": (8,), "rest": (8, 1)}
    constants = {name: rng.normal(size=shape).astype("float32") for name, shape in shapes.items()}
    constants["spread"] = rng.uniform(0.5, 2.0, 8).astype("float32")
    for name, number in {"one": 1.0, "bound": 1.5, "lower": -1.0}.items():
        constants[name] = np.array(number, "float32")
    constants["none"] = np.zeros(0, "int64")
    nodes: list[tuple[Any, ...]] = [
        ("MatMul", "x W", "h"),
        ("LayerNormalization", "h scale bias", "l", {"epsilon": 1e-4}),
        ("BatchNormalization", "l scale bias mean spread", "b"),
        ("Exp", "b", "e"),
        ("Add", "e one", "e1"),
        ("Log", "e1", "s"),
        ("Greater", "b bound", "large"),
        ("Where", "large b s", "w"),
        ("Selu", "w", "u"),
        ("Min", "u bound", "low"),
        ("Max", "low lower l", "high"),
        ("ReduceSum", "high none", "same", {"noop_with_empty_axes": 1}),
        ("MatMul", "same rest", "y"),
    ]
    assert_as_onnx_runtime(onnx_file("norms.onnx", nodes, constants), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("opset", [9, 11, 13, 20])
def test_graphs_of_old_and_new_operator_sets_are_those_of_onnx_runtime(opset: int) -> None:
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
        ("Clip", "g", "k", {"min": -0.5, "max": 0.5})
        if opset < 11
        else ("Clip", "g low high", "k"),
        ("Erf", "k", "e"),
        ("Identity", "e", "y"),
    ]
    constants = {
        key: RNG.normal(size=size).astype("float32")
        for key, size in {"W": (6, 4), "b": (4,)}.items()
    }
    constants |= {"place": np.array([0, 2]), "zero": np.array([0])}
    constants |= {"low": np.array(-0.5, "float32"), "high": np.array(0.5, "float32")}
    used = {word for _, inputs, *_ in nodes for word in inputs.split()}
    constants = {name: each for name, each in constants.items() if name in used}
    assert_as_onnx_runtime(onnx_file("a.onnx", nodes, constants, 2, opset=opset), abs=1e-6)


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "softplus", "gelu"])
def test_smooth_activations_have_their_derivatives_at_zero_and_far_away(name: str) -> None:
    x = ca.SX.sym("x")
    y = ACTIVATIONS[name](np.array([x], dtype=object))[0]
    f = ca.Function("f", [x], [ca.gradient(y, x), ca.gradient(ca.gradient(y, x), x)])
    at_zero = {
        "tanh": (1, 0),
        "sigmoid": (0.25, 0),
        "softplus": (0.5, 0.25),
        "gelu": (0.5, math.sqrt(2 / math.pi)),
    }
    assert [float(each) for each in f(0.0)] == pytest.approx(at_zero[name], abs=1e-12)
    assert all(math.isfinite(each) for far in (-1e4, 1e4) for each in map(float, f(far)))


# Right ones pass.


def test_a_network_that_is_the_value_passes(game: Game) -> None:
    """Weights in float32 too: their rounding is below the limit."""
    wide, narrow = (
        onnx_file(
            f"{kind}.onnx", QUADRATIC, {"P": value(game).astype(kind), "ones": ONES.astype(kind)}
        )
        for kind in ("float64", "float32")
    )
    check = check_critic(game, from_network(game, wide), scope=on_the_box(4))
    assert check.ok
    found = check.to_dict()["network"]
    assert (found["output"], found["precision"]) == ("V", "float64")
    assert {"value", "gradient", "policy"} == {each["name"] for each in found["searched"]}
    assert pickle.loads(pickle.dumps(check)).to_dict()["network"] == check.to_dict()["network"]
    assert from_network(game, narrow).precision == "float32"
    said = hfa("verify", *AT_15, "--weights", narrow).out
    assert said.startswith(
        "PASS: no error above 1e-06 in the box, proved, stabilizing, no cost lost"
    )
    assert "(searched, 1000 starts; not a bound)" in said


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


def square_layers(*names: str) -> dict[str, np.ndarray]:
    """Layers 6-6-...-1 with these names; the widths fit in any order of all but the last."""
    rng = np.random.default_rng(4)
    layers = {f"{name}.weight": rng.normal(size=(6, 6)) for name in names[:-1]}
    return layers | {f"{names[-1]}.weight": np.ones((1, 6))}


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


def test_what_was_read_is_shown_with_one_value(game: Game) -> None:
    """A residual connection leaves no trace in a state dict: the user compares the value."""
    layers = square_layers("first", "second", "third")
    said = hfa(
        "verify", *AT_15, "--weights", torch_file("a.pt", layers), "--set", "activation=tanh"
    )
    first, second, third = layers.values()
    value_there = (third @ np.tanh(second @ np.tanh(first @ BOX))).item()
    assert (
        "Read: network a.pt: 6 -> tanh 6 -> tanh 6 -> 1 (layers first, second, third)" in said.out
    )
    row = ", ".join(f"{number:.4g}" for number in BOX)
    assert f"V({row}) = {value_there:.4g}; compare it with your own" in said.out


def test_division_of_integers_in_a_graph_leaves_no_fraction(game: Game) -> None:
    """7 / 2 = 3 numbers of the state are summed."""
    nodes = [
        ("Div", "seven two", "three"),
        ("Slice", "x begin three axis", "part"),
        ("ReduceSum", "part axis", "y"),
    ]
    constants = {
        "seven": np.array([7]),
        "two": np.array([2]),
        "begin": np.array([0]),
        "axis": np.array([1]),
    }
    path = onnx_file("div.onnx", nodes, constants)
    (summed,) = network_in(path, 6).functions.values()
    assert float(summed(np.arange(1.0, 7.0))) == 6.0


def test_gradients_and_policies_pass(game: Game) -> None:
    for name, write in (("a.pt", torch_file), ("a.safetensors", safetensors_file)):
        for output, weight in (("gradient", 2.0 * value(game)), ("policy", -gain(game))):
            critic = from_network(
                game, write(name, {"actor.0.weight": weight, "actor.0.bias": np.zeros(len(weight))})
            )
            assert set(critic.network) == {output}
            assert check_critic(game, critic, scope=on_the_box(1)).ok


def test_an_almost_linear_tanh_network_passes(game: Game) -> None:
    """u = -(K/e) tanh(e z): its error is (e z)²/3."""
    tensors = {"0.weight": 1e-4 * np.eye(6), "2.weight": -1e4 * gain(game)}
    path = torch_file("actor.pth", tensors)
    assert check_critic(game, from_network(game, path, activation="tanh"), scope=on_the_box(1)).ok
    assert not check_critic(
        game, from_network(game, path, activation="relu"), scope=on_the_box(1)
    ).ok
    for activation, said in (
        (None, "give --set activation=tanh|relu"),
        ("cosh", "unknown activation 'cosh'"),
    ):
        with pytest.raises(BadInputError, match=re.escape(said)):
            from_network(game, path, activation=activation)


# Planted mistakes do not.


def test_the_scale_of_the_inputs_counts(game: Game) -> None:
    scale = np.array([1 / 7.0, *[10.0] * 5])
    path = torch_file("scaled.pt", {"weight": -gain(game) / scale})
    assert check_critic(game, from_network(game, path, scale=scale), scope=on_the_box(1)).ok
    assert "needs 6 numbers" in hfa("verify", *AT_15, "--weights", path, "--set", "scale=1,2").err


def test_a_network_right_at_the_origin_alone_fails(game: Game) -> None:
    """u = -K z + 5 z_1³/7³ in the first input: K is exact, and the search finds the corner."""
    nodes = [
        ("MatMul", "x K", "u"),
        ("MatMul", "x first", "h"),
        ("Mul", "h h", "s"),
        ("Mul", "s h", "c"),
    ]
    constants = {
        "K": -gain(game).T,
        "first": 5.0 ** (1 / 3) / 7.0 * np.eye(6)[:, :1] @ np.eye(5)[:1],
    }
    critic = from_network(game, onnx_file("bent.onnx", [*nodes, ("Add", "u c", "y")], constants, 5))
    check = check_critic(game, critic, scope=on_the_box())
    assert check.K_rel_error < 1e-12
    assert [each.name for each in check.checks if not each.ok] == ["searched_policy_error"]
    (found,) = check.to_dict()["network"]["searched"]
    largest = np.sqrt(game.R.diagonal()) * (np.abs(solve_game(game).K) @ BOX)
    assert found["error"] == pytest.approx(5.0 * np.sqrt(game.R[0, 0]) / largest[0], rel=1e-6)
    assert check.to_dict()["graded"]["cost_lost_worst_percent"] <= 1e-6
    assert not check.holds(1e-6)


def test_a_value_that_is_not_a_number_somewhere_fails(game: Game) -> None:
    nodes = [
        *QUADRATIC[:2],
        ("MatMul", "terms ones", "V"),
        ("Slice", "x a b c", "s"),
        ("Pow", "s half", "r"),
    ]
    constants = {
        "P": value(game),
        "ones": ONES,
        "a": np.array([0]),
        "b": np.array([1]),
        "c": np.array([1]),
    }
    constants |= {"half": np.array(2.5), "zero": np.array(1e-30)}
    path = onnx_file("nan.onnx", [*nodes, ("Mul", "r zero", "n"), ("Add", "V n", "y")], constants)
    critic = from_network(game, path)
    exact = solve_game(game)
    found = {each.name: each.error for each in search(game, critic, exact, BOX)[1]}
    assert found["value"] == math.inf


def test_the_cost_in_flight_is_that_of_the_linear_loop_where_the_network_is_linear(
    game: Game,
) -> None:
    """From 40 starts, under the disturbance of the exact policies: no more than the worst of
    all."""
    critic = from_network(game, linear(-1.2 * gain(game)))
    check = check_critic(game, critic, scope=on_the_box(40))
    data = check.to_dict()
    flown = data["network"]["cost_lost_flown_percent"]
    linear_loop = data["graded"]
    assert 0.1 * linear_loop["cost_lost_mean_percent"] < flown
    assert flown <= linear_loop["cost_lost_worst_percent"] * (1 + 1e-6)


def test_an_actor_with_a_constant_is_stable_and_rests_off_trim(game: Game) -> None:
    """The exact gain and 1 % of the largest input: a finding of its own, with its rest point."""
    offset = 0.01 * np.abs(gain(game)) @ BOX
    critic = from_network(game, torch_file("b.pt", {"weight": -gain(game), "bias": offset}))
    verdict = check_critic(game, critic, scope=on_the_box(10))
    assert failed_names(verdict.checks) == {"origin_error", "searched_policy_error", "rest_point"}
    data = verdict.to_dict()["network"]
    rest = np.linalg.solve(game.B @ gain(game) - game.A, game.B @ offset)
    assert data["rest_point"] == pytest.approx(rest, rel=1e-9)
    assert data["cost_lost_flown_percent"] == pytest.approx(0.0, abs=1e-9)
    assert data["reach"] == 16.0
    headline = verdict.headline()
    assert "stabilizing, rests off trim (" in headline
    assert "without bound" not in headline
    assert verdict.diagnosis == "it is right but for a constant in u"


def test_the_published_weights_of_gops() -> None:
    """V = W'psi + a constant; the exact ones as printed, the learned ones off by 1.6 % and nearly
    free of cost."""
    plant = stored("plant.json", **GOPS["plant"])
    words = ("verify", "--model", plant, "--network", "V=value", "--weights")
    for name, weights, bias in (
        ("exact", GOPS["exact"], 0.0),
        ("learned", GOPS["learned"], GOPS["learned_bias"]),
    ):
        one = {"v.weight": np.array([weights], "float32"), "v.bias": np.array([bias], "float32")}
        both = {
            f"{part}.{key}": each for part in ("value", "value_target") for key, each in one.items()
        }
        torch_file(f"{name}.pkl", both)
    exact = answer(*words, "exact.pkl")
    assert (exact["ok"], exact["P_rel_error"]) == (True, pytest.approx(1.6e-7, rel=0.1))
    learned = answer(*words, "learned.pkl", code=FAILED)
    assert learned["P_rel_error"] == pytest.approx(0.016, rel=0.03)
    assert learned["K_rel_error"] == pytest.approx(0.0043, rel=0.02)
    assert learned["graded"]["cost_lost_worst_percent"] == pytest.approx(0.0005, rel=0.03)
    assert learned["graded"]["l2_gain"] == pytest.approx(3.543, abs=5e-4)
    assert learned["network"]["value_at_origin"] == pytest.approx(-0.0424, abs=5e-5)
    assert hfa(*words, "learned.pkl", "--limit-cost", "0.001").code == DONE


# Files as other tools write them: names, several networks in one, old operator sets, bases in
# words.


def layers(name: str, of: int = 1) -> dict[str, Any]:
    """Linear layers 6-4-k of a network with this name."""
    weights = {f"{name}.0": RNG.normal(size=(4, 6)), f"{name}.2": RNG.normal(size=(of, 4))}
    return {
        f"{key}.{kind}": W if kind == "weight" else W[:, 0]
        for key, W in weights.items()
        for kind in ("weight", "bias")
    }


@pytest.mark.parametrize("name", ["v", "net", "critic.model", "critic.model.0.net"])
def test_names_of_layers_are_free(name: str) -> None:
    tensors = layers(name)
    found = network_in(torch_file("critic.pt", tensors), 6, "tanh").functions[""]
    first, bias, last, end = tensors.values()
    for x in X:
        assert float(found(x)) == pytest.approx(
            float((last @ np.tanh(first @ x + bias) + end)[0]), rel=1e-12
        )


def test_actors_and_critics_of_one_file_and_of_stable_baselines() -> None:
    """A3C-like heads: each network by a word in its names, parts with + between them."""
    value_net = layers("mlp_extractor.value_net", 3)
    policy = layers("mlp_extractor.policy_net", 3)
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
    words = ("verify", *AT_15, "--weights", "ppo.zip", "--set", "activation=tanh", "--network")
    judged = answer(*words, "V=value_net,policy=policy_net+action_net", code=FAILED)
    assert judged["network"]["output"] == "V and policy"
    assert "name one by --network: " in hfa(*words[:-1]).err
    assert "before = stands one of V, gradient, policy, V+policy" in hfa(*words, "W=value_net").err


def test_v_and_a_policy_are_judged_together(game: Game) -> None:
    """Two outputs of one graph: a right V does not hide a policy of the wrong sign."""
    nodes = [
        ("MatMul", "x P", "h"),
        ("Mul", "x h", "t"),
        ("ReduceSum", "t axes", "V"),
        ("MatMul", "x K", "u"),
    ]
    for sign, ok in ((-1.0, True), (1.0, False)):
        constants = {"P": value(game), "axes": np.array([1]), "K": sign * gain(game).T}
        path = onnx_file("both.onnx", [*nodes, ("Concat", "V u", "y", {"axis": 1})], constants, 6)
        check = check_critic(
            game, from_network(game, path, network="V+policy="), scope=on_the_box(1)
        )
        assert check.ok == ok
        assert check.diagnosis == (
            "" if ok else "the gain has the wrong sign: the policy is u = -K z"
        )
    # six outputs of six states are a gradient unless it is said
    assert set(from_network(game, path).network) == {"gradient"}


FEATURES = ", ".join(["1", *(f"x{i}*x{j}" for i in range(1, 7) for j in range(i, 7))])


def test_a_basis_in_words_or_as_a_function_and_a_constant(game: Game) -> None:
    plant = small("plant.json", states=["speed", "alpha"])
    P = solve_game(load_game("plant.json")).P
    words = (
        "verify",
        "--model",
        plant,
        "--weights",
        stored("W.npz", weights=[*weights_of(P), -1.0]),
        "--basis",
    )
    assert answer(*words, "speed**2, speed*x2, x2**2, sin(alpha)**4", code=FAILED)["ok"] is False
    weights = np.append(-3.0, weights_of(value(game)))
    check = check_critic(
        game, from_weights(game, weights, features_of(FEATURES, 6)), scope=on_the_box(1)
    )
    assert check.ok
    assert check.to_dict()["network"]["value_at_origin"] == -3.0
    z = ca.SX.sym("z", 6)
    squares = ca.Function("squares", [z], [z**2])
    assert not check_critic(
        game, from_weights(game, np.diag(value(game)), squares), scope=on_the_box(1)
    ).ok
    with pytest.raises(
        BadInputError, match="there are 6 weights and 6 states; the features are 22 functions"
    ):
        from_weights(game, np.ones(6), features_of(FEATURES, 6))


@pytest.mark.parametrize(
    "text", ["__import__('os')", "x7", "x1.real", "x1 if x1 else x2", "[x1]", "x1**", ""]
)
def test_what_is_no_basis_is_refused_and_not_run(text: str) -> None:
    with pytest.raises(BadInputError, match="features") as caught:
        features_of(text, 6)
    assert "\n" not in str(caught.value)


def test_an_npy_file_of_any_name_is_what_its_shape_says(game: Game) -> None:
    for entry, right in {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}.items():
        np.save("mine.npy", right)
        found = critic_in("mine.npy", game)
        stored_part = {"W": found.weights, "P": found.P, "K": found.K}[entry]
        assert np.array_equal(stored_part, right)
    np.save("odd.npy", np.ones((4, 3)))
    assert (
        "odd.npy: the array of shape (4, 3) is neither"
        in hfa("verify", *AT_15, "--weights", "odd.npy").err
    )


# Refused in one line.


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("executed",)


def refused(path: str | Path, **how: Any) -> str:
    with pytest.raises(BadInputError) as caught:
        network_in(path, 6, **how)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


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
        ) in refused(path)
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
        "has more than 200000 numbers": {"weight": np.zeros((40_000, 6))},
        "the layer before gives 1": {"0.weight": good, "1.weight": good},
    }
    for said, tensors in wrong.items():
        assert said in refused(torch_file("wrong.pt", tensors)), said
    assert "is float16" in refused(
        safetensors_file("half.safetensors", {"weight": good.astype("float16")})
    )
    for name, content in (
        ("a.pt", b"PK\3\4"),
        ("b.pt", b"text"),
        ("c.safetensors", b"\xff" * 20),
        ("d.pkl", b""),
    ):
        Path(name).write_bytes(content)
        refused(name)
    with Path("large.pt").open("wb") as stream:
        stream.truncate(2**25)
    assert "larger than 16 MiB" in refused("large.pt")
    with zipfile.ZipFile("script.pt", "w") as archive:
        for name in ("script/data.pkl", "script/constants.pkl", "script/code/__torch__.py"):
            archive.writestr(name, b"")
    assert "it is TorchScript, a program; save state_dict" in refused("script.pt")


def test_wrong_graphs_are_refused() -> None:
    pytest.importorskip("onnx", reason="the package onnx is not installed")
    constants = {"P": np.eye(6, dtype="float32"), "ones": ONES.astype("float32")}
    half = {name: each.astype("float16") for name, each in constants.items()}
    ten = {"P": np.ones((10, 1), "float32")}
    not_a_number = {"P": np.full((6, 6), np.nan, "float32")}
    for said, nodes, numbers, states in (
        ("has 10 inputs and the plant 6 states", [("MatMul", "x P", "y")], ten, 10),
        ("operator Loop is not known", [("Loop", "x", "y")], constants, 6),
        ("is float16; give weights as float32", QUADRATIC, half, 6),
        ("not finite", QUADRATIC, constants | not_a_number, 6),
    ):
        assert said in refused(onnx_file("wrong.onnx", nodes, numbers, states=states))
    onnx_file("good.onnx", QUADRATIC, constants)
    network_in("good.onnx", 6)
    assert (
        "belongs to a state dict"
        in hfa("verify", *AT_15, "--weights", "good.onnx", "--set", "activation=tanh").err
    )
    Path("damaged.onnx").write_bytes(Path("good.onnx").read_bytes()[:-40])
    refused("damaged.onnx")


def test_weights_beside_a_graph_are_read_from_its_folder_alone() -> None:
    """As torch exports by default; a path out of the folder is not followed."""
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    constants = {"P": np.diag(np.arange(1.0, 7.0)), "ones": ONES}
    for folder in ("inside", "elsewhere"):
        Path(folder).mkdir()
    model = onnx.load(onnx_file("graph.onnx", QUADRATIC, constants))
    onnx.save(
        model, "inside/a.onnx", save_as_external_data=True, location="a.data", size_threshold=0
    )
    assert (Path("inside") / "a.data").exists()
    (read,) = network_in("inside/a.onnx", 6).functions.values()
    assert float(read(np.ones(6))) == 21.0
    Path("inside/a.data").rename("elsewhere/a.data")
    assert "cannot be read (No such file" in refused("inside/a.onnx")
    Path("inside/a.data").symlink_to("../elsewhere/a.data")
    assert "its data are in another folder" in refused("inside/a.onnx")
    model = onnx.load("inside/a.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        next(
            entry for entry in tensor.external_data if entry.key == "location"
        ).value = "../elsewhere/a.data"
    Path("inside/b.onnx").write_bytes(model.SerializeToString())
    assert "its data are in another folder; export the weights inside" in refused("inside/b.onnx")


def test_without_the_package_onnx_its_files_alone_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    Path("a.onnx").write_bytes(b"")
    assert "install hfa with the extra [networks]" in refused("a.onnx")
    network_in(linear(np.zeros((5, 6))), 6)


def test_outputs_that_fit_nothing_or_two_things_are_refused(game: Game) -> None:
    said = hfa("verify", *AT_15, "--weights", linear(np.zeros((3, 6)))).err
    assert "the network has 3 outputs; on this plant V has 1, gradient has 6, policy has 5" in said
    plant = stored("plant.json", **GOPS["plant"])
    path = linear(-np.ones((1, 3)))
    said = hfa("verify", "--model", plant, "--weights", path)
    assert (said.code, "1 outputs may be V or policy; say which, as --network V=" in said.err) == (
        BAD_INPUT,
        True,
    )
    assert hfa("verify", "--model", plant, "--weights", path, "--network", "policy=").code == FAILED
    assert "has no setting 'activation'" in hfa("verify", *AT_15, "--set", "activation=tanh").err
