"""Bias of a record's columns as unknowns: recorded(t) = true(t) + bias.

Inputs and measured quantities can have a bias. `bias_alpha` is that of the column alpha.
"""

from __future__ import annotations

from collections.abc import Iterable

from hfa_aircraft.model import Model


def biases(model: Model, columns: Iterable[str]) -> dict[str, str]:
    """Return the name of each column's bias, such as "bias_alpha" -> the column.

    A name that is also a parameter of the model is omitted.
    """
    named = {f"bias_{column}": column for column in columns}
    return {name: column for name, column in named.items() if name not in model.parameters}
