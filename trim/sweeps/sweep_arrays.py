"""Names, axes and units of the arrays of a sweep, in memory and in a store."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model


class SweepArray(NamedTuple):
    """Array in the result of a sweep, whose first axes are the points of the sweep.

    axes: names of the further axes
    units: unit of all entries, or name of the coordinate that contains the unit of each entry
    meaning: description
    """

    axes: tuple[str, ...]
    units: str
    meaning: str

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of the array by the CF conventions: description and unit.

        If the entries have different units, the attribute `units_of` replaces `units`.
        """
        kind = "units" if self.units == "1/s" else "units_of"
        return {"long_name": self.meaning, kind: self.units}


ARRAYS = {
    "states": SweepArray(("state",), "state_unit", "X0"),
    "inputs": SweepArray(("input",), "input_unit", "U0"),
    "A": SweepArray(("rate", "state"), "rate_unit / state_unit", "dx'/dx"),
    "B": SweepArray(("rate", "input"), "rate_unit / input_unit", "dx'/du"),
    "eigenvalues": SweepArray(
        ("mode",), "1/s", "of A; fastest first in a Zarr store, otherwise one mode in each column"
    ),
}


def labels_of(model: Model, rates: tuple[str, ...]) -> dict[str, tuple[str, np.ndarray]]:
    """Return the xarray coordinates of states, rates and inputs: names and units along each axis.

    rates: names of the states whose rates are the rows of A and B
    """
    states = tuple(model.states)
    inputs = tuple(model.inputs)
    labels = {
        "state": ("state", _words(states)),
        "state_unit": ("state", _words(model.units(states))),
        "rate": ("rate", _words(rates)),
        "rate_unit": ("rate", _words(model.rate_unit(name) for name in rates)),
    }
    if inputs:
        labels["input"] = ("input", _words(inputs))
        labels["input_unit"] = ("input", _words(model.units(inputs)))
    return labels


def _words(words: Iterable[str]) -> np.ndarray:
    """Return words as an array of objects. Zarr stores strings of any length in such an array."""
    return np.array([*words], dtype=object)
