"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written symbolically."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hfa_model.compiled import Aircraft
    from hfa_model.errors import BadInputError, NoSolutionError
    from hfa_model.parameters import (
        Parameters,
        ParameterSet,
        default_parameters,
        load_parameters,
        save_parameters,
    )
    from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES, Input, State

__all__ = [
    "INPUTS",
    "LINEAR_STATES",
    "STATES",
    "Aircraft",
    "BadInputError",
    "Input",
    "NoSolutionError",
    "ParameterSet",
    "Parameters",
    "State",
    "default_parameters",
    "load_parameters",
    "save_parameters",
]

_HOME = {
    "Aircraft": "compiled",
    **dict.fromkeys(("BadInputError", "NoSolutionError"), "errors"),
    **dict.fromkeys(
        ("Parameters", "ParameterSet", "default_parameters", "load_parameters", "save_parameters"), "parameters"
    ),
    **dict.fromkeys(("INPUTS", "LINEAR_STATES", "STATES", "Input", "State"), "vectors"),
}


def __getattr__(name: str) -> Any:
    """Import an export when it is first used: CasADi is slow to load, and `hfa --help` needs none of it."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
