"""Plants in users' files that may be the aircraft's: what they do not say is the paper's."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from controller.game.file_entries import file_scales
from controller.game.names import PlantNames
from controller.game.user_files import Defaults, stored_game
from controller.game.zero_sum import Game
from hfa_model.published_data import published_data
from hfa_model.vectors import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.arguments import checks_arguments


@checks_arguments
def load_game(path: str | Path, **changes: Any) -> Game:
    """The game of a plant's file, by `stored_game` with `paper_defaults`; notes become warnings.

    changes: of Q, R, delta.
    """
    stored = stored_game(path, defaults=paper_defaults, **changes)
    for note in stored.notes:
        warnings.warn(note, stacklevel=2)
    return stored.game


def paper_defaults(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """What a plant file that may be the aircraft's takes from the paper: E, Q, R and delta.

    The plant is taken for the aircraft's where its states and inputs have the aircraft's names; or
    where it has no names, six states and five inputs, and not both Q and R of its own. Where the
    file names the aircraft's states in m/s it is the same game in m/s. Nothing of any other plant.
    """
    m = len(INPUTS)
    n = len(LINEAR_STATES)
    if parts["A"].shape != (n, n) or parts["B"].shape != (n, m):
        return Defaults()
    if names.states or names.inputs:
        if names.states not in ((), LINEAR_STATES) or names.inputs not in ((), INPUTS):
            return Defaults()
    elif "Q" in parts and "R" in parts:
        return Defaults()
    scales = np.ones(n)
    if names.states == LINEAR_STATES:
        units = {"state_units": names.state_units}
        scales = file_scales(units, PlantNames(state_units=LINEAR_UNITS))
    settings = published_data()["game"]
    values = {
        "E": np.diag(scales),
        "Q": np.diag(np.array(settings["Q_diag"], dtype=float) / scales**2),
        "R": np.diag(settings["R_diag"]).astype(float),
        "delta": settings["delta"],
    }
    words = dict.fromkeys(("Q", "R", "delta"), "as in the paper")
    return Defaults(values, words)
