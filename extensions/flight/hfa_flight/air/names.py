"""Names of the signals that describe moving air in a model, and the airspeed used for gusts."""

from __future__ import annotations

from hfa_aircraft.model import Model, altitudes, recognized
from hfa_support.errors import BadInputError
from hfa_support.units import conversion_factor, si_factor
from trim.point.operating_point import OperatingPoint

#: Disturbance of a model for a vertical gust.
UPDRAFT = "updraft"
#: State whose limits apply to the output `ANGLE_OF_ATTACK` in moving air.
ALPHA = "alpha"
ANGLE_OF_ATTACK = "angle_of_attack"
#: Standard name of a state -> role for which another state may be recognized.
_ROLES = {
    **{"pitch": "theta", "roll": "phi"},
    **{"roll_rate": "p", "pitch_rate": "q", "yaw_rate": "r"},
}
#: Notes on flights in moving air.
OVER_GROUND = (
    f"alpha is relative to the ground; the envelope limits {ANGLE_OF_ATTACK}, relative to the air"
)
LIMITED_OVER_GROUND = "speed and flow angles are over ground, and so are their limits"


def has_angle_of_attack(model: Model) -> bool:
    """Return whether a model has the state `alpha` and the output `angle_of_attack`.

    In moving air, the state is relative to the ground and the output is relative to the air.
    """
    return ALPHA in model.states and ANGLE_OF_ATTACK in model.outputs


def limited_names(model: Model, moving_air: bool) -> tuple[str, ...]:
    """Return the names of the n variables to which the envelope applies.

    The names are those of the states. In moving air, `ANGLE_OF_ATTACK` replaces alpha if the model
    has both.
    """
    if not (moving_air and has_angle_of_attack(model)):
        return tuple(model.states)
    return tuple(ANGLE_OF_ATTACK if name == ALPHA else name for name in model.states)


def state_of(model: Model, name: str) -> str:
    """Return the state or output with a standard name, or the recognized state, or "".

    name: speed, alpha, beta, pitch, roll or one of their rates, or altitude
    """
    if name in model.states or name in model.outputs:
        return name
    if name == "altitude":
        return next(iter(altitudes(model)), "")
    return recognized(model.states).get(_ROLES.get(name, name), "")


def gust_speed(point: OperatingPoint) -> float:
    """Return the speed at which gusts pass an aircraft at its trim, in its units of length per s.

    It is a state or an output of the model. Raises BadInputError if the model has neither.
    """
    model = point.model
    name = state_of(model, "speed")
    if not name:
        raise BadInputError(
            f"{model.name} has no state that is recognized as its speed, which a gust requires; "
            "an aircraft in Python may declare a state or output speed"
        )
    value = point.values.get(name)
    if value is None:
        value = model.outputs_at(point.states, point.inputs, [name])[name]
    in_feet = conversion_factor(model.unit(name), "ft/s")
    return value if in_feet is None else value * in_feet * foot_in_length_unit(model)


def foot_in_length_unit(model: Model) -> float:
    """Return the length of a foot in the unit of length that belongs to the speed of a model.

    The unit is ft for ft/s, that of the altitude for knots (ft without an altitude), and else m.
    """
    unit = model.unit(state_of(model, "speed"))
    if unit == "ft/s":
        return 1.0
    if unit in ("kt", "kts", "knot"):
        altitude = state_of(model, "altitude")
        in_unit_of_altitude = conversion_factor("ft", model.unit(altitude)) if altitude else None
        return in_unit_of_altitude or 1.0
    return si_factor("ft")


def length_unit_of(model: Model) -> str:
    """Return "ft" or "m", the unit of length that belongs to the speed of a model."""
    return "ft" if foot_in_length_unit(model) == 1.0 else "m"
