"""Tables of a model's signals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hfa_aircraft.signals import Signal
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_value


def signals_report(
    title: str,
    signals: Mapping[str, Mapping[str, Signal]],
    trim: Mapping[str, float],
    notes: Sequence[str],
) -> Report:
    """Return a report with a table for each kind of signal: names, units, limits and values.

    The value of a parameter is its `start`. The value of another signal is the one that a trim
    imposes by default, if any. Angles are in degrees in the text, and in the signals' units in the
    data.

    title: title of the report
    signals: kind, such as "states" -> name -> signal
    trim: signal -> value that a trim imposes by default
    notes: notes of the report
    """
    parts = []
    records: list[tuple[Any, ...]] = []
    for kind, declared in signals.items():
        rows = []
        for name, signal in declared.items():
            imposed = signal.start if kind == "parameters" else trim.get(name, math.nan)
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
    return Report(title, parts, notes, data, Table(columns, records))
