"""Selection of the layers of one network in a state dict.

Besides the layers of the network, a state dict may contain other networks and the standard
deviation of a random action. Any other tensor may act on the network, and is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np

from hfa_support.errors import BadInputError, shortened

Tensors = Mapping[str, np.ndarray]
#: Words in the names of critics' tensors, which a policy does not use.
_OF_CRITICS = frozenset(("critic", "critics", "value", "values", "target", "targets"))
#: Names of critic modules. "q" alone may also be a pitch rate.
_Q = re.compile(r"(q|qs|qf|vf|qfs)\d*(_?(net|network|function|target)s?)?\d*")
#: Words in the names of tensors that only training uses.
_OF_TRAINING = frozenset(("optimizer", "optimizers", "scheduler"))
_ELSE = "export the network to ONNX with everything that acts on its inputs or outputs"


def without_training(tensors: Tensors) -> dict[str, np.ndarray]:
    """Return the tensors of a checkpoint that do not belong to an optimizer."""
    return {name: array for name, array in tensors.items() if not _words(name) & _OF_TRAINING}


def layers_of(tensors: Tensors, part: str, *, is_policy: bool) -> dict[str, np.ndarray]:
    """Return the tensors of a network's layers.

    part: words that select layers by their names, joined by +. "" selects all layers
    is_policy: whether "" selects the policy alone, without a critic in the same file

    Raises BadInputError if no layer is selected.
    """
    layers = {}
    for name, array in tensors.items():
        is_chosen = _has_word(name, part) if part else not (is_policy and _is_of_critic(name))
        if is_chosen and not _is_spread(name):
            layers[name] = array
    if not layers:
        where = shortened(", ".join(roots(tensors)), 200)
        advice = f"choose from {where}" if where else "this is a single network: remove the name"
        raise BadInputError(f"the file contains no tensors named {shortened(part)!r}; {advice}")
    return layers


def refuse_others(others: Tensors, takes: int, gives: int) -> None:
    """Raise BadInputError if a tensor that is not read may act on a network.

    The standard deviation of an action is accepted unless it has an entry for each input. Linear
    layers are accepted as a separate network, unless their sizes fit before, after or in parallel
    to this network.

    others: tensors of a state dict that belong to no network that is read
    takes, gives: number of inputs and of outputs of the network
    """
    chains: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name, array in others.items():
        if name.endswith("weight") and array.ndim == 2:
            chains.setdefault(_folder(name), []).append((name, array))
    for name, array in others.items():
        is_of_layers = name.endswith(("weight", "bias")) and array.ndim <= 2
        if is_of_layers and _folder(name) in chains:
            continue
        if not _is_spread(name) or (array.size == takes != gives):
            raise BadInputError(
                f"tensor {shortened(name)!r} {array.shape} is not a layer and may act on the "
                f"network's inputs or outputs; {_ELSE}"
            )
    for layers in chains.values():
        name, first = layers[0]
        _, last = layers[-1]
        entry, end = first.shape[1], len(last)
        if (_is_of_critic(name) and end == 1) or (_is_spread(name) and end == gives):
            continue
        is_parallel = len(layers) == 1 and (entry, end) == (takes, gives)
        if end == takes or entry == gives or is_parallel:
            raise BadInputError(
                f"tensor {shortened(name)!r} {first.shape} may be a layer that acts on the "
                f"network's inputs or outputs; {_ELSE}"
            )


def roots(tensors: Iterable[str]) -> list[str]:
    """Return the names of the networks in a state dict, each once.

    A name is that of a tensor without layer number and "weight" or "bias". Empty names are omitted.
    """
    stems = (re.sub(r"\.?\d*\.?(weight|bias)$", "", name) for name in tensors)
    return [stem for stem in dict.fromkeys(stems) if stem]


def _folder(name: str) -> str:
    """Return the module that contains the layer of a tensor, or the layer without a module."""
    layer = name.rpartition(".")[0]
    return layer.rpartition(".")[0] or layer


def _words(name: str) -> set[str]:
    return set(re.findall("[a-z]+", name.lower()))


def _is_of_critic(name: str) -> bool:
    is_q = any(_Q.fullmatch(module) for module in name.split("."))
    return is_q or bool(_words(name) & _OF_CRITICS)


def _is_spread(name: str) -> bool:
    """Return whether a tensor belongs to the standard deviation of a random action."""
    words = _words(name)
    return "sigma" in name.split(".") or "logstd" in words or {"log", "std"} <= words


def _has_word(name: str, part: str) -> bool:
    """Return whether the name of a tensor contains one of the words of "word+word"."""
    for word in part.split("+"):
        is_first = f".{name}.".startswith(f".{word}.")
        if word and (is_first or (not word.isdigit() and f".{word}." in f".{name}.")):
            return True
    return False
