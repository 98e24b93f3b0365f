"""Linear plants in files, as models for the assessment of policies."""

from __future__ import annotations

from controller.game.array_file import read_arrays
from controller.game.file_entries import entries_of, is_discrete, plant_matrices, plant_names
from hfa_aircraft.matrices import plant_model
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, prefix_errors


def linear_plant(path: str) -> Model:
    """Return the model x' = A x + B u of a plant in a file, with its trim at the origin.

    path: file with A and B, and optionally names and units of states and inputs

    Raises BadInputError if the file contains no such plant or the plant is in discrete time.
    """
    found = read_arrays(path)
    with prefix_errors(path):
        stored, notes = entries_of(found, {"A", "B"})
        if is_discrete(stored):
            raise BadInputError(
                "the plant is in discrete time, which is not supported; give A "
                "and B of x' = A x + B u"
            )
        A, B = plant_matrices(stored)
        n, m = B.shape
        names = plant_names(stored, n, m, notes)
    return plant_model(path, names.completed(n, m), A, B)
