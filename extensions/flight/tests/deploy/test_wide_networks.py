"""Networks of any activation, for one observation and for all flights at once."""

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
    """A hidden layer has the values of NumPy, by `rows`, which evaluates many observations at once in
    NumPy, and in the graph of CasADi. The observations are not changed.
    """
    layers = {"0.weight": 30.0 * np.eye(4), "0.bias": np.zeros(4), "2.weight": np.eye(2, 4)}
    np.savez(tmp_path / "one.npz", **layers, **{"2.bias": np.zeros(2)})
    entries = {"file": str(tmp_path / "one.npz"), "activation": name}
    actor = gtm_deployment(entries).actor
    observations = np.linspace(-1.5, 1.5, 31)[:, None] * [1.0, -0.7, 0.5, 0.2]
    kept = observations.copy()
    expected = ACTIVATIONS[name](30.0 * observations[:, :2])
    assert (actor.rows is None) == (name == "gelu")  # gelu has a graph alone
    if actor.rows is not None:
        np.testing.assert_allclose(actor.rows(observations), expected, rtol=1e-13, atol=1e-12)
    graph = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(graph, expected, rtol=1e-13, atol=1e-12)
    np.testing.assert_array_equal(observations, kept)
