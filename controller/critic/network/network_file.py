"""Feed-forward networks in files: ONNX graphs, and state dicts of linear layers and LayerNorms.

A state dict does not contain the order of its layers. torch files keep the order in which the
layers were saved. For other formats, the numbers in the names and the widths must allow only one
order. Weights keep the precision of the file. Arithmetic is in double precision.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from itertools import islice, pairwise
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.activations import ACTIVATIONS, on_entries
from controller.critic.network.onnx_graph import check_width, graph_functions, normalized
from controller.critic.network.products import Products
from controller.critic.network.row_network import RowNetwork, row_network
from controller.critic.network.state_dict import (
    Normalizer,
    Parts,
    Squash,
    parts_of,
    refuse_others,
    roots,
    without_training,
)
from controller.critic.network.tensors import checked_tensors, tensors_in
from hfa_support.errors import BadInputError, prefix_errors, refuse_unknown, shortened
from hfa_support.files import regular_file

#: Formats that store the order of the layers.
_ORDERED = (".pt", ".pth", ".pkl", ".zip")
#: Largest number of kinds of names that are ordered by widths. The search would take long for more.
_MOST_KINDS = 8
#: Names of the two parts of an actor of Stable-Baselines3: hidden layers -> last layer.
_ACTORS = {"policy_net": "action_net", "latent_pi": "actor.mu"}
#: Number that torch's LayerNorm adds to the variance. A state dict does not contain it.
_EPSILON = 1e-5


class Layer(NamedTuple):
    """Layer y = weight x + bias, or LayerNorm y_i = weight_i (x_i - mean) / deviation + bias_i.

    The mean and the standard deviation of a LayerNorm are taken over the entries of x.

    name: name in the file, without ".weight".
    weight: (k, n) of a linear layer, (k,) of a LayerNorm.
    bias: (k,).
    """

    name: str
    weight: np.ndarray
    bias: np.ndarray

    @property
    def is_linear(self) -> bool:
        """True for a linear layer, False for a LayerNorm."""
        return self.weight.ndim == 2

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.weight.shape[-1]

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return len(self.weight)


class NetworkFile(NamedTuple):
    """Content of a network's file.

    functions: requested kind, or name of an output -> function from x (n,) to the output (k,).
    chain: the operations in their order, such as "6 -> tanh 64 -> 1".
    precision: precision of the weights in the file, such as "float32".
    on_basis: single layer whose inputs are the functions of the basis, or None. With such a layer,
        `functions` is empty.
    rows: versions of `functions` that are faster for many rows.
    squashes: operations after some of the functions, not included in these functions.
    normalizers: operations before some of the functions, included in these functions.
    """

    functions: dict[str, ca.Function]
    chain: str
    precision: str
    on_basis: Layer | None = None
    rows: Mapping[str, RowNetwork] = {}
    squashes: Mapping[str, Squash] = {}
    normalizers: Mapping[str, Normalizer] = {}


def network_in(
    path: str | Path,
    states: int,
    activation: str | None = None,
    parts: Mapping[str, str] | None = None,
    basis_size: int = 0,
    inputs: int = 0,
) -> NetworkFile:
    """Read the network in a file.

    path: .onnx file, or file of a state dict
    states: number of states of the plant
    activation: activation between the layers of a state dict, one of `ACTIVATIONS`. An activation
        of the output follows after a comma.
    parts: kind -> requested part of the file. For a state dict, a part is a list of words in the
        names of its tensors, joined by +. For an ONNX graph, a part is an output. "policy" with the
        part "" selects all tensors that do not belong to a critic.
    basis_size: size of the basis. A single layer with this number of inputs acts on the basis.
    inputs: number of inputs of the plant. They follow the states in a Q

    Raises a BadInputError of one line that names the file.
    """
    path = Path(path)
    parts = parts or {"": ""}
    suffix = path.suffix.lower()
    with prefix_errors(path):
        try:
            if suffix == ".onnx":
                graph = graph_functions(path, states, inputs, parts)
                return NetworkFile(
                    graph.functions, graph.operators, graph.precision, rows=graph.rows
                )
            content = regular_file(path).read_bytes()
            tensors, precision = checked_tensors(without_training(tensors_in(content, suffix)))
            found = {
                name: parts_of(tensors, part, is_policy=name == "policy")
                for name, part in parts.items()
            }
            networks = {
                name: _layers(sorted_tensors.layers, (states, states + inputs), suffix)
                for name, sorted_tensors in found.items()
            }
        except OSError as error:
            raise BadInputError(
                f"cannot be read ({error.strerror}); give a readable file"
            ) from error
        except BadInputError:
            raise
        except Exception as error:  # a damaged file may cause any exception
            reason = shortened(str(error).partition("\n")[0])
            raise BadInputError(
                f"the file is damaged or is not a network ({reason}); save the network again"
            ) from error
        first = next(iter(networks.values()))
        if len(first) == 1 and first[0].inputs == basis_size:
            return NetworkFile({}, f"{basis_size} functions -> 1", precision, first[0])
        functions = {}
        rows = {}
        chains = []
        for name, layers in networks.items():
            check_width(layers[0].inputs, states, inputs)
            _refuse_unread(found, networks, name)
            steps = _with_activations(layers, activation)
            normalizer = found[name].normalizer
            functions[name], on_rows = composed(steps, normalizer)
            chains.append(_chain(name, steps, found[name]))
            if on_rows is not None:
                rows[name] = on_rows
        return NetworkFile(
            functions,
            "; ".join(chains),
            precision,
            rows=rows,
            squashes={name: each.squash for name, each in found.items() if each.squash},
            normalizers={name: each.normalizer for name, each in found.items() if each.normalizer},
        )


def _refuse_unread(
    found: Mapping[str, Parts], networks: Mapping[str, list[Layer]], name: str
) -> None:
    """Raise BadInputError if one network in a file cannot be read completely.

    - A tensor that is not read may act on this network.
    - The normalizer does not have one entry for each input of the network.
    - The squash does not have one entry for each output of the network.

    found: name of each network -> its tensors, by function
    networks: name of each network -> its layers, in order
    name: name of the network to be checked
    """
    read = {tensor for parts in found.values() for tensor in parts.layers}
    others = {key: array for key, array in found[name].others.items() if key not in read}
    unused = {key: array for key, array in found[name].unused.items() if key not in read}
    layers = networks[name]
    refuse_others(others, unused, layers[0].inputs, layers[-1].outputs)
    normalizer = found[name].normalizer
    if normalizer is not None and len(normalizer.mean) != layers[0].inputs:
        raise BadInputError(
            f"normalizer {shortened(normalizer.name)} has {len(normalizer.mean)} entries, but "
            f"the network has {layers[0].inputs} inputs; save the network with the normalizer of "
            "the training"
        )
    squash = found[name].squash
    if squash is not None and {len(squash.scale), len(squash.bias)} != {layers[-1].outputs}:
        raise BadInputError(
            f"action_scale has {len(squash.scale)} entries and action_bias has "
            f"{len(squash.bias)}; give {layers[-1].outputs} entries in each, one per output of "
            "the network"
        )


def _layers(tensors: Mapping[str, np.ndarray], widths: Collection[int], suffix: str) -> list[Layer]:
    """Return the layers of a state dict in order of evaluation.

    widths: permitted numbers of inputs of the first layer
    suffix: suffix of the file

    Raises BadInputError if the tensors are not a chain of linear layers and LayerNorms.
    """
    layers = []
    for name, array in tensors.items():
        if name.rpartition(".")[2] == "bias" and name.removesuffix("bias") + "weight" in tensors:
            continue
        stem = name.removesuffix("weight")
        bias = tensors.get(f"{stem}bias")
        if bias is None and array.ndim == 2:
            bias = np.zeros(len(array))
        is_layer = name.endswith("weight") and array.ndim in (1, 2)
        if not is_layer or bias is None or bias.shape != array.shape[:1]:
            reason = "is not a weight or bias of a linear layer or a LayerNorm"
            raise _no_chain(name, array, reason, tensors)
        layers.append(Layer(stem.removesuffix("."), array, bias))
    if not any(layer.is_linear for layer in layers):
        raise BadInputError("the file contains no linear layer; give a feed-forward network")
    layers = _as_saved(layers) if suffix in _ORDERED else _only_order(layers, widths)
    for before, layer in pairwise(layers):
        if before.outputs != layer.inputs:
            reason = (
                f"has the input size {layer.inputs}, but layer {shortened(before.name)!r} before "
                f"it has the output size {before.outputs}"
            )
            name = f"{layer.name}.weight".removeprefix(".")
            raise _no_chain(name, layer.weight, reason, tensors)
    return layers


def _no_chain(
    name: str, array: np.ndarray, reason: str, tensors: Mapping[str, np.ndarray]
) -> BadInputError:
    """Return the error for a tensor that is not part of the chain of layers.

    If the file contains several networks, the message proposes one of them.

    name, array: name and value of the tensor
    reason: predicate of the message, such as "is not a weight"
    tensors: all tensors of the file
    """
    message = f"tensor {shortened(name)!r} {array.shape} {reason}"
    networks = roots(tensors)
    if len(networks) < 2:
        return BadInputError(
            f"{message}; save the network without this tensor, or export the network to ONNX"
        )
    actors = [root for root in networks if re.search(r"actor|policy|(^|[._])(pi|mu)$", root)]
    chosen = (actors or networks)[0]
    for body, head in _ACTORS.items():
        parts = [root for word in (body, head) for root in networks if root.endswith(word)]
        if len(parts) == 2:
            chosen = "+".join(parts)
    return BadInputError(
        f"{message}; select one of the networks {shortened(', '.join(networks), 200)}, for example "
        f'network="{shortened(chosen)}"',
        ("--network", chosen),
    )


def _kind(layer: Layer) -> str:
    """Return the kind of a layer: its name with each number replaced by #."""
    return re.sub(r"\d+", "#", layer.name)


def _numbers(layer: Layer) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", layer.name)]


def _as_saved(layers: list[Layer]) -> list[Layer]:
    """Return the layers in the order in which they were saved.

    Raises BadInputError if the numbers in the names of one kind decrease.
    """
    last: dict[str, Layer] = {}
    for layer in layers:
        before = last.get(_kind(layer))
        if before is not None and _numbers(before) > _numbers(layer):
            raise BadInputError(
                f"layer {shortened(layer.name)!r} is stored after {shortened(before.name)!r}, so "
                "the order of the layers is ambiguous; save the layers in ascending order, or "
                "export the network to ONNX"
            )
        last[_kind(layer)] = layer
    return layers


def _only_order(layers: list[Layer], widths: Collection[int]) -> list[Layer]:
    """Return the only order of the layers in which the sizes of consecutive layers fit.

    Layers of one kind are in the order of their numbers. If no order fits, the layers are returned
    kind by kind. Raises BadInputError if several orders fit, or if there are more than
    `_MOST_KINDS` kinds.

    widths: permitted numbers of inputs of the first layer
    """
    by_kind: dict[str, list[Layer]] = {}
    for layer in sorted(layers, key=_numbers):
        by_kind.setdefault(_kind(layer), []).append(layer)
    as_numbered = [layer for group in by_kind.values() for layer in group]
    if len(by_kind) == 1:
        return as_numbered
    names = ", ".join(shortened(layer.name) for layer in layers[:_MOST_KINDS])
    if len(by_kind) > _MOST_KINDS:
        raise BadInputError(
            f"the layers ({names} ...) have {len(by_kind)} different names, which do not "
            "determine the order; number the layers, or select one network with --network"
        )
    orders = list(islice(_orders(tuple(by_kind.values()), widths), 2))
    if len(orders) == 2:
        raise BadInputError(
            f"the layers ({names}) fit together in more than one order, and the file format does "
            "not store the order; number the layers in order of evaluation, or export the network "
            "to ONNX"
        )
    return orders[0] if orders else as_numbered


def _orders(groups: tuple[list[Layer], ...], widths: Collection[int]) -> Iterator[list[Layer]]:
    """Yield every order of the layers in which the sizes of consecutive layers fit.

    The layers of each group keep their order.

    widths: permitted numbers of inputs of the first layer
    """
    if not any(groups):
        yield []
    for index, group in enumerate(groups):
        if group and group[0].inputs in widths:
            remaining = (*groups[:index], group[1:], *groups[index + 1 :])
            for order in _orders(remaining, (group[0].outputs,)):
                yield [group[0], *order]


def _with_activations(layers: list[Layer], activation: str | None) -> list[tuple[Layer, str]]:
    """Return each layer with the name of its activation, or "" without an activation.

    activation: text "BETWEEN" or "BETWEEN,OUTPUT", or None
    """
    between, last = _activations(layers, activation)
    names = [""] * len(layers)
    if between:
        for index in _activated(layers):
            names[index] = between
    names[-1] = last or names[-1]
    return list(zip(layers, names, strict=True))


def _activated(layers: list[Layer]) -> list[int]:
    """Return the indices of the layers after which the activations act.

    One activation acts between two consecutive linear layers. Raises BadInputError if the names do
    not determine whether an activation acts before or after a LayerNorm.
    """
    linear = [index for index, layer in enumerate(layers) if layer.is_linear]
    open_places = [
        index
        for index, (before, layer) in enumerate(pairwise(layers))
        if not _follows(before, layer)
    ]
    activated = []
    for first, second in pairwise(linear):
        places = [index for index in open_places if first <= index < second]
        if second == first + 1:
            places = [first]
        if len(places) != 1:
            raise _unknown_place(layers[first + 1])
        activated += places
    for index in open_places:
        if index < linear[0] or index >= linear[-1]:
            raise _unknown_place(layers[index] if index < linear[0] else layers[index + 1])
    return activated


def _unknown_place(norm: Layer) -> BadInputError:
    return BadInputError(
        "the names of the layers do not determine whether the activation precedes the LayerNorm "
        f"{shortened(norm.name)!r}; export the network to ONNX"
    )


def _follows(before: Layer, layer: Layer) -> bool:
    """Return whether two layers have names of one kind with consecutive last numbers.

    No activation acts between such layers, because a torch.nn.Sequential counts activations too.
    """
    numbers = _numbers(before)
    numbers[-1:] = [number + 1 for number in numbers[-1:]]
    return _kind(before) == _kind(layer) and numbers == _numbers(layer)


def composed(
    steps: list[tuple[Layer, str]], normalizer: Normalizer | None
) -> tuple[ca.Function, RowNetwork | None]:
    """Return the function x (n,) -> output of the last layer (k,), and its version for many rows.

    The version for many rows is None unless `row_network` supports all layers or a product is
    large.

    steps: layers with the names of their activations, "" for none
    normalizer: normalizer of x, or None
    """
    x = ca.SX.sym("x", steps[0][0].inputs)
    products = Products(x)
    h = np.fromiter(ca.vertsplit(x), object)
    if normalizer is not None:
        h = _normal(h, normalizer)
    for layer, activation in steps:
        if layer.is_linear:
            h = products.times(layer.weight, h) + layer.bias
        else:
            h = normalized(h, (0,), _EPSILON) * layer.weight + layer.bias
        if activation:
            h = ACTIVATIONS[activation](h)
    on_rows = None
    if all(layer.is_linear for layer, _ in steps):
        on_rows = row_network([(layer.weight, layer.bias, name) for layer, name in steps])
        if on_rows is not None and normalizer is not None:
            on_rows = _normalized_rows(on_rows, normalizer)
    return products.function(h), on_rows or products.rows(h)


def _normal(h: np.ndarray, normalizer: Normalizer) -> np.ndarray:
    """Return the inputs of a network after its normalizer, (n,).

    h: inputs, (n,), CasADi scalars
    """
    normal = (h - normalizer.mean) / normalizer.deviation
    if np.isinf(normalizer.clip):
        return np.asarray(normal)
    return on_entries(lambda x: ca.fmin(ca.fmax(x, -normalizer.clip), normalizer.clip))(normal)


def _normalized_rows(on_rows: RowNetwork, normalizer: Normalizer) -> RowNetwork:
    """Return the function x (N, n) -> (N, k) of a network for many rows, with its normalizer.

    on_rows: function of normalized x, (N, n) -> (N, k)
    """

    def normalized_first(x: np.ndarray) -> np.ndarray:
        normal = (x - normalizer.mean) / normalizer.deviation
        return on_rows(np.clip(normal, -normalizer.clip, normalizer.clip))

    return normalized_first


def _activations(layers: list[Layer], activation: str | None) -> tuple[str, str]:
    """Return the names of the activations between the linear layers and at the output, "" for none.

    Raises BadInputError for an unknown activation, and for several linear layers without
    `activation`.

    activation: text "BETWEEN" or "BETWEEN,OUTPUT", or None
    """
    if activation is None and sum(layer.is_linear for layer in layers) > 1:
        raise BadInputError(
            'a state dict does not contain the activation; give activation="tanh" (or '
            f"{', '.join(name for name in ACTIVATIONS if name != 'tanh')})",
            ("--set", "activation=tanh"),
        )
    between, _, last = (activation or "").partition(",")
    for name in filter(None, (between, last)):
        refuse_unknown("unknown activation", name, ACTIVATIONS)
    return between, last


def _chain(name: str, steps: list[tuple[Layer, str]], parts: Parts) -> str:
    """Return the description of a network, such as "6 -> tanh 64 -> 1 (layers 0, 2)".

    name: name of the network, or ""
    steps: layers with the names of their activations
    parts: tensors of the network, by function
    """
    words = [str(steps[0][0].inputs)]
    if parts.normalizer is not None:
        words.append(f"normalized by {shortened(parts.normalizer.name)}")
    for layer, activation in steps:
        if layer.is_linear:
            words.append(f"{activation} {layer.outputs}".strip())
        else:
            words.append(f"LayerNorm {layer.outputs} (epsilon {_EPSILON:g})")
            if activation:
                words.append(f"{activation} {layer.outputs}")
    if parts.squash is not None:
        words.append("tanh, action_scale and action_bias")
    names = ", ".join(layer.name for layer, _ in steps if layer.name)
    chain = " -> ".join(words)
    if name:
        chain = f"{name} {chain}"
    return f"{chain} (layers {shortened(names, 80)})" if names else chain
