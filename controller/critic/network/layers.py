"""The layers of one network among the tensors of a file, in order of evaluation.

A state dict contains neither the order of its layers nor their activations. torch files keep the
order in which the layers were saved. In other formats, layers are numbered. Besides the layers of
the network, a state dict may contain other networks and the standard deviation of a random action.
Any other tensor may act on the network, and is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError, refuse_unknown, shortened


def _leaky_relu(x: Any, alpha: float = 0.01) -> Any:
    return ca.fmax(x, 0.0) + alpha * ca.fmin(x, 0.0)


def _sigmoid(x: Any) -> Any:
    # 1 / (1 + exp(-x)) overflows for large -x, and its derivative is then nan.
    return 0.5 + 0.5 * ca.tanh(0.5 * x)


def _elu(x: Any, alpha: float = 1.0) -> Any:
    # x for x > 0, and else alpha (exp(x) - 1), which may not overflow for x > 0
    return ca.fmax(x, 0.0) + alpha * ca.expm1(ca.fmin(x, 0.0))


def _selu(x: Any, alpha: float = 1.6732632423543772, gamma: float = 1.0507009873554805) -> Any:
    return gamma * _elu(x, alpha)


def _softplus(x: Any) -> Any:
    # log(1 + exp(x)); beyond 40 it is x to the last digit.
    return ca.if_else(x > 40.0, x, ca.log1p(ca.exp(ca.fmin(x, 40.0))))


def _gelu(x: Any, approximate: str = "none") -> Any:
    if approximate == "tanh":
        return 0.5 * x * (1.0 + ca.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3)))
    return 0.5 * x * (1.0 + ca.erf(x / math.sqrt(2.0)))


def hard_sigmoid(x: Any, alpha: float = 1.0 / 6.0, beta: float = 0.5) -> Any:
    """Return alpha x + beta limited to [0, 1]."""
    return ca.fmin(ca.fmax(alpha * x + beta, 0.0), 1.0)


#: Activations by the names of `--set activation`: those of torch's classes, in lower case.
ACTIVATIONS: Mapping[str, Callable[..., Any]] = {
    "tanh": ca.tanh,
    "relu": lambda x: ca.fmax(x, 0.0),
    "leaky_relu": _leaky_relu,
    "sigmoid": _sigmoid,
    "softplus": _softplus,
    "elu": _elu,
    "gelu": _gelu,
    "silu": lambda x: x * _sigmoid(x),
    "selu": _selu,
    "sin": ca.sin,
    "identity": lambda x: x,
    "hardtanh": lambda x: ca.fmin(ca.fmax(x, -1.0), 1.0),
    "softsign": lambda x: x / (1.0 + ca.fabs(x)),
    "hardswish": lambda x: x * hard_sigmoid(x),
    "mish": lambda x: x * ca.tanh(_softplus(x)),
}


def activation_named(name: str) -> str:
    """Return the name of an activation in `ACTIVATIONS`: "relu" for "ReLU" and "relu".

    Raises BadInputError for an unknown activation.
    """
    by_letters = {activation.replace("_", ""): activation for activation in ACTIVATIONS}
    known = by_letters.get(name.strip().lower().replace("_", ""), name)
    refuse_unknown("unknown activation", known, ACTIVATIONS)
    return known


class Layer(NamedTuple):
    """Layer y = activation(weight x + bias).

    name: name in the file, without ".weight"
    weight: (k, n)
    bias: (k,)
    activation: name in `ACTIVATIONS`, or "" for none
    """

    name: str
    weight: np.ndarray
    bias: np.ndarray
    activation: str = ""

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.weight.shape[1]

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return len(self.weight)


Tensors = Mapping[str, np.ndarray]
#: Words in the names of critics' tensors, which a policy does not use.
_WORDS_OF_CRITICS = frozenset(("critic", "critics", "value", "values", "target", "targets"))
#: Names of critic modules. "q" alone may also be a pitch rate.
_MODULES_OF_CRITICS = re.compile(r"(q|qs|qf|vf|qfs)\d*(_?(net|network|function|target)s?)?\d*")
_NAMES_OF_POLICIES = re.compile(r"actor|policy|(^|[._])(pi|mu)$")
#: Names of tensors that only training uses: of optimizers, temperatures, and counts of samples.
_NAMES_OF_TRAINING = re.compile(
    r"optimizers?|scheduler|(^|[._])(log_)?(alpha|ent_coef)$|count$|num_batches_tracked$"
)
_ADVICE = (
    "state a normalizer in a deployment file FILE.toml (docs/policy.md) and give that, or export "
    "the network to ONNX with everything that acts on its inputs or outputs"
)


def without_training(tensors: Tensors) -> dict[str, np.ndarray]:
    """Return the tensors of a checkpoint without those that only its training uses, by their names.

    Such are the moments of an optimizer, and the number of samples that a normalizer saw.
    """
    return {
        name: array
        for name, array in tensors.items()
        if not _NAMES_OF_TRAINING.search(name.lower())
    }


def layers_of(
    tensors: Tensors,
    kind: str,
    part: str,
    is_ordered: bool,
    check: Callable[[list[Layer], bool], None],
    sizes: Collection[int],
) -> list[Layer]:
    """Return the layers of a network in order of evaluation.

    kind: "policy", "V", another kind of output, or "" if it is not known
    part: words that select layers by their names, joined by +. "" selects all layers; if these are
        not one network, those of the critic for "V", and the others otherwise
    is_ordered: whether the tensors are in the order of evaluation. Otherwise layers are numbered
    check: function (layers, whether words selected them) that raises BadInputError if layers are
        not a network that can be judged
    sizes: permitted numbers of outputs of a network that the error proposes, () for any

    Raises BadInputError if the layers are not one network. The error proposes words that select
    one, if there are any.
    """
    if not tensors:
        raise BadInputError("the file contains no tensors; give the weights of linear layers")
    of_layers = {name: array for name, array in tensors.items() if not is_deviation(name)}
    if part and not any(has_word(name, part) for name in of_layers):
        raise _no_such_part(part, tensors)

    def network_of(chosen: Tensors, words: str = "") -> list[Layer]:
        """Return the layers of the tensors that words select, if these are one network that can be
        judged.
        """
        if words:
            chosen = {name: chosen[name] for name in chosen if has_word(name, words)}
        layers = _chain(chosen, words, is_ordered)
        check(layers, bool(words))
        return layers

    # 1. The selected tensors, or all without words.
    try:
        return network_of(of_layers, part)
    except BadInputError as error:
        refusal = error
    # 2. Without words: the tensors of the critic for V, and the others otherwise.
    of_kind = {name: of_layers[name] for name in of_layers if is_of_critic(name) == (kind == "V")}
    if not part and 0 < len(of_kind) < len(of_layers):
        try:
            return network_of(of_kind)
        except BadInputError as error:
            refusal = error
    # 3. No network is returned. The last error is raised, with the first words that would select a
    # network with a permitted number of outputs, if any do.
    for words in _selections(of_layers, kind):
        with suppress(BadInputError):
            outputs = network_of(of_layers, words)[-1].outputs
            if not sizes or outputs in sizes:
                proposed = f"{kind}={words}" if kind else words
                refusal = _with_selection(refusal, of_layers, proposed)
                break
    raise refusal


def _no_such_part(part: str, tensors: Tensors) -> BadInputError:
    """Return the error that the words of `part` select no tensor of a file."""
    names = roots(tensors)
    advice = "this is a single network: remove the name"
    if names:
        advice = f"choose from {shortened(', '.join(names), 200)}"
    return BadInputError(f"the file contains no tensors named {shortened(part)!r}; {advice}")


def _with_selection(error: BadInputError, tensors: Tensors, words: str) -> BadInputError:
    """Return an error, with the networks of the file and words that select one as its remedy."""
    listed = shortened(", ".join(roots(tensors)), 200)
    return BadInputError(
        f"{str(error).partition('; ')[0]}; select one of the networks {listed}, for example "
        f'network="{words}"',
        ("--network", words),
    )


def _selections(tensors: Tensors, kind: str) -> Iterator[str]:
    """Yield words that may select a network of a kind, likely ones first.

    First single names of networks, then names that follow each other in the file, joined by +.
    """
    names = roots(tensors)

    def rank(name: str) -> int:
        """Return 0 for a name of the kind, 1 for an unknown one, and 2 for another kind."""
        is_value = is_of_critic(name)
        if kind == "V":
            return 0 if is_value else 1
        is_policy = _NAMES_OF_POLICIES.search(name)
        return 0 if is_policy else 2 if is_value else 1

    modules = [name.partition(".")[0] for name in names]
    yield from sorted(dict.fromkeys([*names, *modules]), key=rank)
    of_kind = [name for name in names if is_of_critic(name) == (kind == "V")]
    for neighbors in (of_kind, names):
        for first, last in combinations(range(len(neighbors) + 1), 2):
            yield "+".join(neighbors[first:last])


def _chain(tensors: Tensors, part: str, is_ordered: bool) -> list[Layer]:
    """Return the layers of a state dict in order of evaluation."""
    layers = []
    for name, array in tensors.items():
        if name.rpartition(".")[2] == "bias" and name.removesuffix("bias") + "weight" in tensors:
            continue  # read with its weight
        stem = name.removesuffix("weight")
        if not name.endswith("weight") or array.ndim != 2:
            raise _no_layer(name, array, "is not a weight or bias of a linear layer")
        bias = tensors.get(f"{stem}bias", np.zeros(len(array)))
        if bias.shape != array.shape[:1]:
            if bias.shape == array.shape[1:]:
                reason = f"looks transposed: its bias is {bias.shape}"
                raise _no_layer(name, array, reason, f"save its transpose {array.shape[::-1]}")
            raise _no_layer(f"{stem}bias", bias, "is not the bias of its layer")
        layers.append(Layer(stem.removesuffix("."), array, bias))
    layers = _as_saved(layers) if is_ordered else _as_numbered(layers, part)
    for before, layer in pairwise(layers):
        if before.outputs != layer.inputs:
            reason = (
                f"has the input size {layer.inputs}, but layer {shortened(before.name)!r} before "
                f"it has the output size {before.outputs}"
            )
            raise _no_layer(f"{layer.name}.weight".removeprefix("."), layer.weight, reason)
    return layers


def _no_layer(
    name: str, array: np.ndarray, reason: str, remedy: str = "export the network to ONNX"
) -> BadInputError:
    """Return the error that a tensor is no layer of a network, for a reason."""
    return BadInputError(f"tensor {shortened(name)!r} {array.shape} {reason}; {remedy}")


def _kind(layer: Layer) -> str:
    """Return the name of a layer with each number replaced by #, as "model.#" for "model.0"."""
    return re.sub(r"\d+", "#", layer.name)


def _numbers(layer: Layer) -> list[int]:
    """Return the numbers in the name of a layer."""
    return [int(number) for number in re.findall(r"\d+", layer.name)]


def _as_saved(layers: list[Layer]) -> list[Layer]:
    """Return the layers in the order in which they were saved, as they are evaluated.

    Raises BadInputError if the numbers of layers with one name contradict this order.
    """
    last_of_kind: dict[str, Layer] = {}
    for layer in layers:
        before = last_of_kind.get(_kind(layer))
        if before is not None and _numbers(before) > _numbers(layer):
            raise BadInputError(
                f"layer {shortened(layer.name)!r} is stored after {shortened(before.name)!r}, so "
                "the order of the layers is ambiguous; save the layers in ascending order, or "
                "export the network to ONNX"
            )
        last_of_kind[_kind(layer)] = layer
    return layers


def _as_numbered(layers: list[Layer], part: str) -> list[Layer]:
    """Return the layers in the order of the words that select them, then of their numbers."""
    words = part.split("+")

    def places(layer: Layer) -> list[int]:
        """Return the places of the words that select a layer."""
        return [place for place, word in enumerate(words) if has_word(f"{layer.name}.", word)]

    # The layers that a word selects have an order if their names differ in their numbers only, that
    # is, if there is one kind of name for each word.
    if len({(tuple(places(layer)), _kind(layer)) for layer in layers}) > len(words):
        names = shortened(", ".join(layer.name for layer in layers), 80)
        raise BadInputError(
            f"the layers ({names}) have no common name with numbers, and the file format does not "
            "store their order; number the layers in order of evaluation, name them in this order "
            "by --network FIRST+SECOND, or export the network to ONNX"
        )
    return sorted(layers, key=lambda layer: (places(layer), _numbers(layer)))


def refuse_others(others: Tensors, network_inputs: int, network_outputs: int) -> None:
    """Raise BadInputError if a tensor that is not read may act on a network.

    Tensors of critics, other linear layers, and the standard deviation of an action are accepted.

    others: tensors of a state dict that belong to no network that is read
    network_inputs, network_outputs: number of inputs and of outputs of the network
    """
    weights = {name for name in others if name.endswith("weight") and others[name].ndim == 2}
    for name, array in others.items():
        if f"{name.removesuffix('bias')}weight" in weights or name in weights or is_of_critic(name):
            continue
        # A deviation with an entry for each input, and not for each output, may be a divisor of the
        # inputs instead of the deviation of an action.
        is_of_inputs = array.size == network_inputs and array.size != network_outputs
        if not is_deviation(name) or is_of_inputs:
            raise BadInputError(
                f"tensor {shortened(name)!r} {array.shape} is not a layer and may act on the "
                f"network's inputs or outputs; {_ADVICE}"
            )


def roots(tensors: Iterable[str]) -> list[str]:
    """Return the names of the networks in a state dict, each once.

    A name is that of a tensor without layer number and "weight" or "bias", such as "actor" for
    "actor.0.weight". Empty names are omitted.
    """
    stems = (re.sub(r"(^\d+|\.\d+)?\.?(weight|bias)$", "", name) for name in tensors)
    return [stem for stem in dict.fromkeys(stems) if stem]


def _words(name: str) -> set[str]:
    """Return the words of letters in the name of a tensor, in lower case."""
    return set(re.findall("[a-z]+", name.lower()))


def is_of_critic(name: str) -> bool:
    """Return whether a tensor belongs by its name to a value or a Q-function."""
    is_q = any(
        _MODULES_OF_CRITICS.fullmatch(module) for module in name.split(".")
    )  # such as q1, qf0, q_network
    return is_q or bool(_words(name) & _WORDS_OF_CRITICS)


def is_deviation(name: str) -> bool:
    """Return whether a tensor is by its name the standard deviation of a random action.

    Such names are "log_std", "actor_logstd" and "sigma".
    """
    words = _words(name)
    is_sigma = {"sigma", "sigma_param"} & {*name.split(".")}
    return bool(is_sigma) or "logstd" in words or {"log", "std"} <= words


def has_word(name: str, part: str) -> bool:
    """Return whether the name of a tensor contains one of the words of "word+word"."""
    dotted = f".{name}."
    for word in filter(None, part.split("+")):
        if dotted.startswith(f".{word}."):
            return True
        if f".{word}." in dotted and not word.isdigit():  # a number inside is that of a layer
            return True
    return False
