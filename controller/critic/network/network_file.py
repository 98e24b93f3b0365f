"""Feed-forward networks in files: ONNX graphs, and state dicts of linear layers.

A state dict contains neither the order of its layers nor their activations. torch files keep the
order in which the layers were saved. In other formats, layers are numbered. Weights keep the
precision of the file. Arithmetic is in double precision.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.activations import ACTIVATIONS
from controller.critic.network.onnx_graph import FEW_WEIGHTS, check_width, graph_functions
from controller.critic.network.row_network import Layer, RowNetwork, row_network
from controller.critic.network.state_dict import (
    layers_of,
    refuse_others,
    roots,
    without_training,
)
from controller.critic.network.tensors import checked_tensors, tensors_in
from hfa_support.errors import BadInputError, file_faults, prefix_errors, refuse_unknown, shortened
from hfa_support.files import regular_file

#: Formats that store the order of the layers.
_ORDERED = (".pt", ".pth", ".pkl", ".zip")
#: Names of the two parts of an actor of Stable-Baselines3: hidden layers -> last layer.
_ACTORS = {"policy_net": "action_net", "latent_pi": "actor.mu"}


class NetworkFile(NamedTuple):
    """Content of a network's file.

    functions: requested kind, or name of an output -> function from x (n,) to the output (k,).
    chain: the operations in their order, such as "6 -> tanh 64 -> 1".
    precision: precision of the weights in the file, such as "float32".
    on_basis: single layer whose inputs are the functions of the basis, or None. With such a layer,
        `functions` is empty.
    rows: versions of `functions` that are faster for many rows.
    """

    functions: dict[str, ca.Function]
    chain: str
    precision: str
    on_basis: Layer | None = None
    rows: Mapping[str, RowNetwork] = {}


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
    with prefix_errors(path), file_faults(path):
        try:
            if suffix == ".onnx":
                graph = graph_functions(path, states, inputs, parts)
                return NetworkFile(graph.functions, graph.operators, graph.precision)
            tensors = tensors_in(regular_file(path).read_bytes(), suffix)
            return network_of_tensors(
                tensors,
                states,
                activation,
                parts,
                basis_size,
                inputs,
                is_ordered=suffix in _ORDERED,
            )
        except (OSError, BadInputError):
            raise
        except Exception as error:  # a damaged file may cause any exception
            reason = shortened(str(error).partition("\n")[0])
            raise BadInputError(
                f"the file is damaged or is not a network ({reason}); save the network again"
            ) from error


def network_of_tensors(
    stored: Mapping[str, np.ndarray],
    states: int,
    activation: str | None,
    parts: Mapping[str, str],
    basis_size: int,
    inputs: int,
    *,
    is_ordered: bool,
) -> NetworkFile:
    """Return the network of linear layers in a state dict.

    stored: the tensors by name
    states, activation, parts, basis_size, inputs: as for `network_in`
    is_ordered: whether the tensors are in the order of evaluation. Otherwise layers are numbered

    Raises a BadInputError of one line.
    """
    tensors, precision = checked_tensors(without_training(stored))
    chosen = {
        name: layers_of(tensors, part, is_policy=name == "policy") for name, part in parts.items()
    }
    networks = {name: _layers(layers, is_ordered) for name, layers in chosen.items()}
    on_basis = _layer_on_basis(networks, states, basis_size)
    if on_basis is not None:
        return NetworkFile({}, f"{basis_size} functions -> 1", precision, on_basis=on_basis)
    read = {tensor for layers in chosen.values() for tensor in layers}
    unread = {tensor: array for tensor, array in tensors.items() if tensor not in read}
    functions = {}
    functions_of_rows = {}
    chains = []
    for name, layers in networks.items():
        check_width(layers[0].inputs, states, inputs)
        refuse_others(unread, layers[0].inputs, layers[-1].outputs)
        layers = _with_activations(layers, activation)
        functions[name], of_rows = composed(layers)
        chains.append(_chain(name, layers))
        if of_rows is not None:
            functions_of_rows[name] = of_rows
    return NetworkFile(functions, "; ".join(chains), precision, rows=functions_of_rows)


def _layer_on_basis(
    networks: Mapping[str, list[Layer]], states: int, basis_size: int
) -> Layer | None:
    """Return the single layer whose inputs are the functions of the basis, or None.

    With one state and one basis function, a layer of one input fits both. Only a requested "V" is
    then a layer on the basis.

    networks: kind -> layers; only the first network can act on the basis
    """
    kind, layers = next(iter(networks.items()))
    acts_on_the_state = states == basis_size == 1 and kind != "V"
    if len(layers) == 1 and layers[0].inputs == basis_size and not acts_on_the_state:
        return layers[0]
    return None


def _layers(tensors: Mapping[str, np.ndarray], is_ordered: bool) -> list[Layer]:
    """Return the layers of a state dict in order of evaluation."""
    layers = []
    for name, array in tensors.items():
        if name.rpartition(".")[2] == "bias" and name.removesuffix("bias") + "weight" in tensors:
            continue
        stem = name.removesuffix("weight")
        if not name.endswith("weight") or array.ndim != 2:
            raise _no_chain(name, array, "is not a weight or bias of a linear layer", tensors)
        bias = tensors.get(f"{stem}bias", np.zeros(len(array)))
        if bias.shape != array.shape[:1]:
            if bias.shape == array.shape[1:]:
                raise _no_chain(name, array, f"looks transposed: its bias is {bias.shape}", tensors)
            raise _no_chain(f"{stem}bias", bias, "is not the bias of its layer", tensors)
        layers.append(Layer(stem.removesuffix("."), array, bias))
    layers = _as_saved(layers) if is_ordered else _as_numbered(layers)
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
    """Return the error for a tensor that is not part of the chain of layers."""
    message = f"tensor {shortened(name)!r} {array.shape} {reason}"
    if "transposed" in reason:
        return BadInputError(f"{message}; save its transpose {array.shape[::-1]}")
    networks = roots(tensors)
    if len(networks) < 2:
        return BadInputError(f"{message}; export the network to ONNX")
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
    """Return the layers in the order in which they were saved."""
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


def _as_numbered(layers: list[Layer]) -> list[Layer]:
    """Return the layers in the order of their numbers."""
    if len({_kind(layer) for layer in layers}) > 1:
        names = shortened(", ".join(layer.name for layer in layers), 80)
        raise BadInputError(
            f"the layers ({names}) have no common name with numbers, and the file format does not "
            "store their order; number the layers in order of evaluation, select one network with "
            "--network, or export the network to ONNX"
        )
    return sorted(layers, key=_numbers)


def composed(layers: list[Layer]) -> tuple[ca.Function, RowNetwork | None]:
    """Return the function x (n,) -> output of the last layer (k,), and its version for many rows.

    The version for many rows is None unless `row_network` supports all activations.
    """
    h = x = ca.MX.sym("x", layers[0].inputs)
    for layer in layers:
        h = ca.DM(layer.weight) @ h + ca.DM(layer.bias)
        if layer.activation:
            h = ACTIVATIONS[layer.activation](h)
    function = ca.Function("network", [x], [ca.densify(h)])
    if sum(layer.weight.size for layer in layers) < FEW_WEIGHTS:
        function = function.expand()
    return function, row_network(layers)


def _with_activations(layers: list[Layer], activation: str | None) -> list[Layer]:
    """Return the layers with their activations.

    activation: activation between the layers and, after a comma, of the output
    """
    if activation is None and len(layers) > 1:
        raise BadInputError(
            'a state dict does not contain the activation; give activation="tanh" (or '
            f"{', '.join(name for name in ACTIVATIONS if name != 'tanh')})",
            ("--set", "activation=tanh"),
        )
    between, _, last = (activation or "").partition(",")
    for name in filter(None, (between, last)):
        refuse_unknown("unknown activation", name, ACTIVATIONS)
    hidden = [layer._replace(activation=between) for layer in layers[:-1]]
    return [*hidden, layers[-1]._replace(activation=last)]


def chain_text(layers: list[Layer]) -> str:
    """Return the description of a network, such as "6 -> tanh 64 -> 1"."""
    words = [f"{layer.activation} {layer.outputs}".strip() for layer in layers]
    return " -> ".join([str(layers[0].inputs), *words])


def _chain(name: str, layers: list[Layer]) -> str:
    """Return the description of a part of a file, such as "V 6 -> tanh 64 -> 1 (layers 0, 2)"."""
    chain = f"{name} {chain_text(layers)}".strip()
    names = ", ".join(layer.name for layer in layers if layer.name)
    return f"{chain} (layers {shortened(names, 80)})" if names else chain
