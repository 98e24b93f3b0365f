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
_ADVICE = "export the network to ONNX with everything that acts on its inputs or outputs"


def without_training(tensors: Tensors) -> dict[str, np.ndarray]:
    """Return the tensors of a checkpoint that do not belong to an optimizer."""
    return {name: array for name, array in tensors.items() if not _words(name) & _OF_TRAINING}


def layers_of(tensors: Tensors, part: str, *, is_policy: bool) -> dict[str, np.ndarray]:
    """Return the tensors of a network's layers.

    part: words that select layers by their names, joined by +. "" selects all layers
    is_policy: whether "" selects the policy alone, without a critic in the same file

    Raises BadInputError if no layer is selected.
    """

    def is_chosen(name: str) -> bool:
        if part:
            return _has_word(name, part)
        return not (is_policy and _is_of_critic(name))

    layers = {name: array for name, array in tensors.items() if is_chosen(name)}
    layers = {name: array for name, array in layers.items() if not _is_deviation(name)}
    if not layers:
        networks = shortened(", ".join(roots(tensors)), 200)
        advice = "this is a single network: remove the name"
        if networks:
            advice = f"choose from {networks}"
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
    networks: dict[str, dict[str, np.ndarray]] = {}  # name -> weights of its layers
    for name, array in others.items():
        if name.endswith("weight") and array.ndim == 2:
            networks.setdefault(_module(name), {})[name] = array
    for name, array in others.items():
        is_of_layer = name.endswith(("weight", "bias")) and array.ndim <= 2
        if is_of_layer and _module(name) in networks:
            continue
        may_scale_inputs = array.size == takes != gives
        if may_scale_inputs or not _is_deviation(name):
            raise BadInputError(
                f"tensor {shortened(name)!r} {array.shape} is not a layer and may act on the "
                f"network's inputs or outputs; {_ADVICE}"
            )
    for weights in networks.values():
        name, first = next(iter(weights.items()))
        last = list(weights.values())[-1]
        inputs, outputs = first.shape[1], len(last)
        is_value = _is_of_critic(name) and outputs == 1
        if is_value or (_is_deviation(name) and outputs == gives):
            continue
        is_parallel = len(weights) == 1 and (inputs, outputs) == (takes, gives)
        if outputs == takes or inputs == gives or is_parallel:
            raise BadInputError(
                f"tensor {shortened(name)!r} {first.shape} may be a layer that acts on the "
                f"network's inputs or outputs; {_ADVICE}"
            )


def roots(tensors: Iterable[str]) -> list[str]:
    """Return the names of the networks in a state dict, each once.

    A name is that of a tensor without layer number and "weight" or "bias". Empty names are omitted.
    """
    stems = (re.sub(r"\.?\d*\.?(weight|bias)$", "", name) for name in tensors)
    return [stem for stem in dict.fromkeys(stems) if stem]


def _module(name: str) -> str:
    """Return the module that contains the layer of a tensor, or the layer without a module."""
    layer = name.rpartition(".")[0]
    return layer.rpartition(".")[0] or layer


def _words(name: str) -> set[str]:
    return set(re.findall("[a-z]+", name.lower()))


def _is_of_critic(name: str) -> bool:
    is_q = any(_Q.fullmatch(module) for module in name.split("."))
    return is_q or bool(_words(name) & _OF_CRITICS)


def _is_deviation(name: str) -> bool:
    """Return whether a tensor belongs to the standard deviation of a random action."""
    words = _words(name)
    return "sigma" in name.split(".") or "logstd" in words or {"log", "std"} <= words


def _has_word(name: str, part: str) -> bool:
    """Return whether the name of a tensor contains one of the words of "word+word"."""
    dotted = f".{name}."
    for word in filter(None, part.split("+")):
        if dotted.startswith(f".{word}."):
            return True
        if f".{word}." in dotted and not word.isdigit():  # a number inside is that of a layer
            return True
    return False
