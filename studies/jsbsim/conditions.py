"""Trims in climb, descent, turn, sideslip and glide, for three aircraft each, evaluated in JSBSim.

A second table shows how JSBSim's rotating, flattened earth changes a level trim. The command
`python -m studies.jsbsim.conditions` prints both as tables of docs/aircraft.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hfa import trim
from hfa_aircraft.model import Model
from hfa_jsbsim.reader import read_model
from studies.jsbsim.reference import AXES, GRAVITY, RADIUS, responses
from trim.point.condition import release, usual_condition
from trim.point.operating_point import OperatingPoint

#: Aircraft -> calibrated airspeed, kt, and altitude, ft.
_FLIGHTS = {
    "737": {"kcas": 250.0, "altitude": 10000.0},
    "c172p": {"kcas": 80.0, "altitude": 3000.0},
    "f15": {"kcas": 300.0, "altitude": 10000.0},
}
_GLIDER = {"sgs126": {"kcas": 50.0, "altitude": 3000.0}}
#: Name -> (options, held values in rad, free variables).
_CONDITIONS: dict[str, tuple[str, dict[str, float], tuple[str, ...]]] = {
    "climb": ("--hold gamma=2", {"gamma": math.radians(2.0)}, ()),
    "descent": ("--hold gamma=-2", {"gamma": math.radians(-2.0)}, ()),
    "turn": ("--hold turn_rate=3", {"turn_rate": math.radians(3.0)}, ()),
    "sideslip": ("--hold beta=1", {"beta": math.radians(1.0)}, ()),
    "glide": ("--hold throttle=0 --free gamma", {"throttle": 0.0}, ("gamma",)),
}


def main() -> int:
    """Run the study, print both tables and return 0."""
    print("| flight | on the command line | aircraft | residual in JSBSim |")
    print("| --- | --- | --- | --- |")
    for name, (typed, held, free) in _CONDITIONS.items():
        aircraft = dict(list(_FLIGHTS.items())[:3])
        if name == "glide":
            aircraft = {**dict(list(_FLIGHTS.items())[:2]), **_GLIDER}
        worst = max(_residual(each, {**speed, **held}, free) for each, speed in aircraft.items())
        print(f"| {name} | `{typed}` | {', '.join(aircraft)} | {worst:.0e} |")
    print()
    print("| 737 at 250 kt | altitude, ft | heading | alpha, deg | throttle |")
    print("| --- | --- | --- | --- | --- |")
    for altitude in (5000.0, 30000.0):
        for heading in (0.0, 90.0, 270.0):
            alpha, throttle = _earth("737", {"kcas": 250.0, "altitude": altitude}, heading)
            print(f"| | {altitude:.0f} | {heading:.0f} | {alpha:+.3f} | {throttle:+.4f} |")
    return 0


def _trimmed(
    name: str, held: Mapping[str, float], free: tuple[str, ...], gravity: float
) -> tuple[Model, OperatingPoint]:
    model = read_model(f"jsbsim:{name}").with_parameters(gravity=gravity)
    known = {each: value for each, value in held.items() if each in model.holdable}
    condition = release(usual_condition(model), hold=known, free=free)
    return model, trim(model, condition)


def _residual(name: str, held: Mapping[str, float], free: tuple[str, ...]) -> float:
    """Return the largest acceleration that JSBSim computes at a trim, ft/s² or rad/s²."""
    gravity = GRAVITY * (RADIUS / (RADIUS + held["altitude"])) ** 2
    _, point = _trimmed(name, held, free, gravity)
    item = {
        "aircraft": name,
        "point": {"state": point.states._asdict(), "commands": point.inputs._asdict()},
    }
    (answer,) = responses([item])
    return max(abs(answer[axis]) for axis in AXES)


def _earth(name: str, held: Mapping[str, float], heading: float) -> tuple[float, float]:
    """Return the errors of alpha (deg) and throttle of a level trim on JSBSim's earth."""
    # The aircraft is trimmed again with gravity changed by JSBSim's downward acceleration at the
    # trim. The errors are the differences between the two trims.
    _, point = _trimmed(name, held, (), GRAVITY)
    state = point.states._asdict() | {"yaw": math.radians(heading)}
    item: dict[str, Any] = {
        "aircraft": name,
        "earth": "own",
        "point": {"state": state, "commands": point.inputs._asdict()},
    }
    (answer,) = responses([item])
    pitch = point.states.pitch
    down = answer["wdot"] * math.cos(pitch) - answer["udot"] * math.sin(pitch)
    _, there = _trimmed(name, held, (), GRAVITY + down)
    return (
        math.degrees(there.states.alpha - point.states.alpha),
        there.inputs.throttle - point.inputs.throttle,
    )


if __name__ == "__main__":
    raise SystemExit(main())
