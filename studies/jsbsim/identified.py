"""Linear models identified from noisy JSBSim flights, compared with JSBSim's linearization.

`python -m studies.jsbsim.identified [COUNT]` prints the table of README.md, with COUNT
identifications of each aircraft (default 24). The package jsbsim is required.

Each flight is a 3-2-1-1 elevator input from the trim, simulated with both signs. Terms quadratic in
the motion are equal for both signs and therefore do not change the slopes. The amplitudes were
chosen at trims that the study does not use. From an amplitude of 0.1 on, the 737's pitching moment
proportional to alpha² is visible, because drag and lift act 59 in above the center of gravity.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa import Signal, identify, trim
from hfa_aircraft.model import Model
from hfa_jsbsim.reader import read_model
from studies.jsbsim.dynamics import RATES, slopes_in_equilibrium
from studies.jsbsim.flights import RADIUS
from studies.jsbsim.reference import GRAVITY, responses
from trim.point.condition import release, usual_condition
from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True)
class Case:
    """Trim of an aircraft, and its 3-2-1-1 elevator input.

    kcas: calibrated airspeed, kt
    altitude: ft
    pulse: duration of the shortest pulse, s
    size: amplitude of the elevator command
    repeated: number of records of each flight, which differ in their noise
    given: slopes that the flights do not determine, held at JSBSim's values
    """

    kcas: float
    altitude: float
    pulse: float
    size: float
    repeated: int
    given: tuple[str, ...] = ()

    @property
    def free(self) -> list[str]:
        """Names of the identified slopes."""
        return [name for name in SLOPES if name not in self.given]


#: The slope of the c172p's drag changes at each full degree of alpha, and the slopes of its lift
#: and elevator change at 0. Therefore the trim is at 1.5 deg.
CASES = {
    "737": Case(250.0, 10000.0, 1.0, 0.04, 4),
    "c172p": Case(88.0, 4000.0, 0.5, 0.03, 1, ("speed__alpha", "speed__elevator")),
}
#: Duration of a flight, sample interval, and time step of JSBSim, s.
_SECONDS = 12.0
_INTERVAL = 0.02
_STEP = _INTERVAL / 160.0
#: Settling time of the engines before a flight, s.
_REST = 6.0
#: Sensor -> standard deviation of its noise, ft/s, rad and rad/s.
_NOISE = {"speed": 0.5, "alpha": 0.001, "pitch_rate": 0.002, "pitch": 0.001}
#: State of the linear model -> its name in JSBSim's linearization.
_STATES = {
    "speed": "Vt",
    "alpha": "Alpha",
    "pitch_rate": "Q",
    "pitch": "Theta",
    "altitude": "Alt",
}
_ELEVATOR = "DeCmd"
_ROWS = ("speed", "alpha", "pitch_rate")
_COLUMNS = ("speed", "alpha", "pitch_rate", "elevator")
#: Slopes of forces and moment, such as alpha__speed. The slope of the speed by the pitch rate is
#: set to 0. The other slopes are known from kinematics, gravity or the atmosphere.
SLOPES = tuple(
    f"{row}__{column}"
    for row in _ROWS
    for column in _COLUMNS
    if (row, column) != ("speed", "pitch_rate")
)


def main(words: Sequence[str]) -> int:
    """Print a table row for each aircraft and return 0.

    words: [COUNT], the number of identifications of each aircraft
    """
    count = int(words[0]) if words else 24
    print("| aircraft | PASS | bands that hold JSBSim's slopes | ours | least often |")
    print("| --- | --- | --- | --- | --- |")
    for name, case in CASES.items():
        print(line(name, case, count), flush=True)
    return 0


def line(name: str, case: Case, count: int) -> str:
    """Return the table row of one aircraft.

    The row contains

    - the number of identifications that pass,
    - the number of 95 % bands that contain the slope of JSBSim's linearization,
    - the number of 95 % bands that contain the slope of this project's linearization,
    - the slope of JSBSim that the fewest bands contain, with the number of these bands.

    count: number of identifications
    """
    point, flights = jsbsim_flights(name, case)
    theirs, ours = jsbsim_slopes(name, point), own_slopes(point)
    model = linear_model(theirs, case.free)
    passed = 0
    held = dict.fromkeys(case.free, 0)
    held_ours = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        found = identify(
            begun(model, rng), records(flights * case.repeated, rng), case.free, inputs="steps"
        )
        passed += found.ok
        for slope, estimate in found.parameters.items():
            held[slope] += estimate.low < theirs[slope] < estimate.high
            held_ours += estimate.low < ours[slope] < estimate.high
    bands = count * len(held)
    least = min(held, key=lambda slope: held[slope])
    cells = [
        name,
        f"{passed} of {count}",
        f"{sum(held.values())} of {bands}",
        f"{held_ours} of {bands}",
        f"{least}, {held[least]} of {count}",
    ]
    return f"| {' | '.join(cells)} |"


def jsbsim_flights(name: str, case: Case) -> tuple[OperatingPoint, list[dict[str, np.ndarray]]]:
    """Return the trim of a case and JSBSim's two flights, with both signs of the 3-2-1-1 input.

    The earth is flat. A flight is a dictionary name -> column, relative to the trim and without
    noise.
    """
    model = read_model(f"jsbsim:{name}").with_parameters(gravity=GRAVITY)
    held = {"kcas": case.kcas, "altitude": case.altitude}
    point = trim(model, release(usual_condition(model), hold=held))
    moves = [manoeuvre(case, sign) for sign in (1.0, -1.0)]
    trimmed = point.inputs._asdict()
    items = []
    for steps in moves:
        changes = [[time, {"elevator": trimmed["elevator"] + value}] for time, value in steps]
        flight = {"state": point.states._asdict(), "commands": trimmed, "changes": changes}
        flight |= {"flight": _SECONDS, "rest": _REST, "radius": RADIUS}
        items.append({"aircraft": name, "point": flight | {"step": _STEP, "interval": _INTERVAL}})
    flights = []
    for steps, answer in zip(moves, responses(items), strict=True):
        states = [answer["start"], *answer["states"]]
        columns = {
            state: np.array([each[state] for each in states]) - states[0][state]
            for state in _STATES
        }
        times = _INTERVAL * np.arange(len(states))
        edges, values = np.transpose(steps)
        held_values = np.append(values, 0.0)[np.searchsorted(edges, times + 1e-9, side="right") - 1]
        flights.append({"time": times, "elevator": held_values, **columns})
    return point, flights


def manoeuvre(case: Case, sign: float) -> list[tuple[float, float]]:
    """Return pairs (time in s, change of the elevator command) for the steps of the 3-2-1-1 input.

    sign: sign of the first pulse
    """
    times = 0.5 + case.pulse * np.array([0.0, 3.0, 5.0, 6.0, 7.0])
    values = sign * case.size * np.array([1.0, -1.0, 1.0, -1.0, 0.0])
    return list(zip(times.tolist(), values.tolist(), strict=True))


def records(
    flights: Sequence[Mapping[str, np.ndarray]], rng: np.random.Generator
) -> list[dict[str, np.ndarray]]:
    """Return the columns of the records: the flights with added sensor noise."""
    noisy = []
    for flight in flights:
        columns = {"time": flight["time"], "elevator": flight["elevator"]}
        for name, deviation in _NOISE.items():
            columns[name] = flight[name] + deviation * rng.standard_normal(len(flight[name]))
        noisy.append(columns)
    return noisy


def jsbsim_slopes(name: str, point: OperatingPoint) -> dict[str, float]:
    """Return the slopes of JSBSim's linearization at the trim, by name.

    A name such as alpha__pitch_rate denotes the derivative of alpha's rate with respect to
    pitch_rate.
    """
    request = {"state": point.states._asdict(), "commands": point.inputs._asdict()}
    request |= {"radius": RADIUS, "linear": True}
    answer = responses([{"aircraft": name, "point": request}])[0]
    table = np.hstack([answer["A"], answer["B"]])
    columns = [*answer["x"], *answer["u"]]
    names = _STATES | {"elevator": _ELEVATOR}
    return {
        f"{row}__{column}": float(table[columns.index(_STATES[row]), columns.index(names[column])])
        for row in _STATES
        for column in names
    }


def own_slopes(point: OperatingPoint) -> dict[str, float]:
    """Return the slopes of this project's linearization by name, with propellers in equilibrium."""
    columns = slopes_in_equilibrium(point.model, point)
    return {
        f"{row}__{column}": float(columns[column][RATES.index(row)])
        for row in _ROWS
        for column in _COLUMNS
    }


def linear_model(slopes: Mapping[str, float], free: Sequence[str]) -> Model:
    """Return a linear model in deviations from the trim.

    The slope speed__pitch_rate is 0, unless it is free.

    slopes: value of each slope by name
    free: names of the slopes that are parameters of the model. The other slopes are constant.
    """
    units = {"speed": ("ft/s", 10.0), "altitude": ("ft", 100.0)}
    states = {name: Signal(*units.get(name, ("rad", 0.1))) for name in _STATES}
    parameters = {name: Signal("1", abs(slopes[name]), start=slopes[name]) for name in free}
    given = {**slopes, "speed__pitch_rate": 0.0}

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates = {}
        for row in _STATES:
            terms = [(column, getattr(x, column)) for column in _STATES]
            rates[row] = 0.0
            for column, value in (*terms, ("elevator", u.elevator)):
                name = f"{row}__{column}"
                rates[row] += (getattr(p, name) if name in parameters else given[name]) * value
        return rates, {}

    return Model(
        name="linear",
        states=states,
        inputs={"elevator": Signal("1", 0.1)},
        parameters=parameters,
        equations=equations,
    )


def begun(model: Model, rng: np.random.Generator) -> Model:
    """Return the model for the start of a search: each slope multiplied by 0.5 or 1.5 at random."""
    values = {
        name: signal.start * rng.choice([0.5, 1.5]) for name, signal in model.parameters.items()
    }
    return model.with_parameters(**values)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
