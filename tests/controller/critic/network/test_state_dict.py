"""State dicts with several networks, and tensors that may act on them."""

import numpy as np
import pytest
from network_files import chain, output_of, read, refusal, torch_file

RANDOM = np.random.default_rng(7)
STATES = 6
ACTIONS = 2
pytestmark = pytest.mark.usefixtures("folder")


ACTOR = ("actor.0", "actor.2", "actor.4")
OF_ACTOR = chain(ACTOR, (STATES, 8, 8, ACTIONS), RANDOM)
OF_CRITIC = chain(("critic.0", "critic.2", "critic.4"), (STATES, 8, 8, 1), RANDOM)


def test_a_policy_is_read_beside_other_networks():
    """Names tell the policy from a value and from the tensors of an optimizer."""
    others = {"optimizer.state.0.exp_avg": np.ones((8, STATES)), "log_std": np.zeros(ACTIONS)}
    path = torch_file("a.pt", others | OF_ACTOR | OF_CRITIC)
    policy = read(path, inputs=ACTIONS, activation="tanh", network="policy=")
    x = 3.0 * RANDOM.normal(size=(20, STATES))
    assert policy.u(x) == pytest.approx(output_of(OF_ACTOR, ACTOR, np.tanh, x), rel=1e-9)


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
    path = torch_file("a.pt", OF_ACTOR | OF_CRITIC | more)
    said = refusal(path, inputs=ACTIONS, activation="tanh", network=f"policy={part}")
    assert named in said
    assert "ONNX" in said or "select one of the networks" in said
