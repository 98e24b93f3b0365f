"""State dicts with several networks, and tensors that may act on them."""

import numpy as np
import pytest
from network_files import read, refusal, torch_file

RANDOM = np.random.default_rng(7)
STATES = 6
ACTIONS = 2
pytestmark = pytest.mark.usefixtures("folder")


def chain(prefix, names, widths):
    """Return random weights and biases of a chain of linear layers.

    prefix: prefix of the tensors' names
    names: names of the layers
    widths: numbers of inputs and outputs of the layers, one more than names
    """
    tensors = {}
    for name, takes, gives in zip(names, widths[:-1], widths[1:], strict=True):
        tensors[f"{prefix}{name}.weight"] = RANDOM.normal(size=(gives, takes)) / np.sqrt(takes)
        tensors[f"{prefix}{name}.bias"] = 0.1 * RANDOM.normal(size=gives)
    return tensors


def actor(prefix, names=("0", "2", "4")):
    return chain(prefix, names, (STATES, 8, 8, ACTIONS))


def critic(prefix, names=("0", "2", "4")):
    return chain(prefix, names, (STATES, 8, 8, 1))


def test_a_policy_is_read_beside_other_networks():
    """Names tell the policy from a value and from the tensors of an optimizer."""
    tensors = {"log_std": np.zeros(ACTIONS), **actor("actor."), **critic("critic.")}
    tensors |= {"optimizer.state.0.exp_avg": np.ones((8, STATES))}
    layers = ["actor.0", "actor.2", "actor.4"]
    path = torch_file("a.pt", tensors)
    policy = read(path, inputs=ACTIONS, activation="tanh", network="policy=").policy
    for x in 3.0 * RANDOM.normal(size=(20, STATES)):
        h = x
        for name in layers:
            h = tensors[f"{name}.weight"] @ h + tensors.get(f"{name}.bias", 0.0)
            h = np.tanh(h) if name != layers[-1] else h
        assert np.array(policy(x)).ravel() == pytest.approx(h, rel=1e-9)


@pytest.mark.parametrize(
    ("more", "part", "named"),
    [
        ({"obs_norm.mean": np.zeros(STATES)}, "actor", "obs_norm.mean"),
        ({"action_scale": np.ones(ACTIONS)}, "actor", "action_scale"),
        ({"norm.weight": np.ones(STATES), "norm.bias": np.ones(STATES)}, "actor", "norm.weight"),
        ({"out.weight": np.ones((3, ACTIONS))}, "actor", "out.weight"),
        ({"skip.weight": np.ones((ACTIONS, STATES))}, "actor", "skip.weight"),
        ({"std": np.ones(STATES)}, "", "'std' (6,)"),
    ],
)
def test_a_tensor_of_unknown_function_is_refused(more, part, named):
    """A tensor of unknown function that may act on the network is refused by name."""
    path = torch_file("a.pt", actor("actor.") | critic("critic.") | more)
    said = refusal(path, inputs=ACTIONS, activation="tanh", network=f"policy={part}")
    assert named in said
    assert "ONNX" in said or "select one of the networks" in said
