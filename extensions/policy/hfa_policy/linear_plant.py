"""Linear plants in files, as models for the assessment of policies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.names import PlantNames
from controller.game.user_files import Defaults, entries_of, is_discrete, stored_game
from hfa_aircraft.model import Model
from hfa_derivatives.matrices import plant_model
from hfa_support.errors import BadInputError, prefix_errors


def linear_plant(path: str) -> Model:
    """Return the model x' = A x + B u of a plant in a file, with its trim at the origin.

    path: file with A and B, and optionally names and units of states and inputs

    Raises BadInputError if the file contains no such plant or the plant is in discrete time.
    """
    found = read_arrays(path)
    with prefix_errors(path):
        entries, _ = entries_of(found, {"A", "B"})
        if is_discrete(entries):
            raise BadInputError(
                "the plant is in discrete time, which is not supported; give A "
                "and B of x' = A x + B u"
            )
    game = stored_game(path, found=found, defaults=_unit_weights).game
    return plant_model(path, game.names.completed(*game.B.shape), game.A, game.B)


def _unit_weights(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """Return identity matrices for the weights Q and R.

    An assessment does not use these weights.
    """
    n, m = parts["B"].shape
    words = "the identity"
    return Defaults({"Q": np.eye(n), "R": np.eye(m)}, {"Q": words, "R": words})
