"""Checkpoints of other libraries, told by the names of their tensors: a table of layouts.

The normalizers and boxes are those of the libraries' code: rsl_rl, rl_games, skrl, tianshou, RLlib
and CleanRL. RLlib and tianshou map their actions to the box outside the checkpoint.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controller.critic.network.layers import has_word, is_deviation, is_of_critic
from controller.critic.network.stated import ActionBox, Normalizer, Stated, notes_on_statistics

Tensors = Mapping[str, np.ndarray]
#: Origin of a normalizer, for messages.
_WHOSE = "of the checkpoint"


class Running(NamedTuple):
    """Running statistics of observations, with which a library normalizes.

    mean, spread: ends of the names of their tensors
    is_variance: whether the spread is a variance, or else a standard deviation
    outer: number added to the standard deviation
    inner: number added to the variance
    clip: largest absolute normalized value
    """

    mean: str
    spread: str
    is_variance: bool = True
    outer: float = 0.0
    inner: float = 0.0
    clip: float = np.inf


class Layout(NamedTuple):
    """Layout of the policies of a library.

    algorithm: algorithm and library
    head: regular expression of the name of a tensor that only this layout has. Its group `root`
        precedes the names of the layers
    words: words that select the layers of the policy, those that the file has, joined by +. {} is
        the root
    without, beside: regular expressions of names that the file must not, and must have
    squash: as in `ActionBox`
    has_box: whether the root has action_scale and action_bias
    has_mean: whether the outputs are the mean, followed by as many standard deviations
    running: statistics of the normalizer, or None
    activation: between the layers, or None
    """

    algorithm: str
    head: str
    words: str
    without: str = ""
    beside: str = ""
    squash: str = ""
    has_box: bool = False
    has_mean: bool = False
    running: Running | None = None
    activation: str | None = None


_RSL_RL = Layout(
    "PPO of rsl_rl",
    r"(?P<root>model_state_dict\.actor)\.\d+\.weight",
    "{}",
    running=Running(
        r"(model_state_dict\.actor_obs_normalizer|obs_norm_state_dict|"
        r"actor_state_dict\.obs_normalizer)\._mean",
        "_std",
        is_variance=False,
        outer=1e-2,
    ),
)
_TIANSHOU = Layout(
    "tianshou",
    r"(?P<root>(.*\.)?)mu\.model\.\d+\.weight",
    "{}preprocess+{}mu",
    beside=r"preprocess\.",
)
_RLLIB = Layout(
    "RLlib",
    r"(?P<root>(.*\.)?)pi\.net\.mlp\.\d+\.weight",
    "{}encoder.actor_encoder+{}encoder.encoder+{}pi_encoder+{}pi",
    beside=r"encoder\.",
)
_CLEANRL = Layout(
    "TD3 or DDPG of CleanRL",
    r"(?P<root>(.*\.)?)fc_mu\.weight",
    "{}fc1+{}fc2+{}fc_mu",
    beside="action_scale",
    squash="tanh",
    has_box=True,
)
_SB3 = Layout(
    "SAC of Stable-Baselines3",
    r"(?P<root>(.*\.)?)latent_pi\.0\.weight",
    "{}latent_pi+{}mu",
    beside=r"log_std\.weight",
    squash="tanh",
)
#: All layouts. The first that fits is that of a file.
LAYOUTS = (
    _RSL_RL,
    _SB3,
    _SB3._replace(
        algorithm="TD3 or DDPG of Stable-Baselines3",
        head=r"(?P<root>(.*\.)?actor\.)mu\.0\.weight",
        words="{}mu",
        beside=r"critic\.qf0",
    ),
    _RSL_RL,
    _SB3,
    _SB3._replace(
        algorithm="TD3 or DDPG of Stable-Baselines3",
        head=r"(?P<root>(.*\.)?actor\.)mu\.0\.weight",
        words="{}mu",
        beside=r"critic\.qf0",
    ),
    _SB3._replace(
        algorithm="PPO or A2C of Stable-Baselines3",
        head=r"(?P<root>(.*\.)?)action_net\.weight",
        words="{}mlp_extractor.shared_net+{}mlp_extractor.policy_net+{}action_net",
        beside=r"mlp_extractor\.",
        squash="",
    ),
    _RSL_RL._replace(head=r"(?P<root>actor_state_dict\.mlp)\.\d+\.weight"),
    Layout(
        "PPO of rl_games",
        r"(?P<root>.*a2c_network\.)mu\.weight",
        "{}actor_mlp+{}mu",
        beside=r"\.actor_mlp\.",
        running=Running(r".*running_mean_std\.running_mean", "running_var", inner=1e-5, clip=5.0),
    ),
    Layout(
        "skrl",
        r"(?P<root>policy)\..*",
        "{}",
        beside=r"_preprocessor\.running_mean|policy\.(log_std_parameter|net_container\.)",
        running=Running(
            r"(state|observation)_preprocessor\.running_mean",
            "running_variance",
            outer=1e-8,
            clip=5.0,
        ),
    ),
    _TIANSHOU._replace(algorithm="SAC of tianshou", beside=r"critic2_old\.", squash="tanh"),
    _TIANSHOU,
    _RLLIB._replace(algorithm="SAC of RLlib", beside="qf_encoder", squash="tanh", has_mean=True),
    _RLLIB._replace(without=r"(.*\.)?pi\.log_std", has_mean=True),
    _RLLIB,
    _CLEANRL,
    _CLEANRL._replace(
        algorithm="SAC of CleanRL",
        head=r"(?P<root>(.*\.)?)fc_mean\.weight",
        words="{}fc1+{}fc2+{}fc_mean",
    ),
)


def checkpoint_of(tensors: Tensors) -> tuple[dict[str, np.ndarray], Stated] | None:
    """Return the tensors that no normalizer and box uses, and what a checkpoint states.

    The result is None for a file of no known layout.
    """
    for layout in LAYOUTS:
        root = _root(layout, tensors)
        if root is None:
            continue
        normalizer, notes, used = _normalizer(layout.running, tensors)
        used += _of_box(root) if layout.has_box else ()
        others = {name: each for name, each in tensors.items() if name not in used}
        words = words_in(layout.words.replace("{}", root), tensors)
        return others, Stated(
            layout.algorithm,
            words,
            layout.activation,
            _box(layout, root, tensors),
            normalizer,
            has_mean=layout.has_mean,
            notes=notes,
        )
    return None


def words_in(words: str, tensors: Tensors) -> str:
    """Return the words of "word+word" that a tensor has in its name."""
    return "+".join(
        word for word in words.split("+") if any(has_word(name, word) for name in tensors)
    )


def _root(layout: Layout, tensors: Tensors) -> str | None:
    """Return what precedes the names of a layout's layers in a file, or None if it does not fit.

    A layout does not fit if its root has layers that are not its own.
    """
    heads = [found for name in tensors if (found := re.fullmatch(layout.head, name))]
    has_others = layout.without and any(re.fullmatch(layout.without, name) for name in tensors)
    if not heads or has_others or not any(re.search(layout.beside, name) for name in tensors):
        return None
    root = heads[0]["root"]
    if layout.has_box and not {*_of_box(root)} <= tensors.keys():
        return None
    words = layout.words.replace("{}", root)
    for name, each in tensors.items():
        is_layer = each.ndim == 2 and name.startswith(root) and name.endswith("weight")
        is_own = has_word(name, words) or is_deviation(name) or is_of_critic(name)
        if is_layer and not is_own and (root or layout.has_box):
            return None
    return root


def _normalizer(
    running: Running | None, tensors: Tensors
) -> tuple[Normalizer | None, tuple[str, ...], tuple[str, ...]]:
    """Return the normalizer of a checkpoint, notes on it, and the names of its tensors."""
    if running is None:
        return None, (), ()
    for name in tensors:
        spread = name.removesuffix(name.rpartition(".")[2]) + running.spread
        if re.fullmatch(running.mean, name) and spread in tensors:
            mean, numbers = (np.ravel(tensors[each]).astype(float) for each in (name, spread))
            deviation = np.sqrt(numbers) if running.is_variance else numbers
            variance = (deviation + running.outer) ** 2
            normalizer = Normalizer(mean, variance, running.inner, running.clip, _WHOSE)
            return normalizer, notes_on_statistics(mean, numbers), (name, spread)
    return None, (), ()


def _of_box(root: str) -> tuple[str, str]:
    """Return the names of the tensors of a box: its half-widths and its middle."""
    return f"{root}action_scale", f"{root}action_bias"


def _box(layout: Layout, root: str, tensors: Tensors) -> ActionBox:
    """Return the way from the output of the network to the action."""
    if not layout.has_box:
        return ActionBox(layout.squash)
    half, middle = (np.ravel(tensors[name]).astype(float) for name in _of_box(root))
    return ActionBox(layout.squash, middle - half, middle + half)
