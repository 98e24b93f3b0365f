"""The paper's game, and the names of the flexible aircraft in games."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.linear_game import Defaults, game, names_of_linear, stored_game
from controller.game.zero_sum import Game
from hfa_aircraft.readers.matrices_file import file_scales
from hfa_aircraft.signals import UNNAMED, PlantNames
from hfa_model.parameters import INPUT_UNITS, INPUTS, LINEAR_STATES, LINEAR_UNITS, published_data
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel


def plant_names(linear: LinearModel) -> PlantNames:
    """Return the names and units of a linear model's states and inputs, for the titles of reports.

    The `origin` of the result is the name of the model. For the flexible aircraft, `origin` also
    contains the flight condition.
    """
    model = linear.model
    origin = model.name
    if set(LINEAR_STATES) <= set(model.linear) and tuple(model.inputs) == INPUTS:
        origin = f"the aircraft {linear.point.at_scheduled}, {model.title}"
    return names_of_linear(linear)._replace(origin=origin)


def published_game(
    A: LinearModel | np.ndarray, B: np.ndarray | None = None, **changes: Any
) -> Game:
    """Return the game of paper Section 5.1, with its Q, R, delta and E = I, on (A, B) or a linear
    model.

    A: (n, n), or a linear model
    B: (n, m), if A is a matrix
    changes: Q, R, delta, E or N in place of the paper's

    Of a linear model of the paper's aircraft, these are the defaults of `game`: additional states
    have weight 0 and no disturbance, and in SI units Q and E are converted. Q and R must be given
    if another plant does not have six states and five inputs.

    Raises BadInputError for a matrix A without B, for an unknown name in `changes`, and as
    `Game` does.

    >>> import hfa
    >>> model = hfa.paper.level_model(hfa.aircraft(), 0.2)
    >>> hfa.paper.published_game(model, delta=250.0).R.diagonal().tolist()
    [100.0, 400.0, 400.0, 400.0, 50.0]
    """
    for name in changes:
        refuse_unknown("a game has no", name, ("Q", "R", "delta", "E", "N"))
    plant: Any = A
    names = UNNAMED
    if B is None:
        if not hasattr(plant, "point"):  # of a linear model
            raise BadInputError("B is missing; give A and B, or a linear model")
        names = plant_names(plant)
        if plant.model.about.names_schedule:  # the flexible aircraft, which declares these weights
            return replace(game(plant, **changes), names=names)
        plant, B = plant.A, plant.B
    elif numbers_in("B", B).shape == (len(LINEAR_STATES), len(INPUTS)):
        names = PlantNames(LINEAR_STATES, INPUTS, LINEAR_UNITS, INPUT_UNITS)
    paper = published_data()["game"]
    weights = {"Q": paper["Q_diag"], "R": paper["R_diag"], "delta": paper["delta"]}
    return Game(A=plant, B=B, names=names, **(weights | changes))


def load_game(path: str | Path, *, row: str | None = None, **changes: Any) -> Game:
    """Return the game of the plant in a file (`stored_game` with `paper_defaults`).

    Notes on unused and missing entries are issued as warnings.

    path: file of the plant
    row: name of a row, of a file with the linear models of several conditions
    changes: Q, R, delta or N in place of the entries of the file

    Raises BadInputError, which names the file, under the conditions of `stored_game`.

    >>> import controller
    >>> game = controller.load_game("plant.npz", delta=20.0)  # doctest: +SKIP
    """
    from hfa_support.errors import warn

    stored = stored_game(path, defaults=paper_defaults, row=row, **changes)
    for note in stored.notes:
        warn(note)
    return stored.game


def paper_defaults(parts: Mapping[str, Any], names: PlantNames) -> Defaults:
    """Return the paper's E, Q, R and delta as defaults for the file of the paper's aircraft.

    A plant is the paper's aircraft if its states have the names of the aircraft, and its inputs
    have them or none. For any other plant, the result contains no defaults. E, Q and R are
    converted to the units in the file.

    parts: entries of the file, with A and B
    names: names and units in the file

    Raises BadInputError if a unit cannot be converted.
    """
    is_papers = names.states == LINEAR_STATES and names.inputs in ((), INPUTS)
    if not is_papers or "dt" in parts:
        return Defaults()
    units = {"state_units": names.state_units, "input_units": names.input_units}
    of_paper = PlantNames(state_units=LINEAR_UNITS, input_units=INPUT_UNITS)
    states, inputs = file_scales(units, of_paper)
    settings = published_data()["game"]
    values = {
        "E": np.diag(states),
        "Q": np.diag(np.array(settings["Q_diag"], dtype=float) / states**2),
        "R": np.diag(np.array(settings["R_diag"], dtype=float) / inputs**2),
        "delta": settings["delta"],
    }
    words = dict.fromkeys(("Q", "R", "delta"), "as in the paper")
    return Defaults(values, words)
