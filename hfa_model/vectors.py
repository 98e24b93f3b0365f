"""State and input of the aircraft: names, order and units, declared once; everything else looks them up here."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeAlias, TypeVar

if TYPE_CHECKING:
    import casadi as ca

#: A number or a CasADi expression; the shape, where it is not one number, stands in the docstring. SX stands for MX
#: too: whatever computes with one does with the other, and a union of both would let them be added.
Quantity: TypeAlias = "ca.SX | ca.DM | float"
#: What a State, an Input, ... holds: numbers, CasADi expressions, units or scales.
T = TypeVar("T", covariant=True)

#: One degree, rad: 15 * DEGREE.
DEGREE = math.pi / 180


class State(NamedTuple, Generic[T]):
    """X = [V, α, h, θ, q, η, η'] in the order of the paper (Section 2.2), or one quantity per state.

    The fields hold floats, CasADi expressions, units or scales: whatever is stated once per state.
    """

    speed: T
    alpha: T
    altitude: T
    pitch: T
    pitch_rate: T
    dihedral: T
    dihedral_rate: T


class Input(NamedTuple, Generic[T]):
    """U = [δ_t, δ_ac, δ_ao, δ_ec, δ_eo] in the order of the paper (Section 2.2), or one quantity per input.

    `throttle` is dimensionless: total thrust = thrust_per_throttle * throttle (see `parameters.py`).
    """

    throttle: T
    aileron_center: T
    aileron_outer: T
    elevator_center: T
    elevator_outer: T


STATES: tuple[str, ...] = State._fields
INPUTS: tuple[str, ...] = Input._fields
#: The six states of the paper's linear model: the altitude deviation is not controlled (Section 2.2).
LINEAR_STATES: tuple[str, ...] = tuple(name for name in STATES if name != "altitude")

#: Where they stand among all states.
LINEAR_ROWS = [STATES.index(name) for name in LINEAR_STATES]

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
#: Those of the six states.
LINEAR_UNITS: tuple[str, ...] = tuple(UNITS[name] for name in LINEAR_STATES)
#: What data about all states and inputs says of them.
NAMES_AND_UNITS: dict[str, list[str]] = {
    "states": list(STATES),
    "state_units": list(STATE_UNITS),
    "inputs": list(INPUTS),
    "input_units": list(INPUT_UNITS),
}


def entry_unit(row: str, column: str) -> str:
    """Unit of the entry of A or B that a rate (row) has per state or input (column), as text."""
    return f"({getattr(RATE_UNITS, row)})/({UNITS[column]})"
