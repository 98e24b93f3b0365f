"""Networks of any activation and width, for one observation and for all flights at once."""

import numpy as np
import pytest
from policy_cases import gtm_deployment
from scipy.special import ndtr

#: Activation -> the function by NumPy.
ACTIVATIONS = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "sigmoid": lambda x: 1.0 / (1.0 + np.exp(-x)),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(x)),
    "silu": lambda x: x / (1.0 + np.exp(-x)),
    "leaky_relu": lambda x: np.where(x > 0.0, x, 0.01 * x),
    "gelu": lambda x: x * ndtr(x),
    "selu": lambda x: 1.0507009873554805 * np.where(x > 0.0, x, 1.6732632423543772 * np.expm1(x)),
}


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_activations_on_rows_are_those_of_numpy(name, tmp_path):
    """With any number of units; the observations are not changed."""
    layers = {"0.weight": 30.0 * np.eye(4), "0.bias": np.zeros(4), "2.weight": np.eye(2, 4)}
    np.savez(tmp_path / "one.npz", **layers, **{"2.bias": np.zeros(2)})
    entries = {"file": str(tmp_path / "one.npz"), "activation": name}
    actor = gtm_deployment(entries).actor
    observations = np.linspace(-1.5, 1.5, 31)[:, None] * [1.0, -0.7, 0.5, 0.2]
    kept = observations.copy()
    expected = ACTIVATIONS[name](30.0 * observations[:, :2])
    if actor.rows is not None:  # gelu and selu have a graph alone
        np.testing.assert_allclose(actor.rows(observations), expected, rtol=1e-13, atol=1e-15)
    graph = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(graph, expected, rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(observations, kept)


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
