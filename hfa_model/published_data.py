"""Data printed in the paper: two linear models, their trim condition and the settings of the game.

The numbers are in `printed_matrices.json`, which contains no result of this project.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from hfa_model.vectors import INPUTS, LINEAR_STATES


@cache
def published_data() -> dict[str, Any]:
    """Return the numbers printed in the paper, the content of `printed_matrices.json`.

    Raises ValueError if its states or inputs are not in the order of `hfa_model.vectors`.
    """
    text = files("hfa_model").joinpath("printed_matrices.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(text)
    if tuple(data["states"]) != LINEAR_STATES or tuple(data["inputs"]) != INPUTS:
        raise ValueError(
            "printed_matrices.json: states or inputs are not in the order of hfa_model.vectors"
        )
    return data
