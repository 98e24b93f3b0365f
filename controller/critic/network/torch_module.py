"""torch modules of linear layers and activations in sequence, read without importing torch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from controller.critic.network.activations import activation_named
from controller.critic.network.tensors import flattened
from hfa_support.errors import BadInputError, shortened

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
            stored = {key: each for key, each in part._parameters.items() if each is not None}
            tensors |= flattened(stored, f"{name}.".removeprefix("."))
            layer = name
        elif layer is None or layer in activations:
            raise BadInputError(
                f"the network contains the activation {kind}, which does not directly follow a "
                f"linear layer; {_ADVICE}"
            )
        else:
            _refuse_settings(part, kind)
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


def _refuse_settings(module: Any, kind: str) -> None:
    """Raise BadInputError for an activation module with other settings than those of its class."""
    for setting, value in _ACTIVATIONS[kind].items():
        if getattr(module, setting) != value:
            raise BadInputError(
                f"{kind} has {setting} = {getattr(module, setting)}, but only {value} is "
                f"supported; {_ADVICE}"
            )
