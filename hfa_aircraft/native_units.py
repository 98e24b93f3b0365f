"""A model that may have been converted to SI, and the units of its declaration."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.units import si_factor, si_unit


def native_of(model: Model) -> Model:
    """The model in the units of its declaration: itself unless `in_si` made it."""
    return model if model.extras.native is None else model.extras.native


def native_values(model: Model, names: tuple[str, ...], values: Any) -> np.ndarray:
    """Values of signals of a model in the units of its declaration, which its own formulas take."""
    array = np.asarray(values, dtype=float)
    native = model.extras.native
    return array if native is None else array / [si_factor(native.unit(name)) for name in names]


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """A value of an English unit in the units of the model: in SI if `in_si` made the model."""
    return value if model.extras.native is None else value * si_factor(unit)


def unit_of(model: Model, unit: str) -> str:
    """The unit in which `in_units_of` gives values of an English unit."""
    return unit if model.extras.native is None else si_unit(unit)
