"""Game of paper Section 5.1 on the flexible aircraft: its Q, R, delta and E."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.linear_game import names_of_linear
from controller.game.zero_sum import Game
from hfa_aircraft.model import Model
from hfa_aircraft.names import PlantNames
from hfa_model.published import published_data
from hfa_model.vectors import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.matrices import LARGEST, checked_matrix
from hfa_support.units import si_factor, si_unit

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel

#: Half-widths of the box of typical deviations of the aircraft: ft/s, rad and rad/s, in the order
#: of `LINEAR_STATES`. They have the size of the commands in Section 5.1, and less for the dihedral.
ORDINARY_DEVIATIONS = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)


def ordinary_deviations(names: PlantNames) -> np.ndarray | None:
    """Return the typical deviations of the paper's aircraft, (6,), or None for another plant.

    names: names of the plant, some or all of whose inputs move. Its units are English, SI, or
        unknown
    """
    if names.states != LINEAR_STATES or not set(names.inputs) <= set(INPUTS):
        return None
    widths = np.array(ORDINARY_DEVIATIONS)
    if names.state_units == tuple(si_unit(unit) for unit in LINEAR_UNITS):
        return widths * [si_factor(unit) for unit in LINEAR_UNITS]
    if any(names.state_units) and names.state_units != LINEAR_UNITS:
        return None
    return widths


def plant_names(linear: LinearModel) -> PlantNames:
    """Return the names and units of a linear model's states and inputs, for the titles of reports.

    The `origin` of the result is the name of the model. For the flexible aircraft, `origin` also
    contains the flight condition.
    """
    model = linear.model
    origin = model.name
    if _is_flexible(model):
        origin = f"the aircraft {linear.point.at_scheduled}, {model.title}"
    return names_of_linear(linear)._replace(origin=origin)


def _is_flexible(model: Model) -> bool:
    """Return whether a model has all states and exactly the inputs of the paper's aircraft."""
    return set(LINEAR_STATES) <= set(model.linear) and tuple(model.inputs) == INPUTS


def paper_game(
    A: Any, B: Any, names: PlantNames, model: Model | None, changes: dict[str, Any]
) -> Game:
    """Return the paper's game for a plant (A, B), in the units of the plant's model.

    States that the paper's aircraft does not have get weight 0 and no disturbance.

    A: (n, n)
    B: (n, m)
    names: names and units of the plant's states and inputs
    model: model of the plant. For a model in SI units, the paper's E and Q are converted; its
        inputs have no English units. None for a plant in the paper's units.
    changes: Q, R, delta, E or N in place of the paper's

    Raises BadInputError as `Game` does.
    """
    states = names.states
    settings = published_data()["game"]
    A = checked_matrix("A", A, LARGEST)
    E = np.eye(len(A))
    Q = np.diag(settings["Q_diag"]).astype(float)
    if len(states) > len(Q) and set(LINEAR_STATES) <= set(states):
        E = E[:, [states.index(name) for name in LINEAR_STATES]]
        Q = E @ Q @ E.T
    R = np.diag(settings["R_diag"]).astype(float)
    native = None if model is None else model.source.native
    if native is not None:
        of_states = np.array([si_factor(native.unit(name)) for name in states])
        E = of_states[:, None] * E
        Q = Q / np.outer(of_states, of_states)
    parts = {"E": E, "Q": Q, "R": R, "delta": settings["delta"]}
    return Game(A=A, B=B, names=names, **(parts | changes))
