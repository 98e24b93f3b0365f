"""torch.nn.Sequential objects of linear layers and activations, read without importing torch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from controller.critic.network.network_file import Layer, NetworkFile, composed
from controller.critic.network.onnx_graph import check_width
from controller.critic.network.tensors import checked_tensors
from hfa_support.errors import BadInputError, shortened, shown

_ELSE = "export the network to ONNX (torch.onnx.export) and give the ONNX file"
#: Class of an activation in torch.nn -> its name in `ACTIVATIONS` and its required settings.
_ACTIVATIONS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "ELU": ("elu", {"alpha": 1.0}),
    "GELU": ("gelu", {"approximate": "none"}),
    "LeakyReLU": ("leaky_relu", {"negative_slope": 0.01}),
    "ReLU": ("relu", {}),
    "SELU": ("selu", {}),
    "SiLU": ("silu", {}),
    "Sigmoid": ("sigmoid", {}),
    "Softplus": ("softplus", {"beta": 1.0, "threshold": 20.0}),
    "Tanh": ("tanh", {}),
}


def state_dict_of(module: Any) -> dict[str, np.ndarray] | None:
    """Return the tensors of a torch module, or of its state dict, and None for other objects.

    The result is None for a Sequential too, whose parts also state the activations.
    """
    is_known = _class_of(module) in ("Sequential", "Linear")
    if not is_known and callable(getattr(module, "state_dict", None)):
        module = module.state_dict()
    if not isinstance(module, Mapping):
        return None
    for name, tensor in module.items():
        if not isinstance(name, str) or not hasattr(tensor, "detach"):
            raise BadInputError(
                f"the state dict has the entry {shown(name)}: {shown(tensor)}; give "
                "module.state_dict(), names and tensors of torch"
            )
    return {name: _numbers(name, tensor) for name, tensor in module.items()}


def module_network(module: Any, kind: str, states: int, inputs: int) -> NetworkFile:
    """Return the network of a torch.nn.Sequential of Linear layers and activations.

    kind: one of `OUTPUTS`, or "" if the number of outputs decides, which the caller does
    states, inputs: number of states and of inputs of the plant

    Raises BadInputError for another module, for sizes that do not fit, and for a weight that is not
    finite.
    """
    layers: list[Layer] = []
    activations: list[str] = []  # after each layer, "" for none
    precisions = set()
    for name, part in _parts("", module):
        if _class_of(part) == "Linear":
            layer, precision = _linear(name, part)
            layers.append(layer)
            activations.append("")
            precisions.add(precision)
        elif activations[-1:] != [""]:
            raise BadInputError(
                f"the network contains the activation {_class_of(part)}, which does not directly "
                f"follow a linear layer; {_ELSE}"
            )
        else:
            activations[-1] = _activation(part)
    if not layers:
        raise BadInputError("the network contains no linear layer; give a feed-forward network")
    steps = list(zip(layers, activations, strict=True))
    check_width(layers[0].inputs, states, inputs)
    for before, layer in pairwise(layers):
        if before.outputs != layer.inputs:
            raise BadInputError(
                f"layer {layer.name} has {layer.inputs} inputs, but the preceding layer "
                f"{before.name} has {before.outputs} outputs; make the two numbers equal"
            )
    function, on_rows = composed(steps)
    widths = [f"{activation} {layer.outputs}".strip() for layer, activation in steps]
    chain = " -> ".join([str(layers[0].inputs), *widths])
    precision = "float32" if "float32" in precisions else "float64"
    rows = {} if on_rows is None else {kind: on_rows}
    return NetworkFile({kind: function}, chain, precision, rows=rows)


def _class_of(module: Any) -> str:
    """Return the class name of a module, with its Python module unless that is in torch.nn."""
    kind = type(module)
    is_own = kind.__module__.startswith("torch.nn.")
    return kind.__name__ if is_own else f"{kind.__module__}.{kind.__name__}"


def _parts(name: str, module: Any) -> Iterator[tuple[str, Any]]:
    """Yield (name, module) for each part of nested Sequentials, in order of evaluation."""
    kind = _class_of(module)
    if kind == "Sequential":
        for place, part in enumerate(module):
            yield from _parts(f"{name}.{place}".removeprefix("."), part)
    elif kind == "Linear" or kind in _ACTIVATIONS:
        yield name, module
    elif kind != "Identity":
        raise BadInputError(
            f"the network contains {shortened(kind)}, but only torch.nn.Sequential with Linear "
            f"and {', '.join(_ACTIVATIONS)}, and modules with a state_dict() of linear layers are "
            f"supported; {_ELSE}"
        )


def _linear(name: str, module: Any) -> tuple[Layer, str]:
    """Return the layer of a torch.nn.Linear module, and the precision of its weights."""
    tensors = {"weight": _numbers(name, module.weight)}
    if module.bias is not None:
        tensors["bias"] = _numbers(name, module.bias)
    doubles, precision = checked_tensors(tensors)
    weight = doubles["weight"]
    return Layer(name, weight, doubles.get("bias", np.zeros(len(weight)))), precision


def _numbers(name: str, tensor: Any) -> np.ndarray:
    try:
        return np.asarray(tensor.detach().cpu().numpy())
    except (TypeError, RuntimeError) as error:  # numbers that NumPy does not support
        raise BadInputError(
            f"layer {name} has weights of the type {tensor.dtype}; convert the network to float32 "
            "or float64"
        ) from error


def _activation(module: Any) -> str:
    """Return the name of an activation module."""
    kind = _class_of(module)
    name, usual = _ACTIVATIONS[kind]
    for setting, value in usual.items():
        if getattr(module, setting) != value:
            raise BadInputError(
                f"{kind} has {setting} = {getattr(module, setting)}, but only {value} is "
                f"supported; {_ELSE}"
            )
    return name
