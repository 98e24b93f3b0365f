"""Pandas tables and drawn curves of results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.figure import pyplot_figure
from hfa_support.reporting.text import shown_unit, shown_values
from trim.sweeps.sweep import Sweep

if TYPE_CHECKING:
    import pandas


def sweep_frame(swept: Sweep) -> pandas.DataFrame:
    """Return a pandas table with one row for each point of a sweep.

    The columns are the varied values, the states, the inputs, damping and frequency of each mode,
    and the reason if there is no trim.
    """
    import pandas

    model = swept.model
    names = dict.fromkeys((*swept.variables, *model.states, *model.inputs))
    columns: dict[str, Any] = {name: swept[name] for name in names}
    for mode in swept.modes:
        columns[f"{mode.name} damping"] = mode.damping[:, 0]
        columns[f"{mode.name} frequency"] = mode.frequency[:, 0]
    columns["reason"] = list(swept.reasons)
    return pandas.DataFrame(columns)


def frame(value: Any) -> pandas.DataFrame:
    """Return the pandas table of a result. For a sweep, the index contains the varied values."""
    table: pandas.DataFrame = value.to_pandas()
    return table.set_index(list(value.variables)) if isinstance(value, Sweep) else table


def entries_frame(entries: Any) -> pandas.DataFrame:
    """Return a pandas table with one row for each named entry, such as a mode, indexed by name."""
    import pandas

    rows = [
        {name: value for name, value in _values(entry) if not isinstance(value, dict)}
        for entry in entries
    ]
    return pandas.DataFrame(rows).set_index("name")


def _values(entry: Any) -> Iterator[tuple[str, Any]]:
    """Yield the name and the value of each field of a named entry."""
    yield from (entry._asdict() if hasattr(entry, "_asdict") else vars(entry)).items()


def draw_curves(value: Any, *names: Any) -> np.ndarray:
    """Draw named values of a flight or sweep in a new pyplot figure and return its Axes.

    The horizontal axis is the time of the flight, or the last variable of the sweep.

    names: names of values, or one list of names

    Raises BadInputError if no names are given, or if a sweep does not form complete lines.
    """
    shown = names[0] if len(names) == 1 and not isinstance(names[0], str) else names
    if not isinstance(shown, Sequence) or not shown:
        raise BadInputError(
            'no variable is given to plot; write names, such as plot("alpha", "pitch")'
        )
    model = value.model
    is_sweep = isinstance(value, Sweep)
    table = sweep_frame(value) if is_sweep else {}
    series = {
        name: table[name].to_numpy() if name in table else value[name] for name in map(str, shown)
    }
    axes = pyplot_figure(8.0, 1.0 + 2.0 * len(series)).subplots(len(series), sharex=True)
    if is_sweep:
        x = value.variables[-1]
        lines = _lines(value)
        unit = model.unit(x)
        times = shown_values(value[x], unit)
    else:
        x, unit = "time", model.time_unit
        lines = [slice(None)]
        times = value.time
    for panel, (name, values) in zip(np.ravel(axes), series.items(), strict=True):
        unit_shown = model.unit(name) if name in model.signals else "1"
        for line in lines:
            panel.plot(times[line], shown_values(values, unit_shown)[line])
        panel.set_ylabel(_label(name, unit_shown))
        panel.grid(alpha=0.3)
    panel.set_xlabel(_label(x, unit))
    return np.ravel(axes)


def _label(name: str, unit: str) -> str:
    """Return the label of an axis: the name with its unit, or the name alone if the unit is 1."""
    return name if unit == "1" else f"{name}, {shown_unit(unit)}"


def _lines(swept: Sweep) -> list[Any]:
    """Return a slice of the points of a sweep for each line along its last variable.

    Raises BadInputError if the points do not form complete lines.
    """
    size = swept.plan.sizes[-1]
    if len(swept) % size:
        raise BadInputError(
            "the points of the sweep do not form complete lines along the last variable; sweep a "
            "full grid"
        )
    return [slice(first, first + size) for first in range(0, len(swept), size)]
