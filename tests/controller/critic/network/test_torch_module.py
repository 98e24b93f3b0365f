"""torch networks in memory, and stand-ins with the attributes of torch's modules."""

import numpy as np
import pytest
from scipy.special import expit, ndtr

import hfa
from hfa import BadInputError

GAME = hfa.Game([[0.0, 1.0], [2.0, -0.3]], [[0.0], [1.0]], Q=[1.0, 1.0], R=[1.0], delta=np.inf)
RANDOM = np.random.default_rng(3)
WEIGHTS = (RANDOM.normal(size=(8, 2)), RANDOM.normal(size=(1, 8)))
BIASES = (0.1 * RANDOM.normal(size=8), np.zeros(1))
POINTS = RANDOM.normal(size=(5, 2))


class _Tensor:
    """Stand-in for a tensor, with the methods that the reader calls."""

    dtype = "torch.float32"

    def __init__(self, values):
        self.values = values

    def detach(self):
        """Return the tensor itself."""
        return self

    cpu = detach

    def numpy(self):
        """Return the numbers as an array."""
        return np.asarray(self.values)


def _module(kind, **attributes):
    """Return a stand-in for a module of torch.nn with this class name and these attributes."""
    made = type(kind, (), {"__module__": "torch.nn.modules.any", **attributes})
    return made()


def _linear(weight, bias):
    parameters = {"weight": _Tensor(weight), "bias": None if bias is None else _Tensor(bias)}
    return _module("Linear", _parameters=parameters)


def _sequential(*parts):
    return _module(
        "Sequential",
        _modules={str(place): part for place, part in enumerate(parts)},
        __call__=lambda self, x: x,
        state_dict=lambda self: {},
    )


def _network(activation):
    first = _linear(WEIGHTS[0], BIASES[0])
    return _sequential(_sequential(first, activation), _linear(WEIGHTS[1], BIASES[1]))


def test_another_module_is_read_through_its_state_dict():
    """A module of the user's class, and its state dict, are the network of two linear layers with the
    given activation between them.

    Without an activation, or with a tensor that belongs to no linear layer, the module is refused.
    """
    tensors = {
        "body.0.bias": _Tensor(BIASES[0]),
        "body.0.weight": _Tensor(WEIGHTS[0]),
        "head.bias": _Tensor(BIASES[1]),
        "head.weight": _Tensor(WEIGHTS[1]),
    }
    made = type("Actor", (), {"state_dict": lambda self: tensors, "__call__": lambda self, x: x})
    critic = hfa.from_network(GAME, made(), activation="tanh")
    u = np.tanh(POINTS @ WEIGHTS[0].T + BIASES[0]) @ WEIGHTS[1].T + BIASES[1]
    assert critic.u(POINTS) == pytest.approx(u, rel=1e-12)
    assert "Actor" in critic.origin
    of_tensors = hfa.from_network(GAME, tensors, activation="tanh")
    assert np.array_equal(of_tensors.u(POINTS), critic.u(POINTS))
    with pytest.raises(BadInputError, match='give activation="tanh"'):
        hfa.from_network(GAME, made())
    tensors["norm.weight"] = _Tensor(np.ones(2))
    with pytest.raises(BadInputError, match=r"norm\.weight"):
        hfa.from_network(GAME, made(), activation="tanh")


@pytest.mark.parametrize(
    ("network", "said"),
    [
        (_network(_module("Dropout")), "contains Dropout"),
        (_network(_module("ELU", alpha=2.0)), "ELU has alpha = 2.0, but only 1.0 is supported"),
        (
            _sequential(_module("Tanh"), _linear(np.ones((1, 2)), None)),
            "activation Tanh, which does not directly follow a linear layer",
        ),
        (_sequential(_module("Identity")), "no tensors"),
        (lambda z: z, "but only torch modules"),
    ],
)
def test_unsupported_modules_and_settings_are_refused(network, said):
    """The message names the module or the setting that is not supported."""
    with pytest.raises(BadInputError, match=said):
        hfa.from_network(GAME, network)


def _above(x, below):
    return np.where(x > 0.0, x, below)


#: torch's activations with their default settings.
ACTIVATIONS = {
    "ELU": lambda x: _above(x, np.expm1(x)),
    "GELU": lambda x: x * ndtr(x),
    "Hardswish": lambda x: x * np.clip(x / 6.0 + 0.5, 0.0, 1.0),
    "Hardtanh": lambda x: np.clip(x, -1.0, 1.0),
    "Mish": lambda x: x * np.tanh(np.log1p(np.exp(x))),
    "Softsign": lambda x: x / (1.0 + np.abs(x)),
    "LeakyReLU": lambda x: _above(x, 0.01 * x),
    "ReLU": lambda x: _above(x, 0.0 * x),
    "SELU": lambda x: 1.0507009873554805 * _above(x, 1.6732632423543772 * np.expm1(x)),
    "SiLU": lambda x: x * expit(x),
    "Sigmoid": expit,
    "Softplus": lambda x: np.log1p(np.exp(x)),
    "Tanh": np.tanh,
}


@pytest.mark.parametrize("kind", ACTIVATIONS)
def test_each_activation_is_that_of_torch(kind):
    """A Sequential with an activation is the policy by the formula in torch's documentation.

    The modules have torch's default settings, which the reader compares.
    """
    defaults = {
        "ELU": {"alpha": 1.0},
        "GELU": {"approximate": "none"},
        "Hardtanh": {"min_val": -1.0, "max_val": 1.0},
        "LeakyReLU": {"negative_slope": 0.01},
        "Softplus": {"beta": 1.0, "threshold": 20.0},
    }
    critic = hfa.from_network(GAME, _network(_module(kind, **defaults.get(kind, {}))))
    z = 3.0 * POINTS
    u = ACTIVATIONS[kind](z @ WEIGHTS[0].T + BIASES[0]) @ WEIGHTS[1].T
    assert critic.u(z) == pytest.approx(u, rel=1e-7)
