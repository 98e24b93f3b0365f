"""Checkpoints of rsl_rl, rl_games and CleanRL, told by the names of their tensors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from controller.critic.network.stated import ActionBox, Normalizer, Stated

Tensors = Mapping[str, np.ndarray]
#: Constants of the normalizers in rsl_rl (added to the deviation) and rl_games.
_RSL_RL_EPSILON = 1e-2
_RL_GAMES_EPSILON, _RL_GAMES_CLIP = 1e-5, 5.0
#: Modules of a checkpoint of rsl_rl that may contain the normalizer of the policy.
_RSL_RL_NORMALIZERS = (
    *("model_state_dict.actor_obs_normalizer", "obs_norm_state_dict"),
    "actor_state_dict.obs_normalizer",
)
#: Last layer of the actors of CleanRL: TD3 and DDPG, and SAC.
_CLEANRL_HEADS = {"fc_mu": "TD3 or DDPG", "fc_mean": "SAC"}


def checkpoint_of(tensors: Tensors) -> tuple[dict[str, np.ndarray], Stated] | None:
    """Return the layers in a checkpoint and what it states of its policy, or None for others."""
    for read_layout in (_rsl_rl, _rl_games, _cleanrl):
        checkpoint = read_layout(tensors)
        if checkpoint is not None:
            stated, not_layers = checkpoint
            layers = {name: each for name, each in tensors.items() if name not in not_layers}
            return layers, stated
    return None


def _find(tensors: Tensors, end: str) -> str:
    """Return the first tensor whose name ends with a word, or ""."""
    return next((name for name in tensors if f".{name}".endswith(f".{end}")), "")


def _rsl_rl(tensors: Tensors) -> tuple[Stated, list[str]] | None:
    """Return what a checkpoint of rsl_rl states, and the names of the tensors that are no layers.

    Its normalizer is (o - mean) / (deviation + 0.01), in `obs_norm_state_dict` or beside the actor.
    """
    actor = "model_state_dict.actor"
    is_old = any(name.startswith(f"{actor}.") for name in tensors)
    is_new = any(name.startswith("actor_state_dict.mlp.") for name in tensors)
    if not is_old and not is_new:
        return None
    actor_prefix = actor if is_old else "actor_state_dict.mlp"
    not_layers = [
        name
        for name in tensors
        if name.rpartition(".")[2] in ("std", "std_param", "log_std_param", "log_std", "count")
        or "norm" in name
    ]
    normalizer = None
    for prefix in _RSL_RL_NORMALIZERS:
        mean, deviation = (tensors.get(f"{prefix}.{name}") for name in ("_mean", "_std"))
        if mean is not None and deviation is not None:
            divisor = np.ravel(deviation) + _RSL_RL_EPSILON
            normalizer = Normalizer(np.ravel(mean), divisor**2, 0.0, np.inf, "of the checkpoint")
    return Stated("PPO of rsl_rl", actor_prefix, normalizer=normalizer), not_layers


def _rl_games(tensors: Tensors) -> tuple[Stated, list[str]] | None:
    """Return what a checkpoint of rl_games states, and the names of tensors that are no layers."""
    head = _find(tensors, "a2c_network.mu.weight")
    if not head or not any(".actor_mlp." in name for name in tensors):
        return None
    mean, variance = (
        _find(tensors, f"running_mean_std.running_{name}") for name in ("mean", "var")
    )
    normalizer = None
    if mean and variance:
        normalizer = Normalizer(
            np.ravel(tensors[mean]),
            np.ravel(tensors[variance]),
            _RL_GAMES_EPSILON,
            _RL_GAMES_CLIP,
            "of the checkpoint",
        )
    not_layers = [name for name in tensors if "mean_std" in name or name.endswith("sigma")]
    not_layers += [name for name in tensors if tensors[name].ndim == 0]
    return Stated("PPO of rl_games", "actor_mlp+mu", normalizer=normalizer), not_layers


def _cleanrl(tensors: Tensors) -> tuple[Stated, list[str]] | None:
    """Return what a checkpoint of CleanRL states, and the names of the tensors that are no layers.

    Its actors of TD3, DDPG and SAC return tanh(output) action_scale + action_bias.
    """
    scale, bias = (_find(tensors, f"action_{name}") for name in ("scale", "bias"))
    root = scale.removesuffix("action_scale")
    head = next((each for each in _CLEANRL_HEADS if f"{root}{each}.weight" in tensors), "")
    of_actor = [name.removeprefix(root) for name in tensors if name.startswith(root)]
    known = {"fc1", "fc2", head, "fc_logstd", "action_scale", "action_bias"}
    is_cleanrl = {name.partition(".")[0] for name in of_actor} <= known
    if not (scale and bias and head and is_cleanrl) or np.any(tensors[scale] < 0.0):
        return None
    middle, half = np.ravel(tensors[bias]), np.ravel(tensors[scale])
    box = ActionBox("tanh", middle - half, middle + half)
    words = "+".join(f"{root}{name}" for name in ("fc1", "fc2", head))
    others = (scale, bias, f"{root}fc_logstd.weight", f"{root}fc_logstd.bias")
    return Stated(f"{_CLEANRL_HEADS[head]} of CleanRL", words, action=box), list(others)
