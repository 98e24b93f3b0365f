"""Tables of a model's signals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_value

if TYPE_CHECKING:
    from hfa_aircraft.model import Model

_KINDS = ("states", "inputs", "outputs", "parameters", "disturbances")


def signals_report(model: Model) -> Report:
    """Return a report with a table for each kind of signal: names, units, limits and values.

    The value of a parameter is that in use. The value of another signal is the one that a trim
    imposes by default, if any. Angles are in degrees.
    """
    parts = []
    records: list[tuple[Any, ...]] = []
    for kind in _KINDS:
        rows = []
        for name, signal in getattr(model, kind).items():
            imposed = signal.start if kind == "parameters" else model.trim.get(name, math.nan)
            numbers = (signal.min, signal.max, imposed)
            shown = [
                shown_value(number, signal.unit) if math.isfinite(number) else ""
                for number in numbers
            ]
            rows.append((name, shown_unit(signal.unit), *shown))
            records.append((kind, name, signal.unit, *numbers))
        value = "value" if kind == "parameters" else "trim"
        if rows:
            parts.append(Table((kind, "unit", "lowest", "highest", value), rows))
    columns = ("kind", "name", "unit", "min", "max", "value")
    data = {row[1]: dict(zip(columns, row, strict=True)) for row in records}
    return Report(model.title, parts, model.extras.notes, data, Table(columns, records))
