"""Policies and critics in files: a file -> what it says -> what is judged.

1. A file contains an ONNX graph (`onnx_graph`), or tensors by name, in one of several containers
   (`tensors`). No code in a file is executed.
2. What it says besides its numbers is `Declared` (`declared`): the algorithm, the activation, the
   way from the network's output to the action (squash, clip, box), the normalizer. Zips of
   Stable-Baselines3 and checkpoints of known layouts (`checkpoints`) declare it.
3. What is judged are functions of the network's inputs: the layers that the file states or the user
   names (`layers`), with their activations. `Declared.action` is a part of each policy.

`network_in` does the three steps, for the critics of `hfa verify` (`critic`) and for the policies
of deployment files. Arithmetic is in double precision, whatever the precision of the file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.checkpoints import checkpoint_of, is_stable_baselines, read_zip
from controller.critic.network.declared import NOTHING, Declared
from controller.critic.network.layers import (
    ACTIVATIONS,
    Layer,
    activation_named,
    has_word,
    layers_of,
    refuse_others,
    roots,
    without_training,
)
from controller.critic.network.onnx_graph import check_width, graph_functions
from controller.critic.network.tensors import (
    ORDERED_FILES,
    checked_tensors,
    flattened,
    parsed,
    stored_in,
)
from hfa_support.errors import BadInputError, file_faults, prefix_errors, shortened, shown
from hfa_support.files import regular_file

_ADVICE = "export the network to ONNX (torch.onnx.export) and give the ONNX file"
#: Activation class in torch.nn -> the settings that it must have.
_ACTIVATIONS: dict[str, dict[str, Any]] = {
    "ELU": {"alpha": 1.0},
    "GELU": {"approximate": "none"},
    "Hardswish": {},
    "Hardtanh": {"min_val": -1.0, "max_val": 1.0},
    "LeakyReLU": {"negative_slope": 0.01},
    "Mish": {},
    "ReLU": {},
    "SELU": {},
    "SiLU": {},
    "Sigmoid": {},
    "Softsign": {},
    "Softplus": {"beta": 1.0, "threshold": 20.0},
    "Tanh": {},
}


def is_module(source: Any) -> bool:
    """Return whether an object is a torch.nn.Sequential or Linear, also one read from a pickle."""
    return _class_of(source) in ("Sequential", "Linear")


def module_contents(module: Any) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the tensors of nested Sequentials by name, and layer -> its activation.

    Raises BadInputError for another module among them.
    """
    tensors: dict[str, np.ndarray] = {}
    activations: dict[str, str] = {}
    layer = None
    for name, part in _parts("", module):
        kind = _class_of(part)
        if kind == "Linear":
            stored = {key: array for key, array in part._parameters.items() if array is not None}
            tensors |= flattened(stored, f"{name}.".removeprefix("."))
            layer = name
        elif layer is None or layer in activations:
            raise BadInputError(
                f"the network contains the activation {kind}, which does not directly follow a "
                f"linear layer; {_ADVICE}"
            )
        else:
            for setting, value in _ACTIVATIONS[kind].items():
                if getattr(part, setting) != value:
                    raise BadInputError(
                        f"{kind} has {setting} = {getattr(part, setting)}, but only {value} is "
                        f"supported; {_ADVICE}"
                    )
            activations[layer] = activation_named(kind)
    return tensors, activations


def _class_of(module: Any) -> str:
    """Return the class name of a module, with its Python module unless that is in torch.nn."""
    kind = type(module)
    made_of = getattr(module, "made_of", f"{kind.__module__}.{kind.__name__}")
    return made_of.rpartition(".")[2] if made_of.startswith("torch.nn.") else str(made_of)


def _parts(name: str, module: Any) -> Iterator[tuple[str, Any]]:
    """Yield (name, module) for each part of nested Sequentials, in order of evaluation."""
    kind = _class_of(module)
    if kind == "Sequential":
        for place, part in module._modules.items():
            yield from _parts(f"{name}.{place}".removeprefix("."), part)
    elif kind == "Linear" or kind in _ACTIVATIONS:
        yield name, module
    elif kind != "Identity":
        raise BadInputError(
            f"the network contains {shortened(kind)}, but only torch.nn.Sequential with Linear "
            f"and {', '.join(_ACTIVATIONS)}, and modules with a state_dict() of linear layers are "
            f"supported; {_ADVICE}"
        )


#: Kinds of outputs: V, dV/dz, u, and the vector (V, u).
OUTPUTS = ("V", "gradient", "policy", "V+policy")

#: What a policy requires whose observations are not the states.
_DEPLOYMENT = "state its observations in a deployment file FILE.toml (docs/policy.md) and give that"


@dataclass(frozen=True, eq=False)
class NetworkFile:
    """Network in a file: its functions, and what the file states.

    functions: requested kind, or name of an output -> function from x (n,) to the output (k,), for
        a policy before `declared.action`, with operations on vectors
    chain: the operations in their order, such as "6 -> tanh 64 -> 1"
    precision: lowest precision of the weights in the file, such as "float32"
    declared: what the file states besides its numbers
    on_basis: single layer whose inputs are the functions of the basis, or None. With such a layer,
        `functions` is empty
    """

    functions: dict[str, ca.Function]
    chain: str
    precision: str = "float64"
    declared: Declared = NOTHING
    on_basis: Layer | None = None


class Asked(NamedTuple):
    """What a caller asks of a network.

    states: number of inputs of the network: states of the plant, or observations
    network: outputs and their kinds, such as "value", "V=value" or "V=value,policy=actor". For
        tensors, an output is a list of words in their names, joined by +; for an ONNX graph, it is
        the name of an output. Without a kind, the number of outputs decides. "" selects what the
        file states, or all
    activation: activation between the layers, one of `ACTIVATIONS`. An activation of the output
        follows after a comma. None for that of the file
    basis_size: size of the basis. A single layer with this number of inputs acts on the basis
    sizes: numbers of outputs that the caller can use, () for any
    of_states: whether the inputs are states, before which no normalizer acts
    """

    states: int
    network: str = ""
    activation: str | None = None
    basis_size: int = 0
    sizes: tuple[int, ...] = ()
    of_states: bool = False


class _Contents(NamedTuple):
    """Tensors by name, whether they are in the order of evaluation, and what the file states.

    activations: layer -> its activation, of a torch module; None if the file has no activations
    """

    tensors: Mapping[str, np.ndarray]
    is_ordered: bool
    declared: Declared = NOTHING
    activations: Mapping[str, str] | None = None


def network_in(source: Any, asked: Asked) -> NetworkFile:
    """Return the network in a file, in a torch module or in a mapping of tensors.

    source: path of the file, torch module, state dict, or CasADi Function. The name "V",
        "gradient" or "policy" of a CasADi Function is its kind, if no other is asked for

    Raises a BadInputError of one line that names the file.
    """
    if isinstance(source, ca.Function):
        kind = asked.network or (source.name() if source.name() in OUTPUTS else "")
        return NetworkFile({kind: source}, f"function {source.name()}")
    parts = _requested_parts(asked.network)
    if not isinstance(source, (str, Path)):
        return _network_of(_in_memory(source), asked, parts)
    path = Path(source)
    with prefix_errors(path), file_faults(path):
        try:
            if path.suffix.lower() == ".onnx":
                return _of_graph(path, asked, parts)
            return _network_of(_in_file(path), asked, parts)
        except (OSError, BadInputError):
            raise
        except Exception as error:  # not of a parser: the file may be right
            reason = shortened(f"{type(error).__name__}: {error}".partition("\n")[0])
            raise BadInputError(
                f"hfa does not understand this network ({reason}), perhaps by an error of its own; "
                "export the network to ONNX in another way, and report this line"
            ) from error


def _of_graph(path: Path, asked: Asked, parts: Mapping[str, str]) -> NetworkFile:
    """Return the requested outputs of an ONNX graph in a file."""
    if asked.activation is not None:
        raise BadInputError("an ONNX file already contains the activations; remove activation")
    graph = graph_functions(path, asked.states, parts)
    return NetworkFile(
        graph.functions,
        chain=graph.operators,
        precision=graph.precision,
        declared=Declared(notes=graph.notes),
    )


def _in_file(path: Path) -> _Contents:
    """Return the tensors in a file, and what it states."""
    suffix = path.suffix.lower()
    if suffix == ".zip" and is_stable_baselines(path):
        tensors, declared = read_zip(path)
        return _Contents(tensors, is_ordered=True, declared=declared)
    content = regular_file(path).read_bytes()
    stored = parsed(lambda: stored_in(content, suffix))
    return _contents(stored, is_ordered=suffix in ORDERED_FILES)


def _in_memory(source: Any) -> _Contents:
    """Return the tensors of a torch module or of a state dict."""
    if isinstance(source, Mapping) or is_module(source):
        return _contents(source, is_ordered=True)
    if callable(getattr(source, "state_dict", None)):
        return _contents(source.state_dict(), is_ordered=True)
    raise BadInputError(
        f"the network is {shown(source)}, but only torch modules, state dicts, CasADi functions "
        "and files are supported; export the network to ONNX"
    )


def _contents(stored: Any, *, is_ordered: bool) -> _Contents:
    """Return the tensors of a torch module, or of nested mappings and lists."""
    if is_module(stored):
        tensors, activations = module_contents(stored)
        return _Contents(tensors, is_ordered, activations=activations)
    flat = without_training(flattened(stored))
    tensors, declared = checkpoint_of(flat) or (flat, NOTHING)
    return _Contents(tensors, is_ordered, declared)


def _network_of(contents: _Contents, asked: Asked, parts: Mapping[str, str]) -> NetworkFile:
    """Return the requested networks of linear layers among tensors."""
    declared = contents.declared
    if asked.of_states:
        refuse_normalizer(declared)
    tensors, precision = checked_tensors(without_training(contents.tensors))
    if any(has_word(name, "logits") for name in tensors) and not any(parts.values()):
        raise BadInputError(
            "the policy chooses one of several discrete actions (logits), and is no input u(x); "
            "train a policy with continuous actions, or name another network by --network"
        )
    if declared.network:
        parts = _with_policy(parts, declared.network)
    all_words = "+".join(filter(None, parts.values()))

    def check(kind: str, layers: list[Layer], is_named: bool) -> None:
        """Raise BadInputError if layers do not fit the plant, or others may act on them."""
        inputs = layers[0].inputs
        is_only_layer = bool(all_words) or sum(array.ndim == 2 for array in tensors.values()) == 1
        if len(layers) == 1 and is_only_layer and inputs == asked.basis_size:
            return  # the weights of a basis, with an input for each function
        check_width(inputs, asked.states)
        if inputs == declared.inputs:  # a zip states all observations
            return
        # Nothing else acts on layers that the user names, but for a normalizer of the states.
        of_network = {layer.name for layer in layers}
        others = {
            name: array
            for name, array in tensors.items()
            if _layer(name) not in of_network
            and not has_word(name, all_words)
            and (
                not is_named
                or (array.ndim == 2 and name.endswith("weight"))
                or (asked.of_states and array.size == inputs)
            )
        }
        refuse_others(others, inputs, layers[-1].outputs)

    networks = {
        kind: layers_of(tensors, kind, part, contents.is_ordered, partial(check, kind), asked.sizes)
        for kind, part in parts.items()
    }
    declared = _with_note_on_unread(declared, tensors, networks)

    on_basis = _layer_on_basis(networks, asked)
    if on_basis is not None:
        return NetworkFile({}, f"{asked.basis_size} functions -> 1", precision, declared, on_basis)

    functions: dict[str, ca.Function] = {}
    chains = [declared.algorithm] if declared.algorithm else []
    for kind, layers in networks.items():
        layers = _with_activations(layers, contents, asked.activation)
        functions[kind] = _composed(layers)
        chains.append(_description(kind, layers))
    return NetworkFile(functions, "; ".join(chains), precision, declared)


def _with_note_on_unread(
    declared: Declared, tensors: Mapping[str, np.ndarray], networks: Mapping[str, list[Layer]]
) -> Declared:
    """Return what a file states, with a note on the tensors that no network uses."""
    used = {layer.name for layers in networks.values() for layer in layers}
    unused = [name for name in tensors if _layer(name) not in used]
    if not unused:
        return declared
    names = shortened(", ".join(roots(unused)), 200)
    return declared._replace(notes=(*declared.notes, f"not used: {names}"))


def refuse_normalizer(declared: Declared) -> None:
    """Raise BadInputError if the policy of a file acts on normalized observations."""
    if declared.is_normalized:
        raise BadInputError(
            "the policy was trained behind a VecNormalize, which the zip file does not contain; "
            f'{_DEPLOYMENT} file, with normalizer = "vecnormalize.pkl" in its [policy]'
        )


def _layer(tensor: str) -> str:
    """Return the name of the layer of a tensor, "model.0" of "model.0.weight"."""
    return tensor.rpartition(".")[0]


def _requested_parts(network: str) -> dict[str, str]:
    """Return the requested parts of a file by kind, from text such as "V=value,policy=actor"."""
    parts: dict[str, str] = {}
    for item in network.split(","):
        output, equals, part = item.strip().rpartition("=")
        if equals and output not in OUTPUTS:
            raise BadInputError(
                f"--network {shortened(item)!r}: the word before = is not a kind of output; "
                f"choose from {', '.join(OUTPUTS)}"
            )
        parts[output] = part
    return parts


def _with_policy(parts: Mapping[str, str], words_of_policy: str) -> dict[str, str]:
    """Return the requested parts, kind -> words. A policy without words gets those of its file.

    A request without a kind and words is one for the policy, as the file is of a policy.
    """
    filled = {}
    for kind, part in parts.items():
        if not part and kind in ("", "policy"):
            filled["policy"] = words_of_policy
        else:
            filled[kind] = part
    return filled


def _layer_on_basis(networks: Mapping[str, list[Layer]], asked: Asked) -> Layer | None:
    """Return the single layer whose inputs are the functions of the basis, or None.

    Only the first requested network can be such a layer. Others are then not read.
    """
    kind, layers = next(iter(networks.items()))
    # With one state and one function of the basis, only a layer that is named V, as of V = w x²,
    # acts on the function.
    acts_on_state = asked.states == asked.basis_size == 1 and kind != "V"
    if len(layers) == 1 and layers[0].inputs == asked.basis_size and not acts_on_state:
        return layers[0]
    return None


def _with_activations(
    layers: list[Layer], contents: _Contents, activation: str | None
) -> list[Layer]:
    """Return the layers with their activations: those of the file, or those that the caller asks.

    activation: "between" the layers or "between,last", or None
    """
    if contents.activations is not None:
        if activation is not None:
            raise BadInputError("the module already contains its activations; remove activation")
        return [
            layer._replace(activation=contents.activations.get(layer.name, "")) for layer in layers
        ]
    between, _, last = (activation or "").partition(",")
    between, last = (activation_named(name) if name else "" for name in (between, last))
    of_file = contents.declared.activation
    if of_file is not None:
        if activation is not None and (between, last) != (of_file, ""):
            raise BadInputError(
                f"activation is {shown(activation)}, but the file contains {of_file!r}; remove "
                "activation"
            )
        between = of_file
    elif activation is None and len(layers) > 1:
        raise BadInputError(
            'a state dict does not contain the activation; give activation="tanh" (or '
            f"{', '.join(name for name in ACTIVATIONS if name != 'tanh')}), and that of the output "
            'after a comma, as in "relu,tanh"',
            ("--set", "activation=tanh"),
        )
    hidden = [layer._replace(activation=between) for layer in layers[:-1]]
    return [*hidden, layers[-1]._replace(activation=last)]


def _composed(layers: list[Layer]) -> ca.Function:
    """Return the function x (n,) -> output (k,)."""
    h = x = ca.MX.sym("x", layers[0].inputs)
    for layer in layers:
        h = ca.DM(layer.weight) @ h + ca.DM(layer.bias)
        if layer.activation:
            h = ACTIVATIONS[layer.activation](h)
    return ca.Function("network", [x], [ca.densify(h)])


def _description(kind: str, layers: list[Layer]) -> str:
    """Return the description of a part, such as "V 6 -> tanh 64 -> 1 (layers 0, 2)"."""
    steps = [f"{layer.activation} {layer.outputs}".strip() for layer in layers]
    chain = " -> ".join([str(layers[0].inputs), *steps])
    names = ", ".join(layer.name for layer in layers if layer.name)
    named = f" (layers {shortened(names, 80)})" if names else ""
    return f"{kind} {chain}{named}".strip()
