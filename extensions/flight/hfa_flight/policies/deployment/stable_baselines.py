"""Reader of Stable-Baselines3 zip files (PPO, A2C, SAC and TD3).

Conventions of Stable-Baselines3 2.x:

- PPO and A2C clip the mean to the Box. SAC, TD3 and PPO with `squash_output` apply tanh and map
  [-1, 1] to the Box.
- The activation is in `policy_kwargs`. The default is tanh for PPO and A2C, and relu for SAC and
  TD3.
- With gSDE, the mean of SAC is clipped to ±clip_mean (2) before tanh.
"""

from __future__ import annotations

import base64
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controller.critic.network.tensors import checked_tensors, tensors_in, unpacked
from hfa_flight.policies.deployment.inert_pickle import inert
from hfa_support.errors import BadInputError, file_faults, prefix_errors, shortened, shown
from hfa_support.files import regular_file
from hfa_support.schema import Number

#: Class name of a torch activation -> name of the activation.
_ACTIVATIONS = {
    "Tanh": "tanh",
    "ReLU": "relu",
    "LeakyReLU": "leaky_relu",
    "ELU": "elu",
    "SiLU": "silu",
    "GELU": "gelu",
    "Sigmoid": "sigmoid",
    "Softplus": "softplus",
    "SELU": "selu",
}
_CLIP_MEAN = 2.0
#: Supported policy classes. The first is also that of sb3_contrib's TRPO, the last is that of TQC.
_POLICIES = (
    "stable_baselines3.common.policies.ActorCriticPolicy",
    "stable_baselines3.sac.policies.SACPolicy",
    "stable_baselines3.td3.policies.TD3Policy",
    "sb3_contrib.tqc.policies.TQCPolicy",
)
#: Features extractor without an effect.
_FLATTEN = "stable_baselines3.common.torch_layers.FlattenExtractor"
#: Settings that are read, or that do not affect the output of a trained actor.
_SETTINGS = (
    *("net_arch", "activation_fn", "use_sde", "squash_output", "clip_mean"),
    *("features_extractor_class", "features_extractor_kwargs", "share_features_extractor"),
    *("log_std_init", "full_std", "use_expln", "ortho_init", "normalize_images"),
    *("optimizer_class", "optimizer_kwargs", "n_critics", "n_quantiles"),
)


@dataclass(frozen=True, eq=False)
class Zip:
    """Settings of a policy in a Stable-Baselines3 zip.

    algorithm: "PPO or A2C", "SAC" or "TD3".
    part: names of the actor's tensors, for `network_in`.
    activation: activation between the layers.
    layout: widths of the hidden layers.
    squash: whether the output passes through tanh and is mapped to the Box.
    clip_mean: largest absolute value before tanh, or inf without a clip.
    low, high: (m,), the Box of the actions.
    observations: number of observations.
    """

    algorithm: str
    part: str
    activation: str
    layout: tuple[int, ...]
    squash: bool
    clip_mean: float
    low: np.ndarray
    high: np.ndarray
    observations: int


def read_zip(path: str | Path) -> Zip:
    """Read the settings in the zip of a policy, without executing its code.

    Raises a BadInputError that names the file and the fault.
    """
    with prefix_errors(path), file_faults(path):
        try:
            with zipfile.ZipFile(regular_file(path)) as archive:
                data = json.loads(_member(archive, "data"))
                if not isinstance(data, dict):
                    raise BadInputError(
                        'the member "data" of the zip file is not a dictionary; save the model '
                        "again"
                    )
                tensors, _ = checked_tensors(tensors_in(_member(archive, "policy.pth"), ".pth"))
        except (OSError, BadInputError):
            raise
        except Exception as error:  # a damaged member may cause any exception
            raise BadInputError(
                f"the file is not a zip file of Stable-Baselines3 ({error}); give a file written "
                "by model.save"
            ) from error
        return _described(data, tensors)


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    """Return a file in the zip. Raises BadInputError if the file is missing."""
    if name not in archive.namelist():
        raise BadInputError(
            f"the zip file contains no member {name!r}; give a file written by Stable-Baselines3's "
            "model.save"
        )
    return unpacked(archive, name)


def _described(data: Mapping[str, Any], tensors: Mapping[str, np.ndarray]) -> Zip:
    """Return the settings of a policy."""
    _refuse_other_class("policy_class", data, _POLICIES)
    settings = _stored(data, "policy_kwargs") or {}
    if not isinstance(settings, dict):
        raise BadInputError("policy_kwargs is not a dictionary; save the model again")
    for name in settings:
        if name not in _SETTINGS:
            raise BadInputError(
                f"policy_kwargs sets {shown(name)}, which is not supported; export the policy "
                "to ONNX"
            )
    _refuse_other_class("features_extractor_class", settings, (_FLATTEN,))
    algorithm, part, usual = _algorithm(tensors)
    action_space = _box(data, "action_space", "actions")
    observation_space = _box(data, "observation_space", "observations")
    uses_sde = bool(settings.get("use_sde", data.get("use_sde", False)))
    squash = algorithm != "PPO or A2C" or bool(settings.get("squash_output", False))
    if algorithm == "PPO or A2C" and squash and not uses_sde:
        raise BadInputError(
            "policy_kwargs sets squash_output without use_sde, whose output is mapped to the box "
            "without tanh or clip, and which Stable-Baselines3 no longer loads; export the policy "
            "to ONNX"
        )
    clips_mean = algorithm == "SAC" and uses_sde
    clip_mean = _number(settings, "clip_mean", _CLIP_MEAN) if clips_mean else 0.0
    actor = [array for name, array in tensors.items() if _is_weight(name, part)]
    return Zip(
        algorithm=algorithm,
        part=part,
        activation=_activation(settings.get("activation_fn"), usual),
        layout=tuple(len(array) for array in actor[:-1]),
        squash=squash,
        clip_mean=clip_mean or float("inf"),
        low=action_space[0],
        high=action_space[1],
        observations=observation_space[0].size,
    )


def _refuse_other_class(entry: str, data: Mapping[str, Any], known: tuple[str, ...]) -> None:
    """Raise BadInputError if an entry is present and is not one of the known classes."""
    if data.get(entry) is None:
        return
    try:
        found = _stored(data, entry)
    except BadInputError as error:  # its message names the class or function
        raise BadInputError(
            f"{entry} is not a class of Stable-Baselines3 ({str(error).partition(';')[0]}); export "
            "the policy to ONNX"
        ) from error
    made_of = getattr(found, "made_of", None) or shown(found)
    if made_of not in known:
        raise BadInputError(
            f"{entry} is {shortened(made_of)}, which is not supported; export the policy to ONNX"
        )


def _algorithm(tensors: Mapping[str, np.ndarray]) -> tuple[str, str, str]:
    """Return algorithm, words that select the actor's tensors, and default activation."""
    names = " ".join(tensors)
    if "features_extractor." in names:
        raise BadInputError(
            "the policy has a features extractor with weights, which is not supported; "
            "export the policy to ONNX"
        )
    if any(name.startswith("actor.") and "running_mean" in name for name in tensors):
        raise BadInputError(
            "the actor uses batch normalization, as in CrossQ, which is not supported in a zip "
            "file; export the policy to ONNX"
        )
    if "lstm" in names:
        raise BadInputError(
            "the policy is recurrent, which is not supported; give a feed-forward policy"
        )
    if "action_net.weight" in tensors:
        return "PPO or A2C", "policy_net+action_net", "tanh"
    if "actor.latent_pi" in names or "actor.log_std" in names:
        return "SAC", "latent_pi+mu", "relu"
    if "actor.mu." in names:
        return "TD3", "actor", "relu"
    raise BadInputError(
        "the zip file contains no actor of PPO, A2C, SAC or TD3; export the policy to ONNX"
    )


def _is_weight(name: str, part: str) -> bool:
    in_part = any(f".{word}." in f".{name}." for word in part.split("+"))
    return in_part and name.endswith("weight")


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
            return inert(content)
    return entry


def _number(entries: Mapping[str, Any], name: str, usual: float) -> float:
    """Return a nonnegative number among the entries, or `usual` if it is missing."""
    entry = entries.get(name)
    if entry is None:
        return usual
    number = Number(0.0).of(entry)
    if number is None:
        raise BadInputError(f"{name} is {shown(entry)}; give {Number(0.0)}")
    return number


def _activation(stored: Any, usual: str) -> str:
    if stored is None:
        return usual
    made_of = getattr(stored, "made_of", str(stored))
    name = made_of.rpartition(".")[2]
    if name not in _ACTIVATIONS:
        raise BadInputError(
            f"the activation {shortened(made_of)} is not supported; use {', '.join(_ACTIVATIONS)}"
        )
    return _ACTIVATIONS[name]


def _box(data: Mapping[str, Any], name: str, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest values of a Box, (k,) each."""
    space = _stored(data, name)
    kind = getattr(space, "made_of", type(space).__name__).rpartition(".")[2]
    low = getattr(space, "low", None)
    high = getattr(space, "high", None)
    if not (isinstance(low, np.ndarray) and isinstance(high, np.ndarray)):
        raise BadInputError(
            f"the space of the {what} is a {shortened(kind)}, but only a Box is "
            "supported; train a policy with a Box"
        )
    if low.ndim != 1 or low.shape != high.shape:
        raise BadInputError(
            f"the Box of the {what} has {low.ndim} axes, but only one is supported; train a policy "
            "with a flat Box"
        )
    if not np.all(low <= high):
        raise BadInputError(
            f"the Box of the {what} has a lower limit above the upper limit; save the model again"
        )
    return np.array(low, dtype=float), np.array(high, dtype=float)


def is_stable_baselines(path: Path) -> bool:
    """Return whether a file is a zip of Stable-Baselines3.

    Such a zip contains `data` and `policy.pth`.
    """
    try:
        with zipfile.ZipFile(regular_file(path)) as archive:
            return {"data", "policy.pth"} <= set(archive.namelist())
    except (OSError, zipfile.BadZipFile):
        return False
