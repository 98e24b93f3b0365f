"""Flights of `hfa fly --method jsbsim`, compared with JSBSim over its rotating earth.

`python -m studies.jsbsim.frames [NAME ...]` prints the table of docs/jsbsim.md. Each row contains
the largest difference of a state at a full second, divided by the nominal value of the state. The
flights last 30 s, with steps of the throttle and pulses of elevator, aileron and rudder.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from studies.jsbsim.flights import CONDITIONS, drawn, trimmed
from studies.jsbsim.reference import responses

_STEP = 1.0 / 120.0
#: Settling time of the engines before a flight, s.
_REST = 90.0
_SEED = 3


def main(names: Sequence[str]) -> int:
    """Print a row for each named aircraft, or for all aircraft if no name is given. Return 0."""
    print("| aircraft | flights | largest difference | state |")
    print("| --- | --- | --- | --- |")
    for name in names or CONDITIONS:
        print(line(name, 3), flush=True)
    return 0


def line(name: str, count: int) -> str:
    """Return the table row of one aircraft, compared in `count` random flights."""
    worst, state = largest(name, count)
    return f"| {name} | {count} | {worst:.0e} | {state} |"


def largest(name: str, count: int, seconds: int = 30) -> tuple[float, str]:
    """Return the largest difference from JSBSim in random flights, and the name of the state.

    The states are compared once per second. A difference is divided by the nominal value of the
    state. Raises RuntimeError if JSBSim reports an error.

    name: name of the aircraft
    count: number of flights
    seconds: duration of each flight, s
    """
    model, point = trimmed(f"jsbsim:{name}")
    flights = drawn(point, count, _SEED)
    items = []
    for flight in flights:
        flight |= {"step": _STEP, "rest": _REST, "flight": seconds}
        items.append({"aircraft": name, "point": flight, "earth": "own"})
    found = []
    for flight, answer in zip(flights, responses(items), strict=True):
        if answer is None or "error" in answer:
            raise RuntimeError(f"JSBSim does not fly {name}: {answer}")
        ours = simulated(model, flight, answer["start"])
        for index, state in enumerate(model.states):
            if state not in answer["states"][0]:
                continue
            theirs = np.array([row[state] for row in answer["states"]])
            miss = ours[:, index] - theirs
            if state in ("roll", "yaw"):
                miss = (miss + np.pi) % (2.0 * np.pi) - np.pi
            found.append((float(np.abs(miss).max()) / model.signals[state].nominal, state))
    return max(found)


def simulated(model: Model, flight: Mapping[str, Any], start: Mapping[str, float]) -> np.ndarray:
    """Return the states of a flight in JSBSim's frames after each second, (seconds, n).

    start: JSBSim's states at the start of the flight
    """
    equations: Any = model.equations
    frames = equations.jsbsim_steps(_STEP)
    commands = dict(flight["commands"])
    changes = list(flight["changes"])
    x = [start.get(name, 0.0) for name in model.states]
    frames.begin(x, model.p, [commands[name] for name in model.inputs])
    rows = []
    a_second = round(1.0 / _STEP)
    for number in range(int(flight["flight"]) * a_second):
        while changes and changes[0][0] <= number * _STEP + 1e-9:
            commands |= changes.pop(0)[1]
        x = frames.advance([commands[name] for name in model.inputs])
        if (number + 1) % a_second == 0:
            rows.append(x)
    return np.array(rows)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
