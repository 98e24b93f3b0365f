"""Errors of a record's columns as unknowns: bias, scale and delay.

    recorded(t) = (1 + scale) true(t - delay) + bias

`bias_alpha` is the bias of the column alpha. Columns of inputs and of measured quantities have such
errors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal

KINDS = ("bias", "scale", "delay")
#: Limits of the relative error of a scale: a column may be one with the wrong sign or in degrees.
_SCALE = (-100.0, 100.0)
#: Longest delay, s.
_DELAY = 1.0


@dataclass(frozen=True)
class SensorError:
    """An error of a column.

    kind: one of `KINDS`
    column: name of an input, state or output
    """

    kind: str
    column: str

    @property
    def name(self) -> str:
        """Name of the error in `free` and in reports."""
        return f"{self.kind}_{self.column}"

    def signal(self, model: Model) -> Signal:
        """Return its unit, typical size and limits, with the initial value 0 of the search."""
        if self.kind == "bias":
            declared = model.signals[self.column]
            return Signal(declared.unit, declared.nominal)
        if self.kind == "scale":
            return Signal("1", 1.0, *_SCALE)
        return Signal(model.time_unit, 0.1, -_DELAY, _DELAY)


def sensor_errors(model: Model, columns: Iterable[str]) -> dict[str, SensorError]:
    """Return name -> error for all columns, except for names that are parameters of the model."""
    errors = [SensorError(kind, column) for column in columns for kind in KINDS]
    return {each.name: each for each in errors if each.name not in model.parameters}
