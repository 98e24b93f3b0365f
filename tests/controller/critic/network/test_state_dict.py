"""State dicts of other libraries, with normalizers and squashes."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from network_files import refusal, torch_file

from controller.critic.network.network_file import network_in

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


def statistics(prefix: str, mean: str, *others: str) -> dict[str, np.ndarray]:
    """Return random statistics of the states, (1, STATES) each.

    mean: name of the mean, which may be negative
    others: names of positive statistics
    """
    sizes = {name: RANDOM.uniform(0.3, 2.0, (1, STATES)) for name in others}
    found = {mean: RANDOM.normal(size=(1, STATES)), **sizes}
    return {f"{prefix}{name}": array for name, array in found.items()}


def through(tensors: dict[str, np.ndarray], names: list[str], x: np.ndarray) -> np.ndarray:
    """Return the output of linear layers with tanh between them, for the input x."""
    for index, name in enumerate(names):
        x = tensors[f"{name}.weight"] @ x + tensors[f"{name}.bias"]
        if index + 1 < len(names):
            x = np.tanh(x)
    return x


def rsl_rl() -> tuple[dict[str, np.ndarray], str, Callable[[np.ndarray], np.ndarray]]:
    model = "model_state_dict."
    tensors = {
        f"{model}std": np.ones(ACTIONS),
        **actor(f"{model}actor."),
        **critic(f"{model}critic."),
    }
    tensors |= statistics(f"{model}actor_obs_normalizer.", "_mean", "_var", "_std")
    tensors |= {f"{model}actor_obs_normalizer.count": np.array(9.0)}
    tensors |= statistics(f"{model}critic_obs_normalizer.", "_mean", "_var", "_std")
    tensors |= {f"{model}critic_obs_normalizer.count": np.array(9.0)}
    tensors |= {"optimizer_state_dict.state.0.exp_avg": np.ones((8, STATES))}
    own = f"{model}actor_obs_normalizer."

    def policy(x: np.ndarray) -> np.ndarray:
        x = (x - tensors[f"{own}_mean"][0]) / (tensors[f"{own}_std"][0] + 0.01)
        return through(tensors, [f"{model}actor.{number}" for number in (0, 2, 4)], x)

    return tensors, "", policy


def rl_games() -> tuple[dict[str, np.ndarray], str, Callable[[np.ndarray], np.ndarray]]:
    net = "model.a2c_network."
    tensors = {
        **chain(f"{net}actor_mlp.", ("0", "2"), (STATES, 8, 8)),
        f"{net}sigma": np.zeros(ACTIONS),
        **chain(net, ("value",), (8, 1)),
        **chain(net, ("mu",), (8, ACTIONS)),
    }
    tensors |= {"model.value_mean_std.running_mean": np.zeros(1)}
    tensors |= {"model.value_mean_std.running_var": np.ones(1)}
    tensors |= {"model.value_mean_std.count": np.array(1.0)}
    own = "model.running_mean_std."
    tensors |= statistics(own, "running_mean", "running_var") | {f"{own}count": np.array(5.0)}

    def policy(x: np.ndarray) -> np.ndarray:
        deviation = np.sqrt(tensors[f"{own}running_var"][0] + 1e-5)
        x = np.clip((x - tensors[f"{own}running_mean"][0]) / deviation, -5.0, 5.0)
        h = np.tanh(through(tensors, [f"{net}actor_mlp.0", f"{net}actor_mlp.2"], x))
        return through(tensors, [f"{net}mu"], h)

    return tensors, "actor_mlp+mu", policy


def skrl() -> tuple[dict[str, np.ndarray], str, Callable[[np.ndarray], np.ndarray]]:
    tensors = {"policy.log_std_parameter": np.zeros(ACTIONS), **actor("policy.net.")}
    tensors |= critic("value.net.")
    own = "state_preprocessor."
    tensors |= statistics(own, "running_mean", "running_variance")
    tensors |= {f"{own}current_count": np.array(3.0)}

    def policy(x: np.ndarray) -> np.ndarray:
        deviation = np.sqrt(tensors[f"{own}running_variance"][0]) + 1e-8
        x = np.clip((x - tensors[f"{own}running_mean"][0]) / deviation, -5.0, 5.0)
        return through(tensors, [f"policy.net.{number}" for number in (0, 2, 4)], x)

    return tensors, "", policy


def clean_rl() -> tuple[dict[str, np.ndarray], str, Callable[[np.ndarray], np.ndarray]]:
    """Return the tensors of CleanRL's TD3, the name of the actor, and the actor before its
    squash.
    """
    tensors = {"0.action_scale": np.array([2.0, 0.5]), "0.action_bias": np.array([1.0, -0.5])}
    tensors |= actor("0.", ("fc1", "fc2", "fc_mu"))
    tensors |= chain("1.", ("fc1", "fc2", "fc3"), (STATES + ACTIONS, 8, 8, 1))
    return tensors, "0", lambda x: through(tensors, ["0.fc1", "0.fc2", "0.fc_mu"], x)


@pytest.mark.parametrize("library", [rsl_rl, rl_games, skrl, clean_rl])
def test_policies_of_several_libraries_are_read(library) -> None:
    """Policies of several libraries give the outputs of their formulas.

    The outputs are compared for single states and for rows.
    """
    tensors, part, policy = library()
    stored = network_in(torch_file("a.pt", tensors), STATES, "tanh", {"policy": part})
    for x in 3.0 * RANDOM.normal(size=(20, STATES)):
        expected = policy(x)
        assert np.array(stored.functions["policy"](x)).ravel() == pytest.approx(expected, rel=1e-9)
        assert stored.rows["policy"](x[None])[0] == pytest.approx(expected, rel=1e-9)
    if library is clean_rl:
        assert stored.squashes["policy"].scale.tolist() == [2.0, 0.5]
        assert "action_scale" in stored.chain
    else:
        assert "normalized by " in stored.chain


@pytest.mark.parametrize(
    ("more", "part", "named"),
    [
        ({"obs_norm.mean": np.zeros(STATES)}, "actor", "obs_norm.mean"),
        ({"obs_norm.running_mean": np.zeros(STATES)}, "", "obs_norm.running_mean"),
        ({"action_scale": np.ones(ACTIONS)}, "actor", "action_scale"),
        ({"scaler.std": np.ones(STATES)}, "actor", "scaler.std"),
        ({"obs_sigma": np.ones(STATES)}, "", "obs_sigma"),
        ({"q_scale": np.ones(STATES)}, "actor", "q_scale"),
        ({"encoder.weight": np.ones((STATES, STATES))}, "actor", "encoder.weight"),
        ({"norm.weight": np.ones(STATES), "norm.bias": np.ones(STATES)}, "actor", "norm.weight"),
        ({"out.weight": np.ones((3, ACTIONS))}, "actor", "out.weight"),
        ({"skip.weight": np.ones((ACTIONS, STATES))}, "actor", "skip.weight"),
        ({"target_encoder.weight": np.ones((STATES, STATES))}, "", "target_encoder.weight"),
        ({"value_scale": np.ones(STATES)}, "", "value_scale"),
        ({"obs_norm.log_std": np.ones(STATES)}, "actor", "obs_norm.log_std"),
        ({"std": np.ones(STATES)}, "", "'std' (6,)"),
        ({"sigma.weight": np.ones((STATES, STATES))}, "actor", "sigma.weight"),
    ],
)
def test_a_tensor_of_unknown_function_is_refused(more, part, named) -> None:
    """A tensor of unknown function that may act on the network is refused by name."""
    path = torch_file("a.pt", actor("actor.") | critic("critic.") | more)
    said = refusal(path, activation="tanh", parts={"policy": part})
    assert named in said


def test_a_normalizer_of_another_size_is_refused() -> None:
    """A normalizer whose size differs from the number of inputs of the network is refused."""
    own = {f"n.{name}": np.ones(3) for name in ("_mean", "_var", "_std")} | {"n.count": np.ones(())}
    path = torch_file("a.pt", actor("actor.") | own)
    assert "has 3 entries, but the network" in refusal(
        path, activation="tanh", parts={"policy": ""}
    )


def test_other_policies_in_a_file_are_ignored() -> None:
    """If the policy is named, another policy in the same file is ignored."""
    path = torch_file("a.pt", actor("pitch.") | actor("roll."))
    found = network_in(path, STATES, "tanh", {"policy": "pitch"}).functions["policy"]
    assert isinstance(found, ca.Function)
