"""Names, axes and units of the arrays of a sweep, in memory and in a store."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from trim.point.condition import TrimCondition


class SweepArray(NamedTuple):
    """Array in the result of a sweep, whose first axes are the points of the sweep.

    axes: names of the further axes
    attributes: by the CF conventions, description and unit; `units_of` names the coordinates that
        contain the unit of each entry, if these have different units
    fill: value and type of an entry that is not computed yet
    """

    axes: tuple[str, ...]
    attributes: dict[str, Any]
    fill: Any = np.nan


def arrays_of(model: Model) -> dict[str, SweepArray]:
    """Return the arrays of a sweep, name -> array. A and B are those of the linear states."""
    columns = "fastest first in a Zarr store, otherwise one mode in each column"
    return {
        "states": SweepArray(("state",), {"long_name": "X0", "units_of": "state_unit"}),
        "inputs": SweepArray(("input",), {"long_name": "U0", "units_of": "input_unit"}),
        "A": SweepArray(
            ("rate", "linear_state"),
            {"long_name": "dx'/dx", "units_of": "rate_unit / linear_state_unit"},
        ),
        "B": SweepArray(
            ("rate", "input"), {"long_name": "dx'/du", "units_of": "rate_unit / input_unit"}
        ),
        "eigenvalues": SweepArray(
            ("mode",),
            {"long_name": f"of A; {columns}", "units": f"1/{model.time_unit}"},
            complex(np.nan, np.nan),
        ),
        "at_limit": SweepArray(
            ("limited",),
            {"long_name": "-1 at the lowest limit, 1 at the highest, 0 between and without a trim"},
            np.int8(0),
        ),
        "stalled": SweepArray((), {"long_name": "1 beyond the largest lift"}, np.int8(0)),
    }


def limited(condition: TrimCondition) -> tuple[str, ...]:
    """Return the free states and the inputs of a sweep, whose limits a trim can reach."""
    free = (name for name in condition.free if name in condition.model.states)
    return (*free, *condition.model.inputs)


def at_limit(condition: TrimCondition, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Return which `limited` variables are at their lowest (-1) or highest (1) limit, (N, k).

    states: (N, n), nan without a trim
    inputs: (N, m)
    """
    names = limited(condition)
    limits = Limits.of(condition.model, names, condition.limits)
    places = [[*condition.model.states, *condition.model.inputs].index(name) for name in names]
    values = np.hstack([states, inputs])[:, places]
    return limits.at_highest(values).astype(np.int8) - limits.at_lowest(values).astype(np.int8)


def labels_of(condition: TrimCondition) -> dict[str, tuple[str, np.ndarray]]:
    """Return the xarray coordinates of a sweep: names and units along each axis."""
    model = condition.model
    states = tuple(model.states)
    inputs = tuple(model.inputs)
    labels = {
        "limited": ("limited", _words(limited(condition))),
        "state": ("state", _words(states)),
        "state_unit": ("state", _words(model.units(states))),
        "linear_state": ("linear_state", _words(model.linear)),
        "linear_state_unit": ("linear_state", _words(model.units(model.linear))),
        "rate": ("rate", _words(model.linear)),
        "rate_unit": ("rate", _words(model.rate_unit(name) for name in model.linear)),
    }
    if inputs:
        labels["input"] = ("input", _words(inputs))
        labels["input_unit"] = ("input", _words(model.units(inputs)))
    return labels


def _words(words: Iterable[str]) -> np.ndarray:
    """Return words as an array of objects. Zarr stores strings of any length in such an array."""
    return np.array([*words], dtype=object)
