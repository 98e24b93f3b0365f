"""The box of states over which a critic is compared with the exact one: the aircraft's, or a convention."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.reporting.unit_system import si_factor, si_unit
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATE_UNITS
from verification.riccati.units import balanced_units

#: Half widths of the box of ordinary deviations of the aircraft, the judge's own: ft/s, rad and rad/s, in the order of
#: `LINEAR_STATES`; the size of the commands of Section 5.1, less for the dihedral.
ORDINARY_DEVIATIONS = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)
#: States and inputs of the aircraft's linear model.
AIRCRAFT_SHAPE = (6, 5)
_UNITS = tuple(getattr(STATE_UNITS, name) for name in LINEAR_STATES)


class Box(NamedTuple):
    """half_widths: (n,), in the units of the states. about: where they come from."""

    half_widths: np.ndarray
    about: str

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {"half_widths": self.half_widths.tolist(), "about": self.about}


def ordinary_box(
    game: Game, states: tuple[str, ...] = (), inputs: tuple[str, ...] = (), state_units: tuple[str, ...] = ()
) -> Box:
    """`ORDINARY_DEVIATIONS` where states, inputs and units are the aircraft's, else balanced units of the game.

    A game without names is taken for the aircraft's where it has its six states and five inputs.
    """
    named = (states, inputs) == (LINEAR_STATES, INPUTS) if states else game.B.shape == AIRCRAFT_SHAPE
    deviations = np.array(ORDINARY_DEVIATIONS)
    if named and (not any(state_units) or state_units == _UNITS):
        return Box(deviations, "ordinary deviations of the aircraft, 7 ft/s, 0.1 rad, 0.1 rad/s")
    if named and state_units == tuple(map(si_unit, _UNITS)):
        factors = np.array([si_factor(unit) for unit in _UNITS])
        return Box(deviations * factors, "ordinary deviations of the aircraft, 2.1336 m/s, 0.1 rad, 0.1 rad/s")
    return Box(balanced_units(game), "balanced units of the game; a convention, the plant has not the aircraft's names")
