"""A and B and thrust of JSBSim aircraft, compared with JSBSim.

A and B are compared with finite differences of JSBSim's accelerations. Thrust is compared at five
throttle settings. The command `python -m studies.jsbsim.dynamics [NAME ...]` prints a line for each
aircraft. In both programs, propellers and governors are in equilibrium at each state, so that A and
B contain only the other states. `flights.py` compares flights.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hfa import linearize, trim
from hfa_aircraft.model import Model
from hfa_jsbsim.reader import read_model
from studies.jsbsim.reference import AXES, GRAVITY, RADIUS, responses
from studies.jsbsim.study import positions
from trim.point.condition import release, usual_condition
from trim.point.operating_point import OperatingPoint

#: Aircraft -> calibrated airspeed, kt, and altitude, ft.
_CONDITIONS = {
    "737": (250.0, 10000.0),
    "A320": (250.0, 10000.0),
    "f15": (300.0, 10000.0),
    "T38": (300.0, 10000.0),
    "B747": (250.0, 10000.0),
    "c172p": (90.0, 3000.0),
    "c182": (100.0, 3000.0),
    "c310": (130.0, 3000.0),
    "J3Cub": (60.0, 3000.0),
    "pc7": (130.0, 5000.0),
    "DHC6": (110.0, 3000.0),
    "sgs126": (55.0, 3000.0),
}
_STATES = ("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate", "roll", "pitch")
#: Rows of A and B that follow from JSBSim's accelerations.
RATES = _STATES[:6]
#: Step of the finite differences, relative to the nominal value of a state or input.
_STEP = 1e-3
_THROTTLES = (0.0, 0.25, 0.5, 0.75, 1.0)


def main(names: Sequence[str]) -> int:
    """Print a line for each named aircraft, or for all aircraft if no name is given. Return 0."""
    for name in names or _CONDITIONS:
        model, point = trimmed(name)
        agree, entries, worst = slopes(name, model, point)
        thrust = thrust_miss(name, model, point)
        line = f"{name}: {agree} of {entries} entries of A and B to 1e-6, worst {worst}"
        print(f"{line}; thrust {thrust:.0e}", flush=True)
    return 0


def trimmed(name: str, **parameters: float) -> tuple[Model, OperatingPoint]:
    """Return a JSBSim aircraft and its trim at the airspeed and altitude of the study.

    name: name of the aircraft in JSBSim
    parameters: changed parameters of the aircraft
    """
    kcas, altitude = _CONDITIONS[name]
    gravity = GRAVITY * (RADIUS / (RADIUS + altitude)) ** 2
    model = read_model(f"jsbsim:{name}").with_parameters(gravity=gravity, **parameters)
    condition = release(usual_condition(model), hold={"kcas": kcas, "altitude": altitude})
    return model, trim(model, condition)


def _at(name: str, model: Model, state: Mapping[str, float], inputs: Mapping[str, float]) -> Any:
    """Return the request to JSBSim for a state with inputs."""
    point = {"state": dict(state), "commands": dict(inputs), "held": positions(model, inputs)}
    return {"aircraft": name, "point": point}


def slopes(name: str, model: Model, point: OperatingPoint) -> tuple[int, int, str]:
    """Return the comparison of A and B with central differences of JSBSim's accelerations.

    The result is (number of entries that agree, number of entries, text on the worst entry).
    Entries agree if they differ by less than 1e-6, relative to the entry if it is larger than 1.
    """
    state = point.states._asdict()
    inputs = point.inputs._asdict()
    columns = [*_STATES, *inputs]
    items = []
    for column in columns:
        for sign in (1.0, -1.0):
            moved = {**state, **inputs}
            moved[column] += sign * _step(model, column)
            there = {key: moved[key] for key in state}
            items.append(_at(name, model, there, {key: moved[key] for key in inputs}))
    answers = responses(items, 3000.0)
    ours = slopes_in_equilibrium(model, point)
    agree = 0
    worst = (0.0, "")
    for number, column in enumerate(columns):
        ahead, behind = (
            _rates(items[index]["point"]["state"], answers[index])
            for index in (2 * number, 2 * number + 1)
        )
        difference = (ahead - behind) / (2.0 * _step(model, column))
        misses = np.abs(difference - ours[column]) / np.maximum(1.0, np.abs(ours[column]))
        agree += int(np.sum(misses < 1e-6))
        row = int(np.argmax(misses))
        worst = max(worst, (float(misses[row]), f"{RATES[row]} by {column}"))
    return agree, len(RATES) * len(columns), f"{worst[0]:.0e} ({worst[1]})"


def _step(model: Model, name: str) -> float:
    """Return the step for central differences in a state or input: 1e-2 ft/s, 1e-4 rad or 1e-3."""
    if name == "speed":
        return 10.0 * _STEP
    if model.unit(name) == "1":
        return _STEP
    return 0.1 * _STEP


def slopes_in_equilibrium(model: Model, point: OperatingPoint) -> dict[str, np.ndarray]:
    """Return the columns (6,) of A and B by state or input, with propellers and governors in
    equilibrium.

    The rows are the derivatives in `RATES`.
    """
    linear = linearize(model, point, full=True)
    names = list(model.states)
    engines = [i for i, name in enumerate(names) if name.startswith(("rpm", "blade"))]
    # a governor whose blades are at a limit does not move
    moving = [i for i in engines if np.any(linear.A[i, engines] != 0.0)]
    rows = [names.index(name) for name in RATES]
    table = np.hstack([linear.A, linear.B])
    rest = table[rows]
    if moving:
        inner = linear.A[np.ix_(moving, moving)]
        rest = rest - linear.A[np.ix_(rows, moving)] @ np.linalg.solve(inner, table[moving])
    every = [*names, *model.inputs]
    return {name: rest[:, every.index(name)] for name in every}


def _rates(state: Mapping[str, float], answer: Mapping[str, float]) -> np.ndarray:
    """Return JSBSim's derivatives of speed, alpha, beta and angular velocity, (6,)."""
    speed, alpha, beta = (state[name] for name in ("speed", "alpha", "beta"))
    along = np.array(
        [
            math.cos(alpha) * math.cos(beta),
            math.sin(beta),
            math.sin(alpha) * math.cos(beta),
        ]
    )
    acceleration = np.array([answer[axis] for axis in AXES[:3]])
    u, v, w = speed * along
    speed_rate = along @ acceleration
    alpha_rate = (u * acceleration[2] - w * acceleration[0]) / (u**2 + w**2)
    beta_rate = (speed * acceleration[1] - v * speed_rate) / (speed * math.hypot(u, w))
    return np.array([speed_rate, alpha_rate, beta_rate, *(answer[axis] for axis in AXES[3:])])


def thrust_miss(name: str, model: Model, point: OperatingPoint) -> float:
    """Return the largest difference between the model's thrust and JSBSim's at five throttle
    settings.

    The difference is relative to JSBSim's thrust, or to 1 lb if this is larger. The result is 0 for
    an aircraft without a throttle.
    """
    if "throttle" not in model.inputs:
        return 0.0
    state = point.states._asdict()
    items = []
    for throttle in _THROTTLES:
        items.append(_at(name, model, state, {**point.inputs._asdict(), "throttle": throttle}))
    worst = 0.0
    for item, answer in zip(items, responses(items, 3000.0), strict=True):
        engines = {key: answer[key] for key in state if key.startswith(("rpm", "blade"))}
        values = {**state, **engines}
        commands = [item["point"]["commands"][key] for key in model.inputs]
        ours = model.outputs_at([values[key] for key in model.states], commands, ["thrust"])
        theirs = sum(value for key, value in answer.items() if key.startswith("thrust"))
        worst = max(worst, abs(ours["thrust"] - theirs) / max(1.0, abs(theirs)))
    return worst


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
