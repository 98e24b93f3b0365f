"""State and input of the aircraft: names, order and units."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeAlias, TypeVar

from hfa_aircraft.signals import Signal

if TYPE_CHECKING:
    import casadi as ca

#: A number or a CasADi expression. Docstrings state the shape if it is not a single number. SX also
#: represents MX, because code that accepts one accepts the other; a union of both would permit
#: their sum.
Quantity: TypeAlias = "ca.SX | ca.DM | float"
#: Type of the values in a State, an Input, ...: numbers, CasADi expressions, units or scales.
T = TypeVar("T", covariant=True)

#: One degree in radians, used as 15 * DEGREE.
DEGREE = math.pi / 180


class State(NamedTuple, Generic[T]):
    """State X = [V, α, h, θ, q, η, η'] in the order of the paper (Section 2.2).

    The values are numbers, CasADi expressions, units or signals.

    speed: V, ft/s
    alpha: α, rad, angle of attack at the center of mass
    altitude: h, ft
    pitch: θ, rad
    pitch_rate: q, rad/s
    dihedral: η, rad, of both outer panels, tips up
    dihedral_rate: η', rad/s

    >>> from hfa_model import State
    >>> State(68.0, 0.05, 40000.0, 0.05, 0.0, 0.2, 0.0).dihedral
    0.2
    """

    speed: T
    alpha: T
    altitude: T
    pitch: T
    pitch_rate: T
    dihedral: T
    dihedral_rate: T


class Input(NamedTuple, Generic[T]):
    """Input U = [δ_t, δ_ac, δ_ao, δ_ec, δ_eo] in the order of the paper (Section 2.2).

    The values are numbers, CasADi expressions, units or signals.

    throttle: δ_t, 1; total thrust = thrust_per_throttle * throttle (`Parameters`)
    aileron_center: δ_ac, rad, positive with the trailing edge down
    aileron_outer: δ_ao, rad, positive with the trailing edge down
    elevator_center: δ_ec, rad, positive for more lift on the tail
    elevator_outer: δ_eo, rad, positive for more lift on the tail

    >>> from hfa_model import Input
    >>> Input(40.0, 0.0, 0.03, 0.0, -0.05).elevator_outer
    -0.05
    """

    throttle: T
    aileron_center: T
    aileron_outer: T
    elevator_center: T
    elevator_outer: T


#: The names of the seven states, in order.
STATES: tuple[str, ...] = State._fields
#: The names of the five inputs, in order.
INPUTS: tuple[str, ...] = Input._fields
#: The six states of the paper's linear model. The altitude is omitted, because it is not controlled
#: (Section 2.2).
LINEAR_STATES: tuple[str, ...] = tuple(name for name in STATES if name != "altitude")

#: Indices of these states among all seven.
LINEAR_ROWS = [STATES.index(name) for name in LINEAR_STATES]

#: Highest altitude of the atmosphere model, ft (the limit of 20 km geopotential altitude is at
#: 65,824 ft).
HIGHEST_ALTITUDE = 65_000.0

_ANGLE = Signal("rad", 0.1)
_RATE = Signal("rad/s", 0.1, rate=1.0)


def _within(limit_deg: float) -> Signal:
    """Return an angle with the assumed limits ±limit_deg."""
    limit = math.radians(limit_deg)
    return _ANGLE._replace(min=-limit, max=limit, assumed=True)


#: Units, typical sizes and limits of the states. The typical rate of the speed is g; all other
#: typical rates are visible ones. The paper states no limits; the assumed ones mean attached flow
#: and the altitudes of the atmosphere model.
STATE_SIGNALS = State(
    speed=Signal("ft/s", 68.0, 1.0, 500.0, start=68.0, rate=32.2, assumed=True),
    alpha=_within(20),
    altitude=Signal("ft", 1000.0, 0.0, HIGHEST_ALTITUDE, rate=1.0, assumed=True),
    pitch=_within(60),
    pitch_rate=_RATE,
    dihedral=_within(60),
    dihedral_rate=_RATE,
)
_THROTTLE = Signal("1", 40.0, 0.0, 200.0, start=40.0, assumed=True)
_AILERON = _within(20)
_ELEVATOR = _within(30)
INPUT_SIGNALS = Input(_THROTTLE, _AILERON, _AILERON, _ELEVATOR, _ELEVATOR)

INPUT_UNITS: tuple[str, ...] = tuple(signal.unit for signal in INPUT_SIGNALS)
LINEAR_UNITS: tuple[str, ...] = tuple(getattr(STATE_SIGNALS, name).unit for name in LINEAR_STATES)
