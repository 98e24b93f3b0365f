"""Access to the declared units of a model that may be converted to SI."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.units import si_factor, si_unit


def native_of(model: Model) -> Model:
    """Return the model in its declared units: the original of a model that `in_si` converted."""
    return model if model.extras.native is None else model.extras.native


def native_values(model: Model, names: tuple[str, ...], values: Any) -> np.ndarray:
    """Return values of signals in the declared units, for formulas of the aircraft.

    names: names of the signals
    values: values in the units of the model, (..., names)
    """
    array = np.asarray(values, dtype=float)
    native = model.extras.native
    return array if native is None else array / [si_factor(native.unit(name)) for name in names]


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """Return a value in an English unit, converted to SI if the model was converted."""
    return value if model.extras.native is None else value * si_factor(unit)


def unit_of(model: Model, unit: str) -> str:
    """Return the unit of a value that `in_units_of` converts from an English unit."""
    return unit if model.extras.native is None else si_unit(unit)
