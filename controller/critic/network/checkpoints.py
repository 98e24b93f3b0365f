"""Checkpoints of other libraries, told by the names of their tensors: a table of layouts.

The boxes are those of the libraries' code: Stable-Baselines3 and CleanRL.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.critic.network.declared import ActionBox, Declared, Normalizer
from controller.critic.network.layers import activation_named, has_word, is_deviation, is_of_critic
from controller.critic.network.tensors import Inert, flattened, torch_content, unpickled
from hfa_support.errors import (
    BadInputError,
    file_faults,
    numbers_in,
    prefix_errors,
    shortened,
    shown,
)
from hfa_support.files import Number, regular_file, unpacked

Tensors = Mapping[str, np.ndarray]


class LibraryLayout(NamedTuple):
    """Layout of the policies of a library.

    algorithm: algorithm and library
    own_name: regular expression of the name of a tensor that only this layout has. Its group
        `root` precedes the names of the layers
    words: words that select the layers of the policy, those that the file has, joined by +. {} is
        the root
    required: regular expression of a name that the file must have
    squash: as in `ActionBox`
    has_box: whether the root has action_scale and action_bias
    activation: between the layers, or None
    """

    algorithm: str
    own_name: str
    words: str
    required: str = ""
    squash: str = ""
    has_box: bool = False
    activation: str | None = None


_CLEANRL = LibraryLayout(
    "TD3 or DDPG of CleanRL",
    r"(?P<root>(.*\.)?)fc_mu\.weight",
    "{}fc1+{}fc2+{}fc_mu",
    required="action_scale",
    squash="tanh",
    has_box=True,
)
_SB3 = LibraryLayout(
    "SAC of Stable-Baselines3",
    r"(?P<root>(.*\.)?)latent_pi\.0\.weight",
    "{}latent_pi+{}mu",
    required=r"log_std\.weight",
    squash="tanh",
)
#: All layouts. The first that fits is that of a file.
LAYOUTS = (
    _SB3,
    _SB3._replace(
        algorithm="TD3 or DDPG of Stable-Baselines3",
        own_name=r"(?P<root>(.*\.)?actor\.)mu\.0\.weight",
        words="{}mu",
        required=r"critic\.qf0",
    ),
    _SB3._replace(
        algorithm="PPO or A2C of Stable-Baselines3",
        own_name=r"(?P<root>(.*\.)?)action_net\.weight",
        words="{}mlp_extractor.shared_net+{}mlp_extractor.policy_net+{}action_net",
        required=r"mlp_extractor\.",
        squash="",
    ),
    _CLEANRL,
    _CLEANRL._replace(
        algorithm="SAC of CleanRL",
        own_name=r"(?P<root>(.*\.)?)fc_mean\.weight",
        words="{}fc1+{}fc2+{}fc_mean",
    ),
)


def checkpoint_of(tensors: Tensors) -> tuple[dict[str, np.ndarray], Declared] | None:
    """Return the tensors of a checkpoint without those of its action box, and what the checkpoint
    states of its policy.

    The result is None if the names of the tensors fit no layout of `LAYOUTS`.
    """
    for layout in LAYOUTS:
        root = _root(layout, tensors)  # precedes the names of the policy's layers, such as "actor."
        if root is None:
            continue
        used = _names_of_box(root) if layout.has_box else ()
        others = {name: array for name, array in tensors.items() if name not in used}
        return others, Declared(
            algorithm=layout.algorithm,
            network=words_in(layout.words.replace("{}", root), tensors),
            activation=layout.activation,
            action=_action_of(layout, root, tensors),
        )
    return None


def words_in(words: str, tensors: Tensors) -> str:
    """Return the words of "word+word" that a tensor has in its name."""
    return "+".join(
        word for word in words.split("+") if any(has_word(name, word) for name in tensors)
    )


def _root(layout: LibraryLayout, tensors: Tensors) -> str | None:
    """Return what precedes the names of a layout's layers in a file, or None for another layout."""
    own = [found for name in tensors if (found := re.fullmatch(layout.own_name, name))]
    has_required = any(re.search(layout.required, name) for name in tensors)
    if not own or not has_required:
        return None
    root = own[0]["root"]
    if layout.has_box and not {*_names_of_box(root)} <= tensors.keys():
        return None

    words = layout.words.replace("{}", root)  # {} is the root
    layers = (
        name for name, array in tensors.items() if array.ndim == 2 and name.endswith("weight")
    )
    has_other_layers = any(
        name.startswith(root)
        and not (has_word(name, words) or is_deviation(name) or is_of_critic(name))
        for name in layers
    )
    # Another layer below the root may act on the policy: the layout does not fit. If the root is ""
    # and there is no box, the layer may be of any other network in the file, and is not counted.
    return None if has_other_layers and (root or layout.has_box) else root


def _names_of_box(root: str) -> tuple[str, str]:
    """Return the names of the tensors of an action box: of its half-widths and its middle."""
    return f"{root}action_scale", f"{root}action_bias"


def _action_of(layout: LibraryLayout, root: str, tensors: Tensors) -> ActionBox:
    """Return the way from the output of a checkpoint's network to the action."""
    if not layout.has_box:
        return ActionBox(layout.squash)
    half_width, middle = (np.ravel(tensors[name]).astype(float) for name in _names_of_box(root))
    return ActionBox(layout.squash, middle - half_width, middle + half_width)


def _layout(algorithm: str, words: str, activation: str, squash: str) -> LibraryLayout:
    """Return the layout of a class of Stable-Baselines3, with its default activation and squash."""
    return LibraryLayout(algorithm, own_name="", words=words, squash=squash, activation=activation)


_ON_POLICY = _layout("A2C", "shared_net+policy_net+action_net", "tanh", "")
_SAC = _layout("SAC", "latent_pi+mu", "relu", "tanh")
_TD3 = _layout("TD3", "actor", "relu", "tanh")
_LAYOUT_OF_CLASS = {
    "stable_baselines3.common.policies.ActorCriticPolicy": _ON_POLICY,
    "stable_baselines3.common.policies.MultiInputActorCriticPolicy": _ON_POLICY,
    "stable_baselines3.sac.policies.SACPolicy": _SAC,
    "stable_baselines3.sac.policies.MultiInputPolicy": _SAC,
    "sb3_contrib.tqc.policies.TQCPolicy": _SAC._replace(algorithm="TQC"),
    "sb3_contrib.tqc.policies.MultiInputPolicy": _SAC._replace(algorithm="TQC"),
    "stable_baselines3.td3.policies.TD3Policy": _TD3,
    "stable_baselines3.td3.policies.MultiInputPolicy": _TD3,
    "sb3_contrib.ars.policies.ARSPolicy": _layout("ARS", "action_net", "relu", "tanh"),
    "sb3_contrib.ars.policies.ARSLinearPolicy": _layout("ARS", "action_net", "relu", ""),
}
#: Entry of the file `data` that only this algorithm of the on-policy class has.
_ALGORITHM_OF_ENTRY = {"clip_range": "PPO", "cg_max_steps": "TRPO"}
#: Features extractors without weights.
_EXTRACTORS = tuple(
    f"stable_baselines3.common.torch_layers.{name}"
    for name in ("FlattenExtractor", "CombinedExtractor")
)
#: Settings that are read, or that do not affect the output of a trained actor.
_KNOWN_SETTINGS = (
    *("net_arch", "activation_fn", "use_sde", "squash_output", "clip_mean", "with_bias"),
    *("features_extractor_class", "features_extractor_kwargs", "share_features_extractor"),
    *("log_std_init", "full_std", "use_expln", "ortho_init", "normalize_images", "device"),
    *("optimizer_class", "optimizer_kwargs", "n_critics", "n_quantiles", "lr_scheduler_class"),
)
#: Largest magnitude of the mean of SAC and TQC with gSDE, by default.
_CLIP_MEAN = 2.0
_TO_ONNX = "export the policy to ONNX"


def is_stable_baselines(path: Path) -> bool:
    """Return whether a file is a zip of Stable-Baselines3: with `data` and `policy.pth`."""
    try:
        return {"data", "policy.pth"} <= unpacked(regular_file(path).read_bytes()).keys()
    except (OSError, BadInputError):
        return False


def read_zip(path: Path) -> tuple[dict[str, np.ndarray], Declared]:
    """Return the tensors of a zip of Stable-Baselines3, not checked, and what it states of its
    policy.

    Raises BadInputError for a policy that is no feed-forward network of a vector.
    """
    members = unpacked(regular_file(path).read_bytes())
    data = json.loads(members["data"])
    if not isinstance(data, dict):
        raise BadInputError(
            'the member "data" of the zip file is not a dictionary; save the model again'
        )
    tensors = flattened(torch_content(members["policy.pth"]))
    return tensors, _declared_in(data, tensors)


def _declared_in(data: Mapping[str, Any], tensors: Tensors) -> Declared:
    """Return what the member `data` of a zip states of the policy with these tensors."""
    actions = _stored_box(data, "action")
    settings = _settings_of(data)
    of_class = _class_of(data, tensors)
    observations = _stored_box(data, "observation")
    activation = settings.get("activation_fn")
    # "Tanh" of the class torch.nn.modules.activation.Tanh in the pickle, for example.
    class_of_activation = str(getattr(activation, "made_of", activation)).rpartition(".")[2]
    return Declared(
        algorithm=_algorithm(of_class, data, settings),
        network=words_in(of_class.words, tensors),
        activation=(
            of_class.activation if activation is None else activation_named(class_of_activation)
        ),
        action=_action_box(of_class, actions, data, settings),
        is_normalized=of_class is _ON_POLICY and _is_normalized(data),
        seen=_seen(data, of_class.algorithm),
        observations=observations.names,
        inputs=observations.low.size,
    )


def _settings_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a policy. Raises BadInputError for one that is not supported."""
    settings = _stored(data, "policy_kwargs") or {}
    if not isinstance(settings, dict):
        raise BadInputError("policy_kwargs is not a dictionary; save the model again")
    for name in settings:
        if name not in _KNOWN_SETTINGS:
            raise BadInputError(
                f"policy_kwargs sets {shown(name)}, which is not supported; {_TO_ONNX}"
            )
    _class_name("features_extractor_class", settings, _EXTRACTORS)  # refuses all others
    return settings


def _action_box(
    of_class: LibraryLayout, actions: _Box, data: Mapping[str, Any], settings: Mapping[str, Any]
) -> ActionBox:
    """Return the way from the output of a policy's network to its action."""
    uses_sde = settings.get("use_sde", data.get("use_sde"))  # state-dependent exploration
    squash = of_class.squash
    if of_class.algorithm in ("A2C", "ARS") and settings.get("squash_output") is not None:
        squash = "tanh" if settings["squash_output"] else ""
    # The class of A2C and PPO applies tanh only with gSDE. In any case, it maps [-1, 1] to the box.
    if of_class is _ON_POLICY and squash and not uses_sde:
        squash = "linear"
    # SAC and TQC clip the output to ±clip_mean with gSDE. 0 means that they do not.
    has_clip = of_class.algorithm in ("SAC", "TQC") and uses_sde
    clip_mean = _number(settings, "clip_mean", _CLIP_MEAN) if has_clip else 0.0
    return ActionBox(squash, actions.low, actions.high, clip_mean or math.inf)


def _class_of(data: Mapping[str, Any], tensors: Tensors) -> LibraryLayout:
    """Return the class of a policy. Raises BadInputError for one that is not supported."""
    names = " ".join(tensors)
    if "features_extractor." in names:
        raise BadInputError(
            f"the policy has a features extractor with weights, which is not supported; {_TO_ONNX}"
        )
    if any(name.startswith("actor.") and "running_mean" in name for name in tensors):
        raise BadInputError(
            "the actor uses batch normalization, as in CrossQ, which is not supported in a zip "
            f"file; {_TO_ONNX}"
        )
    if "lstm" in names:
        raise BadInputError(
            "the policy is recurrent, which is not supported; give a feed-forward policy"
        )
    policy_class = _class_name("policy_class", data, tuple(_LAYOUT_OF_CLASS))
    if not policy_class:
        raise BadInputError(f"the zip file does not state its policy_class; {_TO_ONNX}")
    return _LAYOUT_OF_CLASS[policy_class]


def _algorithm(
    of_class: LibraryLayout, data: Mapping[str, Any], settings: Mapping[str, Any]
) -> str:
    """Return the name of the algorithm that trained a policy of a class."""
    if of_class is _ON_POLICY:  # of PPO and TRPO, which store an entry of their own, and of A2C
        return next((name for key, name in _ALGORITHM_OF_ENTRY.items() if key in data), "A2C")
    is_ddpg = of_class is _TD3 and settings.get("n_critics") == 1  # set by the class DDPG
    return "DDPG" if is_ddpg else of_class.algorithm


def _class_name(entry: str, data: Mapping[str, Any], known: tuple[str, ...]) -> str:
    """Return the class in an entry, or "" without one. Raises BadInputError unless it is known."""
    if data.get(entry) is None:
        return ""
    try:
        stored = _stored(data, entry)
    except BadInputError as error:  # its message names the class or function
        raise BadInputError(
            f"{entry} is not a class of Stable-Baselines3 ({str(error).partition(';')[0]}); "
            f"{_TO_ONNX}"
        ) from error
    made_of = getattr(stored, "made_of", None) or shown(stored)
    if made_of not in known:
        raise BadInputError(f"{entry} is {shortened(made_of)}, which is not supported; {_TO_ONNX}")
    return str(made_of)


def _is_normalized(data: Mapping[str, Any]) -> bool:
    """Return whether the last observations of the training prove a normalizer before the policy."""
    # PPO, A2C and TRPO store _last_original_obs only with a VecNormalize: observations before it.
    try:
        seen, original = (_stored(data, name) for name in ("_last_obs", "_last_original_obs"))
    except BadInputError:
        return False
    are_arrays = isinstance(seen, np.ndarray) and isinstance(original, np.ndarray)
    return are_arrays and seen.shape == original.shape and bool(np.any(seen != original))


def _seen(data: Mapping[str, Any], algorithm: str) -> tuple[float, float]:
    """Return the least and largest number of observations that a VecNormalize of a training saw."""
    # It saw the observations of all steps, of the first reset of each environment (not in old
    # versions) and, with ARS, of all trials, whose number is not stored.
    steps, environments = data.get("num_timesteps"), data.get("n_envs")
    if not isinstance(steps, int) or steps == 0:
        return 0.0, math.inf
    if algorithm == "ARS" or not isinstance(environments, int):
        return steps, math.inf
    return steps, steps + environments


def _stored(data: Mapping[str, Any], name: str) -> Any:
    """Return an entry of the zip's file `data` by name, or None if it is missing."""
    entry = data.get(name)
    if isinstance(entry, dict) and ":serialized:" in entry:
        with prefix_errors(name):
            try:
                content = base64.b64decode(entry[":serialized:"])
            except (TypeError, ValueError) as error:
                raise BadInputError(
                    f"the entry is not base64 ({error}); save the model again"
                ) from error
            return unpickled(content)
    return entry


def _number(entries: Mapping[str, Any], name: str, usual: float | None = None) -> float:
    """Return an entry that is a number of at least 0, or `usual` without the entry."""
    entry = entries.get(name, usual)
    number = Number(0.0).of(entry.item() if isinstance(entry, np.generic) else entry)
    if number is None:
        raise BadInputError(f"{name} is {shown(entry)}; give {Number(0.0)}")
    return number


class _Box(NamedTuple):
    """Box of actions or observations, with the names of the entries of a dictionary of Boxes."""

    low: np.ndarray
    high: np.ndarray
    names: tuple[str, ...] = ()


def _stored_box(data: Mapping[str, Any], what: str) -> _Box:
    """Return the Box in an entry of the zip, or its dictionary of observations as one Box.

    what: "action" or "observation"
    """
    space = _stored(data, f"{what}_space")
    spaces = getattr(space, "spaces", None)
    if what == "action" or not isinstance(spaces, dict):
        return _checked_box(space, what, "")
    boxes = {key: _checked_box(part, what, str(key)) for key, part in spaces.items()}
    # The fields 0 and 1 of a _Box are its low and its high.
    low, high = (np.concatenate([box[end] for box in boxes.values()]) for end in (0, 1))
    names: list[str] = []
    for key, box in boxes.items():
        count = box.low.size
        names += [f"{key}[{place}]" if count > 1 else str(key) for place in range(count)]
    return _Box(low, high, tuple(names))


def _checked_box(space: Any, what: str, key: str) -> _Box:
    """Return the Box that a pickle contains. Raises BadInputError for another space.

    what, key: subject of the message: "action" or "observation", and an entry of a dictionary
    """
    kind = getattr(space, "made_of", type(space).__name__).rpartition(".")[2]
    if kind == "Discrete" and what == "action":
        raise BadInputError(
            f"the policy chooses one of {getattr(space, 'n', 'several')} discrete actions, as "
            "that of DQN does, and is no input u(x); train a policy with a Box of actions"
        )
    low, high = getattr(space, "low", None), getattr(space, "high", None)
    if not (isinstance(low, np.ndarray) and isinstance(high, np.ndarray)):
        raise BadInputError(
            f"the space of the {what}s {shortened(key)} is a {shortened(kind)}, but only a "
            "Box is supported; train a policy with a Box"
        )
    if low.shape != high.shape or low.ndim != 1 or np.any(low > high):
        raise BadInputError(
            f"the Box of the {what}s has {low.ndim} axes or has a lower limit above the "
            "upper limit; train a policy with a flat Box"
        )
    return _Box(low.astype(float), high.astype(float))


def read_normalizer(path: str | Path) -> tuple[Normalizer | None, int]:
    """Return the normalizer in a file of `VecNormalize.save`, and how many observations it saw.

    Of a dictionary of observations, all entries are joined in the order of its space. The
    normalizer is None if the VecNormalize does not normalize observations. Raises a BadInputError
    that names the file and the fault if the file contains no normalizer of all observations.
    """
    with prefix_errors(path), file_faults(path):
        stored = unpickled(regular_file(path).read_bytes())
        if not isinstance(stored, Inert) or not {"clip_obs", "epsilon"} <= vars(stored).keys():
            raise BadInputError(
                "the file does not contain a VecNormalize object; give a file written by "
                "VecNormalize.save"
            )
        if getattr(stored, "norm_obs", True) is False:
            return None, 0
        running = _statistics(stored)  # of each entry of the observations
        mean, variance = (
            np.concatenate([np.ravel(numbers_in(f"its {key}", part.get(key))) for part in running])
            for key in ("mean", "var")
        )
        epsilon, clip = (_number(vars(stored), name) for name in ("epsilon", "clip_obs"))
        count = running[0].get("count")
        seen = int(count) if isinstance(count, (int, float)) else 0
        return Normalizer(mean, variance, epsilon, clip, origin=Path(path).name), seen


def _statistics(stored: Inert) -> list[dict[str, Any]]:
    """Return the attributes of each running mean of a VecNormalize, in the order of its space."""
    running = getattr(stored, "obs_rms", None)
    if not isinstance(running, dict):
        running = {"observations": running}
    # In the order of a dictionary of spaces or, without one, of the running means.
    names = getattr(getattr(stored, "observation_space", None), "spaces", running)
    missing = [name for name in names if not isinstance(running.get(name), Inert)]
    if missing or not running:
        listed = shortened(", ".join(map(str, missing)))
        raise BadInputError(
            f"the VecNormalize object contains no obs_rms of {listed}; give mean and variance in "
            "the deployment file, 0 and 1 where nothing is normalized"
        )
    return [vars(running[name]) for name in names]
