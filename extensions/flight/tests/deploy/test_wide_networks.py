"""Evaluation of networks for all flights at once, and flights that end early."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from policy_cases import aircraft, gtm_deployment, trims
from scipy.optimize import root
from scipy.special import ndtr

from hfa import assess


def wide_file(path, width, seed=0):
    """Write a state dict with two hidden layers and random weights, and return its path.

    width: number of units of each hidden layer
    """
    random = np.random.default_rng(seed)
    sizes = (4, width, width, 2)
    arrays = {}
    for index, (n, k) in enumerate(pairwise(sizes)):
        arrays[f"{index}.weight"] = random.normal(size=(k, n)) / np.sqrt(n)
        arrays[f"{index}.bias"] = 0.1 * random.normal(size=k)
    arrays["2.weight"] *= 0.02
    arrays["2.bias"] *= 0.02
    np.savez(path, **arrays)
    return str(path)


#: Activation -> the function by NumPy.
ACTIVATIONS = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "sigmoid": lambda x: 1.0 / (1.0 + np.exp(-x)),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(x)),
    "silu": lambda x: x / (1.0 + np.exp(-x)),
    "leaky_relu": lambda x: np.where(x > 0.0, x, 0.01 * x),
}


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activations_on_rows_are_those_of_numpy(name, tmp_path):
    """At each width; the observations are not changed."""
    layers = {"0.weight": 30.0 * np.eye(4), "0.bias": np.zeros(4), "2.weight": np.eye(2, 4)}
    np.savez(tmp_path / "one.npz", **layers, **{"2.bias": np.zeros(2)})
    entries = {"file": str(tmp_path / "one.npz"), "activation": name}
    actor = gtm_deployment(entries).actor
    observations = np.linspace(-1.5, 1.5, 31)[:, None] * [1.0, -0.7, 0.5, 0.2]
    kept = observations.copy()
    expected = ACTIVATIONS[name](30.0 * observations[:, :2])
    np.testing.assert_allclose(actor.rows(observations), expected, rtol=1e-13, atol=1e-15)
    graph = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(graph, expected, rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(observations, kept)


def selu(x):
    return 1.0507009873554805 * np.where(x > 0.0, x, 1.6732632423543772 * np.expm1(x))


@pytest.mark.parametrize(
    ("activation", "function", "width"),
    [("gelu", lambda x: x * ndtr(x), 100), ("selu", selu, 160)],
)
def test_networks_of_any_width_have_any_activation(tmp_path, activation, function, width):
    file = wide_file(tmp_path / "wide.npz", width)
    actor = gtm_deployment({"file": file, "activation": activation}).actor
    observations = np.random.default_rng(1).normal(size=(20, 4))
    expected, arrays = observations, np.load(file)
    for index in range(3):
        expected = expected @ arrays[f"{index}.weight"].T + arrays[f"{index}.bias"]
        expected = function(expected) if index < 2 else expected
    graph = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(graph, expected, rtol=0, atol=1e-12)


def test_a_wide_onnx_graph_equals_numpy(tmp_path):
    """With a layer of normalization, GELU and a branch that meets the chain again."""
    onnx = pytest.importorskip("onnx")
    random = np.random.default_rng(0)
    sizes = {
        "first": (4, 100),
        "gain": (100,),
        "bias": (100,),
        "second": (100, 100),
        "last": (100, 2),
    }
    arrays = {name: random.normal(size=size) / 10.0 for name, size in sizes.items()}
    weights = [onnx.numpy_helper.from_array(array, name) for name, array in arrays.items()]
    make = onnx.helper.make_node
    nodes = [
        make("MatMul", ["o", "first"], ["a"]),
        make("LayerNormalization", ["a", "gain", "bias"], ["b"]),
        make("MatMul", ["b", "second"], ["c"]),
        make("Gelu", ["c"], ["d"]),
        make("Add", ["d", "b"], ["e"]),
        make("MatMul", ["e", "last"], ["raw"]),
    ]
    describe = onnx.helper.make_tensor_value_info
    taken = [describe("o", onnx.TensorProto.DOUBLE, [1, 4])]
    given = [describe("raw", onnx.TensorProto.DOUBLE, [1, 2])]
    graph = onnx.helper.make_graph(nodes, "actor", taken, given, weights)
    onnx.save(onnx.helper.make_model(graph), tmp_path / "wide.onnx")
    actor = gtm_deployment({"file": str(tmp_path / "wide.onnx")}).actor
    observations = random.normal(size=(20, 4))
    a = observations @ arrays["first"]
    spread = np.sqrt(a.var(axis=1, keepdims=True) + 1e-5)
    b = (a - a.mean(axis=1, keepdims=True)) / spread * arrays["gain"] + arrays["bias"]
    c = b @ arrays["second"]
    expected = (c * ndtr(c) + b) @ arrays["last"]
    graph = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(graph, expected, rtol=0, atol=1e-12)


@pytest.mark.slow  # test_assess.py has a pendulum a full turn apart
def test_a_flight_at_another_equilibrium_has_not_converged():
    """A kinked gain with a second equilibrium: SciPy's root of it, at a pitch above .06 rad."""
    o = ca.SX.sym("o", 4)
    another = 0.064 * (1.0 + ca.tanh(200.0 * (o[3] - 0.06)))
    raw = ca.vertcat(0.8 * o[3] + 0.6 * o[2] - another, -2.0 * o[0])
    deployment = gtm_deployment({"file": ca.Function("two", [o], [raw])})
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    (found,) = assess(model, deployment, [point], samples=8, best=0).points
    flown = found.flights
    assert 0 < flown.elsewhere < 8
    assert flown.elsewhere + flown.returned + flown.lost == 8
    assert not found.holds
    act = deployment.actor.function

    def rates(x):
        moved = np.array(act(x - np.array(point.states))).ravel()
        return model.at(x, np.array(point.inputs) + moved).f

    other = root(rates, np.add(point.states, [0.0, 0.0, 0.0, 0.12]), tol=1e-12).x
    assert other[3] - point["pitch"] > 0.06
    assert flown.elsewhere_at["pitch"] == pytest.approx(other[3], abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "activation"), [(64, "tanh"), (256, "relu")])
def test_networks_of_common_sizes_are_assessed(tmp_path, width, activation):
    """Networks of common sizes are assessed, and their gains agree with central differences of the
    command.
    """
    file = wide_file(tmp_path / "wide.npz", width)
    deployment = gtm_deployment({"file": file, "activation": activation})
    result = assess(aircraft("ppo_gtm"), deployment, [45.0], samples=2, best=0)
    (point,), deployed = result.points, result.deployed
    assert np.isfinite(point.radius)
    assert point.flights.starts == 2
    equilibrium = point.equilibrium
    step = 1e-6 * np.array([1.0, 0.1, 0.1, 0.1])
    columns = [list(point.point.model.states).index(name) for name in point.point.model.linear]
    commanded = deployed.command
    trim = deployed.trim_vector(point.point)
    for number, column in enumerate(columns):
        moved = np.zeros(len(equilibrium.states))
        moved[column] = step[number]
        ahead, behind = (
            np.array(commanded(equilibrium.states + sign * moved, equilibrium.inputs, trim)).ravel()
            for sign in (1.0, -1.0)
        )
        slope = (ahead - behind) / (2.0 * step[number])
        inputs = [list(point.point.model.inputs).index(name) for name in ("elevator", "throttle")]
        np.testing.assert_allclose(-equilibrium.K[:, number], slope[inputs], rtol=1e-4, atol=1e-6)
