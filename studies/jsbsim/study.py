"""Study of one aircraft: trims by JSBSim and by this project, evaluated in JSBSim."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from hfa_aircraft.model import Model
from hfa_jsbsim.reader import read_model
from hfa_support.errors import BadInputError
from studies.jsbsim.reference import AXES, GRAVITY, RADIUS, measured
from trim.point.condition import TrimCondition, release, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, explained, trim

#: Conditions: calibrated airspeed, kt, and altitude, ft.
SPEEDS = ((60.0, 1000.0), (90.0, 3000.0), (130.0, 5000.0), (200.0, 10000.0), (300.0, 20000.0))
#: Lift coefficients that define further speeds of each aircraft at 5000 ft.
LIFTS = (1.0, 0.7, 0.4)
_DENSITY_RATIO = 0.8617


def study(name: str) -> dict[str, Any]:
    """Return the results of one aircraft: its trims, or the reason why its file is refused."""
    try:
        model = read_model(f"jsbsim:{name}")
    except BadInputError as error:
        return {"aircraft": name, "refused": _short(str(error)), "points": []}
    held: list[dict[str, float]] = [
        {"kcas": kcas, "altitude": altitude} for kcas, altitude in SPEEDS
    ]
    usual = model.states["speed"].start  # speed at which the lift coefficient at sea level is 0.5
    for lift in LIFTS:
        speed = usual * math.sqrt(0.5 / lift / _DENSITY_RATIO)
        held.append({"speed": speed, "altitude": 5000.0})
    points = [_trimmed(model, values) for values in held]
    _measure(name, points)
    own_trims = measured(name, [{"trim": values} for values in held[: len(SPEEDS)]], 120.0)
    for point, answer in zip(points, own_trims, strict=False):
        point["jsbsim"] = bool(answer and answer.get("trimmed"))
    notes = [_short(note) for note in model.about.notes]
    return {"aircraft": name, "notes": notes, "points": points}


def _trimmed(model: Model, held: Mapping[str, float]) -> dict[str, Any]:
    """Return the result of a trim at a condition, or the reason why there is no trim."""
    gravity = GRAVITY * (RADIUS / (RADIUS + held["altitude"])) ** 2
    flown = model.with_parameters(gravity=gravity)
    condition = release(usual_condition(flown), hold=held)
    point: dict[str, Any] = {"at": dict(held)}
    try:
        solution = trim(flown, condition)
        point["kind"] = "level" if "gamma" in model.trim else "glide"
    except TrimError as error:
        point["kind"] = "none"
        point["reason"] = _short(str(explained(error, flown, condition)))
        if "gamma" in model.trim:
            glide = release(condition, free=("gamma",), hold={"throttle": 0.0})
            gliding = _solution(flown, glide)
            if gliding is not None:
                point["kind"] = "glide"
                _add(point, gliding)
    else:
        _add(point, solution)
    return point


def _solution(model: Model, condition: TrimCondition) -> OperatingPoint | None:
    try:
        return trim(model, condition)
    except TrimError:
        return None


def _add(point: dict[str, Any], solution: OperatingPoint) -> None:
    """Add the states, commands and held properties of a trim to its entry in the results."""
    point["state"] = solution.states._asdict()
    contents = {
        name: signal.start
        for name, signal in solution.model.parameters.items()
        if name.startswith("tank")
    }
    point["commands"] = solution.inputs._asdict() | contents
    point["held"] = positions(solution.model, solution.inputs._asdict())


def positions(model: Model, inputs: Mapping[str, float]) -> dict[str, float]:
    """Return the values of JSBSim properties for the inputs of a model that are positions.

    JSBSim normally computes these positions from the pilot's commands.

    inputs: name of an input -> value
    """
    held = {}
    for name, signal in model.inputs.items():
        if signal.unit == "rad":
            sides = {"left-": 1.0, "right-": -1.0} if name == "aileron" else {"": 1.0}
            for side, sign in sides.items():
                held[f"fcs/{side}{name}-pos-rad"] = sign * inputs[name]
    for note in model.about.notes:
        if not note.startswith("the input is the throttle position"):
            continue
        for number in re.findall(r"engine (\d+)", note):
            index = "" if number == "0" else f"[{number}]"
            held[f"fcs/throttle-cmd-norm{index}"] = inputs["throttle"]
            held[f"fcs/throttle-pos-norm{index}"] = inputs["throttle"]
    return held


def _measure(name: str, points: list[dict[str, Any]]) -> None:
    """Add the residual of each trim to its entry in the results."""
    measurable = [point for point in points if point["kind"] != "none"]
    answers = measured(name, measurable, 300.0) if measurable else []
    for point, answer in zip(measurable, answers, strict=True):
        if answer is None:
            continue
        point["residual"] = max(abs(answer[axis]) for axis in AXES)


def _short(text: str) -> str:
    """Return a message shortened, and without the path of the installed package."""
    words = [word.rsplit("/jsbsim/", 1)[-1] for word in text.split(" ")]
    line = " ".join(words).removeprefix("no trim: ").split(" (these equations")[0]
    return line[:240]
