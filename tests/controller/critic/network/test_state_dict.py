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


@pytest.mark.parametrize(
    "more",
    [
        {"obs_norm.mean": np.zeros(STATES)},
        {"norm.weight": np.ones(STATES), "norm.bias": np.ones(STATES)},
        {"log_std": np.ones(STATES)},
        {"action_scale": np.ones(ACTIONS)},
        {"skip.weight": np.ones((ACTIONS, STATES))},
    ],
)
def test_a_tensor_of_unknown_function_is_refused_or_named_as_not_used(more):
    """A tensor beside actor and critic that may act on the actor is refused, unless the user names
    the actor: then a note says that the tensor is not used. One with an entry for each state may
    normalize them, and is refused in any case.

    The refusal proposes this name. A deviation log_std of 6 entries is one of the states, not of
    the 2 actions.
    """
    path = torch_file("a.pt", OF_ACTOR | OF_CRITIC | more)
    options = {"inputs": ACTIONS, "activation": "tanh"}
    unknown, values = next(iter(more.items()))
    said = refusal(path, network="policy=", **options)
    assert unknown in said
    if values.size == STATES:
        assert "may act on the" in refusal(path, network="policy=actor", **options)
        return
    assert 'network="policy=actor"' in said
    policy = read(path, network="policy=actor", **options)
    x = RANDOM.normal(size=(3, STATES))
    assert policy.u(x) == pytest.approx(output_of(OF_ACTOR, ACTOR, np.tanh, x), rel=1e-9)
    (note,) = policy.declared.notes
    assert unknown.removesuffix(".weight") in note


def test_a_deviation_of_the_actions_acts_on_no_mean():
    """log_std with an entry for each action is that of the random actions in training."""
    path = torch_file("a.pt", OF_ACTOR | {"log_std": np.ones(ACTIONS)})
    policy = read(path, inputs=ACTIONS, activation="tanh")
    x = RANDOM.normal(size=(3, STATES))
    assert policy.u(x) == pytest.approx(output_of(OF_ACTOR, ACTOR, np.tanh, x), rel=1e-9)
