"""A critic in a file that says its units, on a plant in others: what was written in m is used in ft."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.basis import Basis
from hfa_model.reporting.unit_system import si_factor, si_unit
from hfa_model.support.echo import shortened
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES, UNITS


def file_scales(stored: Mapping[str, Any], state_units: tuple[str, ...]) -> np.ndarray:
    """s with x_file = s x, (n,), from the entry `state_units`; ones where the file or the plant says no units.

    state_units: of the plant. BadInputError for units that are neither the plant's nor their SI or English ones.
    """
    scales = np.ones(len(state_units))
    said = np.ravel(stored.get("state_units", ())).tolist()
    if len(said) != len(state_units) or not all(isinstance(unit, str) for unit in said):
        return scales
    for place, (unit, own) in enumerate(zip(said, state_units, strict=True)):
        if "" in (unit, own) or unit == own:
            continue
        if si_unit(own) == unit:
            scales[place] = si_factor(own)
        elif si_unit(unit) == own:
            scales[place] = 1.0 / si_factor(unit)
        else:
            raise BadInputError(
                f"state {place + 1} is in {shortened(unit)} and that of the plant in {own}; convert it, or leave "
                "state_units out of the file"
            )
    return scales


def aircraft_scales(names: Mapping[str, tuple[str, ...]], size: int) -> np.ndarray:
    """s with x_file = s x, (size,), x in the units of the paper: of a plant with the aircraft's states; else 1."""
    if names.get("states") != LINEAR_STATES:
        return np.ones(size)
    try:
        return file_scales(names, tuple(UNITS[name] for name in LINEAR_STATES))
    except BadInputError:
        return np.ones(size)


def in_scales(critic: Mapping[str, np.ndarray], scales: np.ndarray, functions: Basis | None) -> dict[str, np.ndarray]:
    """W ψ(s x), (s x)' P (s x) and K s x as functions of x: W (..., M), P (..., n, n), K (..., m, n) by name.

    functions: of W; what has not the shape of the plant stays as it is, and is refused where it is used.
    """
    found, n = dict(critic), len(scales)
    if "K" in found and found["K"].shape[-1] == n:
        found["K"] = found["K"] * scales
    if "P" in found and found["P"].shape[-2:] == (n, n):
        found["P"] = found["P"] * np.outer(scales, scales)
    if "W" in found and functions is not None and found["W"].shape[-1] == functions.size:
        found["W"] = found["W"] * functions.scaling(scales)
    return found
