"""Texts, names and units in plant files and critic files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.names import PlantNames
from hfa_support.errors import BadInputError, shortened
from hfa_support.units import conversion

#: Name of the entry that contains a single unnamed array.
UNKNOWN = "the array"


def found_in(stored: Mapping[str, Any]) -> str:
    """Return the end of an error message with the names of all entries of a file.

    The text is " (found: A, B)", or " (the file is empty)".

    stored: name -> value of the entries
    """
    if not stored:
        return " (the file is empty)"
    return f" (found: {shortened(', '.join(sorted(stored)), 200)})"


def words(stored: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Return the texts in one entry of a file.

    The result is () if the entry is missing or contains anything but text.

    stored: name -> value of the entries
    key: name of the entry

    Raises BadInputError for characters that cannot be printed.
    """
    # As objects, because rows of JSON may differ in length.
    entries = np.ravel(np.asarray(stored.get(key, ()), dtype=object)).tolist()
    if not all(isinstance(entry, str) for entry in entries):
        return ()
    for entry in entries:
        if not entry.isprintable():
            raise BadInputError(
                f"{key} contains {shortened(ascii(entry))}, which cannot be printed; use plain text"
            )
    return tuple(entries)


def file_scales(stored: Mapping[str, Any], plant: PlantNames) -> np.ndarray:
    """Return the factors s (n,) that convert the states from the plant's units to the file's units.

    A state x in the plant's units is s x in the file's units. The entry `state_units` contains the
    file's units. The factor of a state is 1 if its unit is unknown in the file or in the plant. All
    factors are 1 if the file does not contain n units.

    stored: name -> value of the entries of the file
    plant: names and units of the plant

    Raises BadInputError if a unit cannot be converted, or if the file lists the plant's states or
    inputs in another order.
    """
    for key in ("states", "inputs"):
        in_file = words(stored, key)
        of_plant = getattr(plant, key)
        if in_file != of_plant and sorted(in_file) == sorted(of_plant):
            raise BadInputError(
                f"the {key} are {shortened(', '.join(in_file), 200)} in the file, but in the "
                f"plant {shortened(', '.join(of_plant), 200)}; reorder the matrices or remove "
                f"{key}"
            )
    units = words(stored, "state_units")
    scales = np.ones(len(plant.state_units))
    if len(units) != len(scales):
        return scales
    for i, (unit, unit_of_plant) in enumerate(zip(units, plant.state_units, strict=True)):
        factor = conversion(unit_of_plant, unit)
        if factor is not None:
            scales[i] = factor
        elif unit and unit_of_plant:
            raise BadInputError(
                f"state {i + 1} is in {shortened(unit)} in the file but in {unit_of_plant} in the"
                " plant; convert the matrices, or remove state_units from the file"
            )
    return scales
