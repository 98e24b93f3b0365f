"""A linear plant in a file as a model, on which a policy is assessed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.names import PlantNames
from controller.game.user_files import Defaults, entries_of, is_discrete, stored_game
from hfa_aircraft.extras import Extras
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_support.errors import BadInputError, said_of

#: The note of every such model.
LINEAR = "linear plant without limits; its trim is the origin"


def linear_plant(path: str) -> Model:
    """Return the model x' = A x + B u of a plant in continuous time, trimmed at the origin.

    path: of a file with A and B, and optionally names and units of states and inputs.

    Raises BadInputError where the file holds no such plant.
    """
    found = read_arrays(path)
    with said_of(path):
        entries, _ = entries_of(found, {"A", "B"})
        if is_discrete(entries):
            raise BadInputError("it is in discrete time; give A and B of x' = A x + B u")
    game = stored_game(path, found=found, defaults=_unit_weights).game
    A = game.A
    B = game.B
    names = game.names.completed(*B.shape)

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        rates = {}
        for i, name in enumerate(names.states):
            by_states = sum(A[i, j] * x[j] for j in range(len(names.states)))
            by_inputs = sum(B[i, j] * u[j] for j in range(len(names.inputs)))
            rates[name] = by_states + by_inputs
        return rates, {}

    states = _signals(names.states, names.state_units)
    inputs = _signals(names.inputs, names.input_units)
    at_rest = dict.fromkeys(inputs, 0.0)
    return Model(path, states, inputs, equations, trim=at_rest, extras=Extras(notes=(LINEAR,)))


def _signals(names: tuple[str, ...], units: tuple[str, ...]) -> dict[str, Signal]:
    """Return signals without limits, of unit 1 where the file states none."""
    return {name: Signal(unit or "1") for name, unit in zip(names, units, strict=True)}


def _unit_weights(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """Return weights for a file without Q and R, which an assessment does not use."""
    n, m = parts["B"].shape
    words = "the identity"
    return Defaults({"Q": np.eye(n), "R": np.eye(m)}, {"Q": words, "R": words})
