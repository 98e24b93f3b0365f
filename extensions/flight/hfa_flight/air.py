"""Moving air: names of its components in models, and the speed at which gusts are met."""

from __future__ import annotations

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from trim.point.operating_point import OperatingPoint

#: The disturbance of a model that a vertical gust is.
UPDRAFT = "updraft"
#: The state whose limits count on the output `ANGLE_OF_ATTACK` where the air moves.
ALPHA = "alpha"
ANGLE_OF_ATTACK = "angle_of_attack"
#: Notes on flights in moving air.
OVER_GROUND = (
    f"alpha is over ground; the envelope limits {ANGLE_OF_ATTACK}, which is through the air"
)
LIMITED_OVER_GROUND = "speed and flow angles are over ground, and so are their limits"


def flown_through_air(model: Model) -> bool:
    """Return whether a model has an alpha over ground and an angle of attack through the air."""
    return ALPHA in model.states and ANGLE_OF_ATTACK in model.outputs


def limited_names(model: Model, moving_air: bool) -> tuple[str, ...]:
    """Return the names of the limited states, (n,).

    In moving air alpha is replaced by `ANGLE_OF_ATTACK`.
    """
    if not (moving_air and flown_through_air(model)):
        return tuple(model.states)
    return tuple(ANGLE_OF_ATTACK if name == ALPHA else name for name in model.states)


def gust_speed(point: OperatingPoint) -> float:
    """Return the speed at which a trimmed aircraft meets gusts: its state or output `speed`.

    Raises BadInputError for a model that has neither.
    """
    model = point.model
    if "speed" not in (*model.states, *model.outputs):
        raise BadInputError(
            f"{model.name} has no state or output speed, which a gust needs; declare one"
        )
    if "speed" in point.values:
        return point.values["speed"]
    return model.outputs_at(point.states, point.inputs, ["speed"])["speed"]
