"""Access to the declared units of a model that may have been converted to SI."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.units import si_factor, si_unit


def native_of(model: Model) -> Model:
    """Return the model in the units of its declaration: itself unless `in_si` made it."""
    return model if model.extras.native is None else model.extras.native


def native_values(model: Model, names: tuple[str, ...], values: Any) -> np.ndarray:
    """Return values of signals in the units of the declaration, which the aircraft's formulas
    require."""
    array = np.asarray(values, dtype=float)
    native = model.extras.native
    return array if native is None else array / [si_factor(native.unit(name)) for name in names]


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """Return a value given in an English unit in the units of the model."""
    return value if model.extras.native is None else value * si_factor(unit)


def unit_of(model: Model, unit: str) -> str:
    """Return the unit in which `in_units_of` gives values of an English unit."""
    return unit if model.extras.native is None else si_unit(unit)
