"""State dicts with several networks, and tensors that may act on them."""

from __future__ import annotations

import numpy as np
import pytest
from network_files import refusal, torch_file

RANDOM = np.random.default_rng(7)
STATES = 6
ACTIONS = 2
pytestmark = pytest.mark.usefixtures("folder")


def chain(prefix: str, names: tuple[str, ...], widths: tuple[int, ...]) -> dict[str, np.ndarray]:
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


def actor(prefix: str, names: tuple[str, ...] = ("0", "2", "4")) -> dict[str, np.ndarray]:
    return chain(prefix, names, (STATES, 8, 8, ACTIONS))


def critic(prefix: str, names: tuple[str, ...] = ("0", "2", "4")) -> dict[str, np.ndarray]:
    return chain(prefix, names, (STATES, 8, 8, 1))


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
def test_a_tensor_of_unknown_function_is_refused(more, part, named) -> None:
    """A tensor of unknown function that may act on the network is refused by name."""
    path = torch_file("a.pt", actor("actor.") | critic("critic.") | more)
    said = refusal(path, inputs=ACTIONS, activation="tanh", network=f"policy={part}")
    assert named in said
    assert "ONNX" in said or "select one of the networks" in said
