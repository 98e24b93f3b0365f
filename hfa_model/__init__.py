"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written symbolically."""

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
