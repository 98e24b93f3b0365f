"""Errors of a record's columns as unknowns: bias, scale error and delay.

    recorded(t) = (1 + scale) true(t - delay) + bias

Inputs and measured quantities can have such errors. The name `bias_alpha` is the bias of the column
alpha.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal

KINDS = ("bias", "scale", "delay")
#: Limits of a scale error. They include a column with the wrong sign or in degrees.
_SCALE = (-100.0, 100.0)
#: Largest delay, s.
_DELAY = 1.0


@dataclass(frozen=True)
class SensorError:
    """Error of a column.

    kind: "bias", "scale" or "delay"
    column: name of the input, state or output
    """

    kind: str
    column: str

    @property
    def name(self) -> str:
        """Name of the error in `free` and in reports, such as "bias_alpha"."""
        return f"{self.kind}_{self.column}"

    def signal(self, model: Model) -> Signal:
        """Return the unit, nominal size, limits and initial value 0 of the error."""
        if self.kind == "bias":
            declared = model.signals[self.column]
            return Signal(declared.unit, declared.nominal)
        if self.kind == "scale":
            return Signal("1", 1.0, *_SCALE)
        return Signal(model.time_unit, 0.1, -_DELAY, _DELAY)


def sensor_errors(model: Model, columns: Iterable[str]) -> dict[str, SensorError]:
    """Return all kinds of errors of some columns, by name such as "bias_alpha".

    A name that is also a parameter of the model is omitted.
    """
    errors = [SensorError(kind, column) for column in columns for kind in KINDS]
    return {each.name: each for each in errors if each.name not in model.parameters}
