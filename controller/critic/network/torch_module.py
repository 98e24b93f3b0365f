"""torch.nn.Sequential objects of linear layers and activations, read without importing torch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from controller.critic.network.network_file import NetworkFile, chain_text, composed
from controller.critic.network.onnx_graph import check_width
from controller.critic.network.row_network import Layer
from controller.critic.network.tensors import checked_tensors
from hfa_support.errors import BadInputError, shortened, shown

_ADVICE = "export the network to ONNX (torch.onnx.export) and give the ONNX file"


class _Activation(NamedTuple):
    """Name of an activation in `ACTIVATIONS`, and the settings that it requires."""

    name: str
    settings: Mapping[str, Any] = {}


#: Class in torch.nn -> the activation.
_ACTIVATIONS = {
    "ELU": _Activation("elu", {"alpha": 1.0}),
    "GELU": _Activation("gelu", {"approximate": "none"}),
    "LeakyReLU": _Activation("leaky_relu", {"negative_slope": 0.01}),
    "ReLU": _Activation("relu"),
    "SELU": _Activation("selu"),
    "SiLU": _Activation("silu"),
    "Sigmoid": _Activation("sigmoid"),
    "Softplus": _Activation("softplus", {"beta": 1.0, "threshold": 20.0}),
    "Tanh": _Activation("tanh"),
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
    parts = list(_parts("", module))
    tensors = {}
    for name, part in parts:
        if _class_of(part) == "Linear":
            tensors[f"{name}.weight"] = _numbers(name, part.weight)
            if part.bias is not None:
                tensors[f"{name}.bias"] = _numbers(name, part.bias)
    doubles, precision = checked_tensors(tensors)
    layers: list[Layer] = []
    for name, part in parts:
        if _class_of(part) == "Linear":
            weight = doubles[f"{name}.weight"]
            layers.append(Layer(name, weight, doubles.get(f"{name}.bias", np.zeros(len(weight)))))
        elif not layers or layers[-1].activation:
            raise BadInputError(
                f"the network contains the activation {_class_of(part)}, which does not directly "
                f"follow a linear layer; {_ADVICE}"
            )
        else:
            layers[-1] = layers[-1]._replace(activation=_activation(part))
    if not layers:
        raise BadInputError("the network contains no linear layer; give a feed-forward network")
    check_width(layers[0].inputs, states, inputs)
    for before, layer in pairwise(layers):
        if before.outputs != layer.inputs:
            raise BadInputError(
                f"layer {layer.name} has {layer.inputs} inputs, but the preceding layer "
                f"{before.name} has {before.outputs} outputs; make the two numbers equal"
            )
    function, on_rows = composed(layers)
    rows = {} if on_rows is None else {kind: on_rows}
    return NetworkFile({kind: function}, chain_text(layers), precision, rows=rows)


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
            f"supported; {_ADVICE}"
        )


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
    name, settings = _ACTIVATIONS[kind]
    for setting, value in settings.items():
        if getattr(module, setting) != value:
            raise BadInputError(
                f"{kind} has {setting} = {getattr(module, setting)}, but only {value} is "
                f"supported; {_ADVICE}"
            )
    return name
