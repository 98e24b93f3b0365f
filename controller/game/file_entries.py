"""Entries of users' files of plants and critics: texts, names and units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.names import PlantNames
from hfa_support.errors import BadInputError, shortened
from hfa_support.units import conversion

#: The entry of a file that holds one array without a name.
UNKNOWN = "the array"


def found_in(stored: Mapping[str, Any]) -> str:
    """Return the names in a file, for a message."""
    if not stored:
        return " (the file is empty)"
    return f" (found: {shortened(', '.join(sorted(stored)), 200)})"


def words(stored: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Return the texts of an entry, or () for any other content.

    Raises BadInputError for control characters.
    """
    # As objects: rows of JSON may differ in length.
    entries = np.ravel(np.asarray(stored.get(key, ()), dtype=object)).tolist()
    if not all(isinstance(entry, str) for entry in entries):
        return ()
    for entry in entries:
        if not entry.isprintable():
            raise BadInputError(
                f"{key} has {shortened(ascii(entry))}, which cannot be printed; write plain text"
            )
    return tuple(entries)


def file_scales(stored: Mapping[str, Any], plant: PlantNames) -> np.ndarray:
    """Return s with x_file = s x, (n,), from the entry `state_units`.

    It is 1 where the file or the plant has no units. Raises BadInputError for units that are
    neither the plant's nor their SI or English equivalents, and where `states` or `inputs` of the
    file are the plant's in another order.
    """
    for key in ("states", "inputs"):
        in_file = words(stored, key)
        of_plant = getattr(plant, key)
        if in_file != of_plant and sorted(in_file) == sorted(of_plant):
            raise BadInputError(
                f"its {key} are in the order {shortened(', '.join(in_file), 200)}; those of the"
                f" plant are {shortened(', '.join(of_plant), 200)}: reorder the matrices, or leave"
                f" {key} out of the file"
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
                f"state {i + 1} is in {shortened(unit)} and that of the plant in {unit_of_plant};"
                " convert it, or remove state_units from the file"
            )
    return scales
