"""Names of the flexible aircraft in games, and the typical deviations of its states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controller.game.linear_game import names_of_linear
from hfa_aircraft.model import Model
from hfa_aircraft.signals import PlantNames
from hfa_model.parameters import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.units import si_factor, si_unit

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel

#: Half-widths of the box of typical deviations of the aircraft: ft/s, rad and rad/s, in the order
#: of `LINEAR_STATES`. They have the size of the commands in Section 5.1, and less for the dihedral.
ORDINARY_DEVIATIONS = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)


def ordinary_deviations(names: PlantNames) -> np.ndarray | None:
    """Return the typical deviations of the paper's aircraft, (6,), in the units of its states.

    None for another plant, and for units that are neither English nor SI. Units that are not given
    are taken as English.

    names: names of the plant, some or all of whose inputs move
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
