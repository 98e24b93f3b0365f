"""torch modules of linear layers and activations in sequence, read without importing torch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from controller.critic.network.tensors import flattened
from hfa_support.errors import BadInputError, shortened

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


def is_module(source: Any) -> bool:
    """Return whether an object is a torch.nn.Sequential or Linear, also of a pickle (`Inert`)."""
    return _class_of(source) in ("Sequential", "Linear")


def module_contents(module: Any) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the tensors of nested Sequentials by name, and layer -> its activation.

    Raises BadInputError for another module among them, and for sizes that do not fit.
    """
    tensors: dict[str, np.ndarray] = {}
    activations: dict[str, str] = {}
    layers: list[tuple[str, tuple[int, ...]]] = []
    for name, part in _parts("", module):
        if _class_of(part) == "Linear":
            stored = {key: each for key, each in part._parameters.items() if each is not None}
            tensors |= flattened(stored, f"{name}.".removeprefix("."))
            layers.append((name, tensors[f"{name}.weight".removeprefix(".")].shape))
        elif not layers or layers[-1][0] in activations:
            raise BadInputError(
                f"the network contains the activation {_class_of(part)}, which does not directly "
                f"follow a linear layer; {_ADVICE}"
            )
        else:
            activations[layers[-1][0]] = _activation(part)
    if not layers:
        raise BadInputError("the network contains no linear layer; give a feed-forward network")
    for (before, (outputs, *_)), (name, shape) in pairwise(layers):
        if outputs != shape[-1]:
            raise BadInputError(
                f"layer {name} has {shape[-1]} inputs, but the preceding layer {before} has "
                f"{outputs} outputs; make the two numbers equal"
            )
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
