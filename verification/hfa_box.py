"""Box of states in which critics of the paper's aircraft are compared."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from controller.hfa_game import ORDINARY_DEVIATIONS
from hfa_model.vectors import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.units import si_factor, si_unit
from verification.critic_errors import Box, balanced_box, limited_box

_SI_UNITS = tuple(si_unit(unit) for unit in LINEAR_UNITS)


def ordinary_box(
    states: tuple[str, ...] = LINEAR_STATES,
    inputs: tuple[str, ...] = INPUTS,
    state_units: tuple[str, ...] = (),
) -> Box | None:
    """Return the box of typical deviations of the paper's aircraft, or None for another plant.

    states, inputs: names, which must be those of the aircraft
    state_units: units of the states, English or SI, or () if unknown
    """
    if (states, inputs) != (LINEAR_STATES, INPUTS):
        return None
    widths = np.array(ORDINARY_DEVIATIONS)
    speed = f"{widths[0]:g} ft/s"
    if state_units == _SI_UNITS:
        widths = widths * [si_factor(unit) for unit in LINEAR_UNITS]
        speed = f"{widths[0]:.4g} m/s"
    elif any(state_units) and state_units != LINEAR_UNITS:
        return None
    return Box(widths, f"typical deviations of the aircraft, {speed}, 0.1 rad, 0.1 rad/s")


def usual_box(game: Game) -> Box:
    """Return the box in which critics of a game are compared if no box is given.

    - the paper's aircraft: the box of typical deviations
    - a linear model whose states have limits: the largest box within them
    - otherwise: `balanced_box`
    """
    names = game.names
    box = ordinary_box(names.states, names.inputs, names.state_units)
    if box is None and game.half_widths is not None:
        box = limited_box(game.half_widths)
    return balanced_box(game) if box is None else box
