"""Access to values in a model's declared units, for models that may have been converted to SI."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.units import si_factor, si_unit


def native_of(model: Model) -> Model:
    """Return the model in its declared units.

    The result is the original of a model that `in_si` converted, and otherwise the model itself.
    """
    return model if model.extras.native is None else model.extras.native


def native_values(model: Model, names: tuple[str, ...], values: Any) -> np.ndarray:
    """Return values of signals in the units that the original model declares.

    model: the model, possibly converted to SI
    names: names of the signals
    values: values in the units of `model`, (..., names)
    """
    array = np.asarray(values, dtype=float)
    native = model.extras.native
    return array if native is None else array / [si_factor(native.unit(name)) for name in names]


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """Return a value in the unit system of a model.

    model: the model, possibly converted to SI
    value: value in the English unit `unit`
    """
    return value if model.extras.native is None else value * si_factor(unit)


def unit_of(model: Model, unit: str) -> str:
    """Return the unit of a value that `in_units_of` returns.

    model: the model, possibly converted to SI
    unit: the English unit
    """
    return unit if model.extras.native is None else si_unit(unit)
