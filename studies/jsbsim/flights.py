"""Flights of 30 s from random states, compared with JSBSim at three of JSBSim's time steps.

Throttle, elevator, aileron and rudder are moved in steps. Lags of engines and filters are states of
the model. The command `python -m studies.jsbsim.flights [NAME ...]` prints the table of README.md,
with one row for each aircraft. JSBSim's earth is replaced by a sphere without rotation that is
large enough to be flat.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import root

from hfa import trim
from hfa_aircraft.march.steppers import rk4
from hfa_aircraft.model import Model
from hfa_jsbsim.reader import read_model
from hfa_support.errors import BadInputError
from studies.jsbsim.__main__ import RESULTS
from studies.jsbsim.reference import GRAVITY, responses
from trim.point.condition import release, usual_condition
from trim.point.operating_point import OperatingPoint

#: Aircraft -> calibrated airspeed, kt, and altitude, ft.
CONDITIONS = {
    "737": (250.0, 10000.0),
    "A320": (250.0, 10000.0),
    "f15": (300.0, 10000.0),
    "T38": (300.0, 10000.0),
    "B747": (250.0, 10000.0),
    "A4": (250.0, 10000.0),
    "c172p": (90.0, 3000.0),
    "c182": (100.0, 3000.0),
    "c310": (130.0, 3000.0),
    "J3Cub": (60.0, 3000.0),
    "pc7": (130.0, 5000.0),
    "DHC6": (110.0, 3000.0),
}
#: JSBSim's time steps, s. Each is a quarter of the previous one.
STEPS = (1.0 / 120.0, 1.0 / 480.0, 1.0 / 1920.0)
#: Radius of the sphere, ft. The flights cover less than 1e-6 rad of it.
RADIUS = 1e10
_SECONDS = 30
_REST = 6.0
#: Number of integration steps in a second.
_OURS = 480
_COMPARED = ("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate", "roll", "pitch")


def main(names: Sequence[str]) -> int:
    """Print a row for each named aircraft, or for all aircraft if no name is given. Return 0.

    `--states N` sets the number of random states for each aircraft.
    """
    words = list(names)
    count = 13
    if "--states" in words:
        index = words.index("--states")
        count = int(words[index + 1])
        del words[index : index + 2]
    heads = [f"JSBSim at 1/{round(1.0 / step)} s" for step in STEPS]
    print("| aircraft | states |", " | ".join(heads), "| ratios | engines at once |")
    print("| --- |", " | ".join(["---"] * (len(STEPS) + 3)), "|")
    for name in words or CONDITIONS:
        print(line(name, count), flush=True)
    return 0


def line(name: str, count: int, seed: int = 2) -> str:
    """Return the table row of one aircraft.

    The row contains the largest difference from JSBSim at each time step, divided by the nominal
    value of the state, and the ratios of these differences. The last cell is the difference at the
    shortest step for a model whose engines follow their throttles without lag. All numbers are
    medians over random states. States at which JSBSim fails are left out.

    name: name of the aircraft
    count: number of random states
    """
    model, point = trimmed(f"jsbsim:{name}?filters=states&engines=states")
    at_once, _ = trimmed(f"jsbsim:{name}?filters=states")
    flights = drawn(point, count, seed)
    items = [
        {"aircraft": name, "point": flight | {"step": step}} for flight in flights for step in STEPS
    ]
    answers = responses(items, 6000.0)
    rows = []
    for number, flight in enumerate(flights):
        theirs = answers[number * len(STEPS) : (number + 1) * len(STEPS)]
        if any(answer is None or "error" in answer for answer in theirs):
            continue
        row = [difference(model, flight, answer) for answer in theirs]
        rows.append([*row, difference(at_once, flight, theirs[-1])])
    medians = np.median(rows, axis=0)
    ratios = np.median(np.divide(np.array(rows)[:, :2], np.array(rows)[:, 1:3]), axis=0)
    cells = [name, str(len(rows)), *(f"{value:.1e}" for value in medians[:-1])]
    cells += [", ".join(f"{ratio:.1f}" for ratio in ratios), f"{medians[-1]:.1e}"]
    return f"| {' | '.join(cells)} |"


def trimmed(name: str) -> tuple[Model, OperatingPoint]:
    """Return an aircraft over a flat earth and its trim.

    The trim is at the condition in `CONDITIONS`, or at the first level trim in the study's results.

    name: value of the option `--aircraft`, such as "jsbsim:737?filters=states"
    """
    model = read_model(name).with_parameters(gravity=GRAVITY)
    held = _condition(name.removeprefix("jsbsim:").partition("?")[0])
    condition = release(usual_condition(model), hold=held)
    return model, trim(model, condition)


def _condition(name: str) -> dict[str, float]:
    """Return the values imposed on the trim of an aircraft, by name."""
    if name in CONDITIONS:
        return dict(zip(("kcas", "altitude"), CONDITIONS[name], strict=True))
    for row in json.loads(RESULTS.read_text())["aircraft"]:
        level = [point["at"] for point in row["points"] if point["kind"] == "level"]
        if row["aircraft"] == name and level:
            return dict(level[0])
    raise BadInputError(f"{name} has no level trim in {RESULTS.name}; name another aircraft")


def drawn(point: OperatingPoint, count: int, seed: int) -> list[dict[str, Any]]:
    """Return `count` requests for `responses`: random flights that begin near a trim.

    Each flight has three steps of the throttle and pulses of elevator, aileron and rudder.
    """
    rng = np.random.default_rng(seed)
    state = point.states._asdict()
    inputs = point.inputs._asdict()
    flights = []
    for _ in range(count):
        start = {name: state[name] for name in (*_COMPARED, "altitude", "yaw")}
        start["speed"] *= rng.uniform(0.95, 1.05)
        for name, size in (("alpha", 0.01), ("beta", 0.01), ("roll", 0.1), ("pitch", 0.03)):
            start[name] += rng.uniform(-size, size)
        for name in ("roll_rate", "pitch_rate", "yaw_rate"):
            start[name] += rng.uniform(-0.02, 0.02)
        stick = inputs.get("elevator", 0.0) + rng.uniform(-0.05, 0.05)
        changes: list[Any] = [
            [1.0, {"throttle": rng.uniform(0.2, 0.9)}],
            [3.0, {"elevator": stick}],
            [4.0, {"elevator": inputs.get("elevator", 0.0)}],
            [6.0, {"aileron": inputs.get("aileron", 0.0) + rng.uniform(-0.1, 0.1)}],
            [7.0, {"aileron": inputs.get("aileron", 0.0)}],
            [10.0, {"throttle": rng.uniform(0.2, 0.9)}],
            [14.0, {"rudder": inputs.get("rudder", 0.0) + rng.uniform(-0.1, 0.1)}],
            [15.0, {"rudder": inputs.get("rudder", 0.0)}],
            [20.0, {"throttle": rng.uniform(0.2, 0.9)}],
        ]
        flight = {"state": start, "commands": inputs, "changes": changes, "flight": _SECONDS}
        flights.append(flight | {"rest": _REST, "radius": RADIUS})
    return flights


def difference(model: Model, flight: Mapping[str, Any], answer: Mapping[str, Any]) -> float:
    """Return the largest difference of a compared state from JSBSim, divided by its nominal value.

    The states are compared once per second.

    flight: the request
    answer: JSBSim's response to the request
    """
    ours = simulated(model, flight, answer["start"])
    worst = 0.0
    for name in _COMPARED:
        theirs = np.array([state[name] for state in answer["states"]])
        column = ours[:, list(model.states).index(name)]
        worst = max(worst, float(np.abs(column - theirs).max()) / model.signals[name].nominal)
    return worst


def simulated(model: Model, flight: Mapping[str, Any], start: Mapping[str, float]) -> np.ndarray:
    """Return the states of a flight after each second, (seconds, n), by the classical Runge-Kutta
    method.

    flight: request with commands and their changes
    start: JSBSim's states at the start of the flight
    """
    x = _settled(model, flight, start)
    step = _second(model)
    commands = dict(flight["commands"])
    changes = list(flight["changes"])
    rows = []
    for time in range(int(flight["flight"])):
        while changes and changes[0][0] <= time:
            commands |= changes.pop(0)[1]
        held = ca.repmat(ca.DM([commands[name] for name in model.inputs]), 1, _OURS)
        x = step(x, held)[:, -1]
        rows.append(np.array(x).ravel())
    return np.array(rows)


def _settled(model: Model, flight: Mapping[str, Any], start: Mapping[str, float]) -> np.ndarray:
    """Return the initial state of a flight, (n,)."""
    u = [flight["commands"][name] for name in model.inputs]
    names = list(model.states)
    x = np.array([start.get(name, 0.0) for name in names])
    inner = [number for number, name in enumerate(names) if name not in start]
    if not inner:
        return x

    def rates(values: np.ndarray) -> np.ndarray:
        there = x.copy()
        there[inner] = values
        found = model.rates_at(there.tolist(), u)
        return np.array([found[names[number]] for number in inner])

    x[inner] = root(rates, x[inner]).x
    return x


def _second(model: Model) -> ca.Function:
    """Return the function (x, u of each step) -> states after each step of one second."""
    x = ca.SX.sym("x", len(model.states))
    u = ca.SX.sym("u", len(model.inputs))
    p = [signal.start for signal in model.parameters.values()]
    equations: Any = model.equations
    function = equations.function
    h = 1.0 / _OURS

    after = rk4(lambda x, _: function(x, u, ca.DM(p))[0], x, h)
    return ca.Function("step", [x, u], [after], {"cse": True}).mapaccum("second", _OURS)


if __name__ == "__main__":
    try:
        raise SystemExit(main(sys.argv[1:]))
    except BadInputError as error:
        raise SystemExit(f"studies.jsbsim.flights: {error}") from None
