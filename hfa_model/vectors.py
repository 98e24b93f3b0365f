"""State and input of the aircraft: names, order and units, declared once; everything else looks them up here."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

#: A number or a CasADi expression (SX or MX); the shape, where it is not one number, stands in the docstring. To a
#: type checker it is Any: the union of the three would let SX and MX be added, which CasADi refuses.
Quantity: TypeAlias = Any

#: One degree, rad: 15 * DEGREE.
DEGREE = math.pi / 180


class State(NamedTuple):
    """X = [V, α, h, θ, q, η, η'] in the order of the paper (Section 2.2), or one quantity per state.

    The fields hold floats, CasADi expressions, units or scales: whatever is stated once per state.
    """

    speed: Any
    alpha: Any
    altitude: Any
    pitch: Any
    pitch_rate: Any
    dihedral: Any
    dihedral_rate: Any


class Input(NamedTuple):
    """U = [δ_t, δ_ac, δ_ao, δ_ec, δ_eo] in the order of the paper (Section 2.2), or one quantity per input.

    `throttle` is dimensionless: total thrust = thrust_per_throttle * throttle (see `parameters.py`).
    """

    throttle: Any
    aileron_center: Any
    aileron_outer: Any
    elevator_center: Any
    elevator_outer: Any


STATES: tuple[str, ...] = State._fields
INPUTS: tuple[str, ...] = Input._fields
#: The six states of the paper's linear model: the altitude deviation is not controlled (Section 2.2).
LINEAR_STATES: tuple[str, ...] = tuple(name for name in STATES if name != "altitude")

STATE_UNITS = State("ft/s", "rad", "ft", "rad", "rad/s", "rad", "rad/s")
INPUT_UNITS = Input("1", "rad", "rad", "rad", "rad")
#: Units of dX/dt, for residuals of the equations of motion.
RATE_UNITS = State("ft/s^2", "rad/s", "ft/s", "rad/s", "rad/s^2", "rad/s", "rad/s^2")

#: Typical size of each quantity: one scaled unit of it. Used to weigh residuals and unknowns of different
#: units against each other, so that "balanced to 1e-10" means the same for a speed and for an angle.
STATE_SCALES = State(68.0, 0.1, 1000.0, 0.1, 0.1, 0.1, 0.1)
INPUT_SCALES = Input(40.0, 0.1, 0.1, 0.1, 0.1)
#: One scaled unit of each residual: g for the speed, and rates that the eye would notice for the rest.
RATE_SCALES = State(32.2, 0.1, 1.0, 0.1, 1.0, 0.1, 1.0)

#: Unit of every state and input, of the flight-path angle, and of alpha through the air.
UNITS: dict[str, str] = STATE_UNITS._asdict() | INPUT_UNITS._asdict() | {"gamma": "rad", "angle_of_attack": "rad"}


def entry_unit(row: str, column: str) -> str:
    """Unit of the entry of A or B that a rate (row) has per state or input (column), as text."""
    return f"({getattr(RATE_UNITS, row)})/({UNITS[column]})"
