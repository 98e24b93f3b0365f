"""Tensors of a state dict, sorted into layers, input normalizer and output squash.

Checkpoints of rsl_rl, rl_games, skrl and CleanRL contain more than layers. The names of their
tensors identify the library.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from hfa_support.errors import BadInputError, shortened

Tensors = Mapping[str, np.ndarray]
Kind = TypeVar("Kind")
#: Words in the names of tensors that a policy does not use.
_ONLY_CRITICS = frozenset(("critic", "critics", "discriminator"))
#: Words of critics, including words that may name a quantity observed by a policy.
_OF_CRITICS = _ONLY_CRITICS | {
    *("value", "values", "target", "targets", "reward", "rewards", "privileged"),
}
#: Names of critic modules. "q" alone may also be a pitch rate.
_Q = re.compile(r"(q|qs|qf|vf|qfs)\d*(_?(net|network|function|target)s?)?\d*")
#: Modules of rsl_rl that contain the standard deviation of a random action as "std".
_WITH_SPREAD = ("", "model_state_dict", "actor_state_dict", "distribution", "actor", "policy")
#: Words in the names of tensors that only training uses.
_OF_TRAINING = frozenset(("optimizer", "optimizers", "scheduler"))
_ELSE = (
    "save the state dict of the network alone, or export the network to ONNX with everything "
    "that acts on its inputs or outputs"
)


class Normalizer(NamedTuple):
    """Normalizer x -> clip((x - mean) / deviation, -clip, clip) of a state dict.

    name: name of its module in the file.
    mean: (n,).
    deviation: (n,), above 0.
    clip: largest absolute value, or inf for none.
    """

    name: str
    mean: np.ndarray
    deviation: np.ndarray
    clip: float


class Squash(NamedTuple):
    """Output map y -> tanh(y) scale + bias, read from a state dict.

    scale, bias: (m,), for m outputs.
    """

    scale: np.ndarray
    bias: np.ndarray


class Parts(NamedTuple):
    """Tensors of a state dict, sorted by function, for one part such as the policy.

    layers: tensors of the layers.
    normalizer: normalizer before the first layer, or None.
    squash: output map after the last layer, or None.
    others: tensors of unknown function.
    unused: tensors that do not act on a policy, judged by their names.
    """

    layers: dict[str, np.ndarray]
    normalizer: Normalizer | None
    squash: Squash | None
    others: dict[str, np.ndarray]
    unused: dict[str, np.ndarray]


def _of_rsl_rl(group: Tensors) -> tuple[np.ndarray, float]:
    """Return standard deviation (n,) and clip of rsl_rl's EmpiricalNormalization."""
    return group["_std"] + 0.01, np.inf


def _of_rl_games(group: Tensors) -> tuple[np.ndarray, float]:
    """Return standard deviation (n,) and clip of rl_games' RunningMeanStd."""
    return np.sqrt(group["running_var"] + 1e-5), 5.0


def _of_skrl(group: Tensors) -> tuple[np.ndarray, float]:
    """Return standard deviation (n,) and clip of skrl's RunningStandardScaler."""
    return np.sqrt(group["running_variance"]) + 1e-8, 5.0


#: Names of the tensors, last word of their module ("" for any), name of the mean, and function that
#: returns the divisor and the clip.
_NORMALIZERS: tuple[
    tuple[frozenset[str], str, str, Callable[[Tensors], tuple[np.ndarray, float]]], ...
] = (
    (frozenset(("_mean", "_var", "_std", "count")), "", "_mean", _of_rsl_rl),
    (
        frozenset(("running_mean", "running_var", "count")),
        "running_mean_std",
        "running_mean",
        _of_rl_games,
    ),
    (
        frozenset(("running_mean", "running_variance", "current_count")),
        "",
        "running_mean",
        _of_skrl,
    ),
)


def without_training(tensors: Tensors) -> dict[str, np.ndarray]:
    """Return the tensors of a checkpoint that do not belong to an optimizer."""
    return {name: array for name, array in tensors.items() if not _words(name) & _OF_TRAINING}


def parts_of(tensors: Tensors, part: str, *, is_policy: bool) -> Parts:
    """Return the tensors of a state dict, sorted by function.

    part: words that select layers by their names, joined by +. "" selects all layers
    is_policy: whether "" selects the policy alone, without a critic in the same file

    Raises BadInputError if no layer is selected, or if several normalizers or squashes may belong
    to the part.
    """
    groups = _grouped(tensors)
    normalizers = {}
    squashes = {}
    remaining: dict[str, np.ndarray] = {}
    for stem, group in groups.items():
        normalizer = _normalizer(stem, group)
        if normalizer is not None:
            normalizers[stem] = normalizer
            continue
        leaves = dict(group)
        if {"action_scale", "action_bias"} <= leaves.keys():
            scale = leaves.pop("action_scale").ravel()
            squashes[stem] = Squash(scale, leaves.pop("action_bias").ravel())
        remaining |= {_joined(stem, leaf): array for leaf, array in leaves.items()}
    layers = {}
    for name, array in remaining.items():
        is_chosen = _has_word(name, part) if part else not (is_policy and _is_of_critic(name))
        if is_chosen and not _is_spread(name):
            layers[name] = array
    if not layers:
        where = shortened(", ".join(roots(tensors)), 200)
        advice = f"choose from {where}" if where else "this is a single network: remove the name"
        raise BadInputError(f"the file contains no tensors named {shortened(part)!r}; {advice}")
    of_critic = all(map(_is_of_critic, layers))
    others = {
        name: array
        for name, array in remaining.items()
        if name not in layers and not _is_spread(name) and (of_critic or not _is_of_critic(name))
    }
    unused = {
        name: array
        for name, array in remaining.items()
        if not (of_critic or name in layers or name in others or _words(name) & _ONLY_CRITICS)
    }
    squash = None if of_critic else _the_one("action_scale", squashes, layers)
    return Parts(layers, _normalizer_of(normalizers, layers, of_critic), squash, others, unused)


def refuse_others(others: Tensors, unused: Tensors, takes: int, gives: int) -> None:
    """Raise BadInputError if an unread tensor may act on the inputs or outputs of a network.

    - Linear layers are accepted as a separate network, unless their sizes fit before, after or in
      parallel to this network. Unused layers with one output are accepted as a critic, and unused
      layers of a standard deviation if they have as many outputs as the network.
    - Another unused tensor is accepted unless its size is the number of inputs or of outputs. The
      size 1 is accepted, and for a standard deviation the number of outputs.
    - Any other tensor is refused.

    others: tensors of a state dict that belong to no network that is read
    unused: tensors whose names indicate a critic or the standard deviation of an action
    takes, gives: number of inputs and of outputs of the network
    """
    chains: dict[str, list[tuple[str, np.ndarray]]] = {}
    tensors = {**others, **unused}
    for name, array in tensors.items():
        stem, _, leaf = name.rpartition(".")
        if array.ndim == 2 and leaf == "weight":
            chains.setdefault(stem.rpartition(".")[0] or stem, []).append((name, array))
    for name, array in tensors.items():
        stem, _, leaf = name.rpartition(".")
        folder = stem.rpartition(".")[0] or stem
        is_of_layers = leaf in ("weight", "bias") and array.ndim <= 2 and folder in chains
        acting = {takes, gives} - ({gives} if _is_spread(name) else {1})
        may_act = name in others or array.size in acting
        if may_act and not is_of_layers:
            raise BadInputError(
                f"tensor {shortened(name)!r} {array.shape} is not recognized and may act on "
                f"the network's inputs or outputs; {_ELSE}"
            )
    for layers in chains.values():
        name, first = layers[0]
        entry = first.shape[1]
        end = len(layers[-1][1])
        if name in unused and end == (gives if _is_spread(name) else 1):
            continue
        is_parallel = len(layers) == 1 and (entry, end) == (takes, gives)
        if end == takes or entry == gives or is_parallel:
            raise BadInputError(
                f"tensor {shortened(name)!r} {first.shape} is not recognized and may be a "
                f"layer that acts on the network's inputs or outputs; {_ELSE}"
            )


def roots(tensors: Iterable[str]) -> list[str]:
    """Return the names of the networks in a state dict, each once.

    A name is that of a tensor without layer number and "weight" or "bias". Empty names are omitted.
    """
    stems = (re.sub(r"\.?\d*\.?(weight|bias)$", "", name) for name in tensors)
    return [stem for stem in dict.fromkeys(stems) if stem]


def _words(name: str) -> set[str]:
    return set(re.findall("[a-z]+", name.lower()))


def _is_of_critic(name: str) -> bool:
    is_q = any(_Q.fullmatch(module) for module in name.split("."))
    return is_q or bool(_words(name) & _OF_CRITICS)


def _is_spread(name: str) -> bool:
    """Return whether a tensor belongs to the standard deviation of a random action."""
    words = _words(name)
    modules = name.split(".")
    is_std = modules[-1] in ("std", "std_param") and ["", *modules][-2] in _WITH_SPREAD
    return is_std or "sigma" in modules or "logstd" in words or {"log", "std"} <= words


def _has_word(name: str, part: str) -> bool:
    """Return whether the name of a tensor contains one of the words of "word+word".

    A word that is a number must be at the beginning of the name.
    """
    for word in part.split("+"):
        is_first = f".{name}.".startswith(f".{word}.")
        if word and (is_first or (not word.isdigit() and f".{word}." in f".{name}.")):
            return True
    return False


def _grouped(tensors: Tensors) -> dict[str, dict[str, np.ndarray]]:
    """Return the tensors of a state dict by module: module -> {name within the module: tensor}."""
    groups: dict[str, dict[str, np.ndarray]] = {}
    for name, array in tensors.items():
        stem, _, leaf = name.rpartition(".")
        groups.setdefault(stem, {})[leaf] = array
    return groups


def _joined(stem: str, leaf: str) -> str:
    return f"{stem}.{leaf}" if stem else leaf


def _normalizer(stem: str, group: Tensors) -> Normalizer | None:
    """Return the normalizer that the tensors of a module define, or None.

    Raises BadInputError if a standard deviation is not positive.

    stem: name of the module
    group: name within the module -> tensor
    """
    for names, module, mean, divisor in _NORMALIZERS:
        if group.keys() == names and stem.endswith(module):
            deviation, clip = divisor(group)
            if not np.all(deviation > 0.0):
                raise BadInputError(
                    f"normalizer {shortened(stem)} has a variance <= 0; save the network with "
                    "positive variances"
                )
            return Normalizer(stem, group[mean].ravel(), deviation.ravel(), clip)
    return None


def _normalizer_of(
    found: Mapping[str, Normalizer], layers: Tensors, of_critic: bool
) -> Normalizer | None:
    """Return the normalizer of a network's inputs, or None if the file does not contain one.

    A critic without its own normalizer has the normalizer of the file. Raises BadInputError if
    several normalizers fit, or if a normalizer scales a critic's value.

    found: name -> normalizer of the file
    layers: tensors of the network
    of_critic: whether the network is a critic
    """
    own = {stem: each for stem, each in found.items() if _is_of_critic(stem) == of_critic}
    if of_critic:
        for stem in own:
            if _words(stem) & {"value", "values", "reward", "rewards"}:
                raise BadInputError(
                    f"module {shortened(stem)!r} scales the value or the reward, which is not "
                    f"supported; {_ELSE}"
                )
        own = own or dict(found)
    return _the_one("normalizer", own, layers)


def _the_one(what: str, found: Mapping[str, Kind], layers: Tensors) -> Kind | None:
    """Return the normalizer or squash that belongs to a network, or None if the file has none.

    If the file has only one, it belongs to the network. Of several, exactly one must have a name
    that begins with the first word of a layer's name. Otherwise BadInputError is raised.

    what: noun for the message, such as "normalizer"
    found: name -> normalizer or squash of the file
    layers: tensors of the network's layers
    """
    if len(found) < 2:
        return next(iter(found.values()), None)
    begins = {name.partition(".")[0] for name in layers}
    own = [each for stem, each in found.items() if stem.partition(".")[0] in begins]
    if len(own) != 1:
        names = shortened(", ".join(found), 120)
        raise BadInputError(f"the file contains more than one {what} ({names}); {_ELSE}")
    return own[0]
