"""Names of the signals that describe moving air in a model, and the airspeed used for gusts."""

from __future__ import annotations

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from trim.point.operating_point import OperatingPoint

#: Disturbance of a model for a vertical gust.
UPDRAFT = "updraft"
#: State whose limits apply to the output `ANGLE_OF_ATTACK` in moving air.
ALPHA = "alpha"
ANGLE_OF_ATTACK = "angle_of_attack"
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


def gust_speed(point: OperatingPoint) -> float:
    """Return the speed at which gusts pass an aircraft: the trim value of `speed`.

    `speed` is a state or an output of the model. Raises BadInputError if the model has neither.
    """
    model = point.model
    if "speed" not in (*model.states, *model.outputs):
        raise BadInputError(
            f"{model.name} has no state or output named speed, which a gust requires; declare an "
            "output speed"
        )
    if "speed" in point.values:
        return point.values["speed"]
    return model.outputs_at(point.states, point.inputs, ["speed"])["speed"]
