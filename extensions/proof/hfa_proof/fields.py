"""Entries of statements about schedules, games and models.

Each entry is a claim, or is compared with the user's data.
"""

from __future__ import annotations

from hfa_proof.subject import Field, FieldTable

_AIRCRAFT = Field("aircraft")
#: Fields of the aircraft, of the imposed values of its trims, and of the limits.
_FLIGHT: FieldTable = {
    "flight.dynamics": _AIRCRAFT,
    "flight.source": _AIRCRAFT,
    "flight.over": _AIRCRAFT,
    "flight.unit": _AIRCRAFT,
    "flight.state_units": _AIRCRAFT,
    "flight.input_units": _AIRCRAFT,
    "flight.input_scales": _AIRCRAFT,
    "flight.parameters": Field("parameters"),
    "flight.imposed": Field("trim"),
    "flight.limits": Field("limits"),
    "flight.range": Field(),
    "flight.spread": Field(),
    "flight.trims": Field(),
}
_WEIGHTS: FieldTable = {
    "weights.Q": Field("weights"),
    "weights.R": Field("weights"),
    "weights.E": Field("weights"),
    "weights.delta": Field("weights"),
}
_CONTROLLER: FieldTable = {
    f"controller.{name}": Field("gains")
    for name in ("breakpoints", "A", "B", "C", "D", "measurements", "inputs", "states")
}
_ACTUATORS: FieldTable = {
    f"{kind}.{name}": Field("actuators")
    for kind in ("fixed_actuators", "uncertain_actuators")
    for name in ("order", "damping", "bandwidth", "effectiveness")
} | {"uncertain_actuators.delay": Field("actuators")}
#: Kind of certificate -> its fields.
FIELDS: dict[str, FieldTable] = {
    "schedule": {
        **_FLIGHT,
        **_CONTROLLER,
        **_ACTUATORS,
        "loop": Field(),
        "modes": Field(),
        "decay_rate": Field(),
        "scheduled_rate": Field(),
    },
    "game": {
        **_FLIGHT,
        "plant.A": Field("plant"),
        "plant.B": Field("plant"),
        **_WEIGHTS,
        "decimals": Field(),
        "critic.K": Field("critic"),
        "critic.P": Field("critic"),
        "critic.W": Field("critic"),
        "gain_of_value": Field(),
        "distances": Field(),
        "loop": Field(),
        "delta_min": Field(),
        "modes": Field(),
    },
    "models": {
        **_FLIGHT,
        **_WEIGHTS,
        "breakpoints": Field("gains"),
        "A": Field("tables"),
        "B": Field("tables"),
        "inputs": Field("tables"),
        "K": Field("gains"),
        "errors": Field(),
    },
}
