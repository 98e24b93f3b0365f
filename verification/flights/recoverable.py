"""How far from trim a linear policy holds: initial speed and dihedral, and dihedral commands; linear and nonlinear."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from controller.flight.envelope import Envelope
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.trials import TrialLoop, Trials
from controller.riccati.balancing import spectrum
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import LINEAR_ROWS, LINEAR_STATES, STATES
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from trim.point.operating_point import OperatingPoint
from verification.flights.recoverable_map import Edge, RecoverableMap

#: Length of a trial in time constants of the slowest mode of the linear loop.
TIME_CONSTANTS = 8.0
#: A map holds at most this many points, about ten minutes of trials.
MOST_POINTS = 50_000
#: Flights along a ray before the bisection between the last that succeeds and the first that fails, and its halvings.
_SCAN, _HALVINGS = 24, 12
_SPEED, _DIHEDRAL = STATES.index("speed"), STATES.index("dihedral")
_COMMANDED = LINEAR_STATES.index("dihedral")


def recoverable_map(
    aircraft: Aircraft,
    point: OperatingPoint,
    gain: np.ndarray,
    envelope: Envelope,
    *,
    speeds: np.ndarray,
    dihedrals: np.ndarray,
    commands: np.ndarray,
    progress: Progress | None = None,
) -> RecoverableMap:
    """Fly u = -K z from every start and to every command on the nonlinear aircraft and on its linear model.

    gain: K (5, 6). speeds (ft/s), dihedrals (rad): deviations at the start. commands: rad, dihedral beyond trim. A
    trial lasts `TIME_CONSTANTS` of the slowest mode of A - B K. BadInputError when a list is empty or not finite, the
    map too large, or A - B K not Hurwitz.
    """
    for name, values in (("speeds", speeds), ("dihedrals", dihedrals), ("commands", commands)):
        if len(values) == 0 or not np.all(np.isfinite(values)):
            raise BadInputError(f"the map's {name} are empty or not finite; give numbers")
    if len(speeds) * len(dihedrals) > MOST_POINTS:
        raise BadInputError(f"the map has {len(speeds) * len(dihedrals)} points; at most {MOST_POINTS} are allowed")
    reach = float(np.abs(speeds).max()), float(np.abs(dihedrals).max()), float(np.abs(commands).max())
    found: dict[str, tuple[Trials, Trials]] = {}
    edges: list[Edge] = []
    model = LinearizedAircraft.at(aircraft, point)
    plants: dict[str, NonlinearPlant | LinearizedAircraft] = {
        "nonlinear": NonlinearPlant(aircraft, point),
        "linear": model,
    }
    seconds = _trial_time(model, gain)
    starts, orders = _starts(speeds, dihedrals), _commands(commands)
    flown = itertools.count(1)
    total = len(plants) * (len(starts) + len(orders))
    tell = (lambda: None) if progress is None else (lambda: progress(next(flown), total))
    for name, plant in plants.items():
        loop = TrialLoop(plant, point, envelope)
        found[name] = (
            loop.fly(gain, starts, np.zeros((len(starts), len(LINEAR_STATES))), seconds, tell),
            loop.fly(gain, np.zeros((len(commands), len(STATES))), orders, seconds, tell),
        )
        edges += _edges(loop, gain, name, reach, seconds)
    return RecoverableMap(
        aircraft.variant.name,
        point,
        envelope,
        speeds,
        dihedrals,
        found["nonlinear"][0],
        found["linear"][0],
        commands,
        found["nonlinear"][1],
        found["linear"][1],
        tuple(edges),
    )


def _trial_time(model: LinearizedAircraft, gain: np.ndarray) -> float:
    abscissa = spectrum(model.A[np.ix_(LINEAR_ROWS, LINEAR_ROWS)] - model.B[LINEAR_ROWS] @ gain).abscissa
    if abscissa >= 0.0:
        raise BadInputError(f"A - B K has abscissa {abscissa:+.4g} 1/s; give a gain that stabilizes the linear model")
    return TIME_CONSTANTS / -abscissa


def _starts(speeds: np.ndarray, dihedrals: np.ndarray) -> np.ndarray:
    starts = np.zeros((len(dihedrals), len(speeds), len(STATES)))
    starts[:, :, _SPEED], starts[:, :, _DIHEDRAL] = speeds[None, :], dihedrals[:, None]
    return starts.reshape(-1, len(STATES))


def _commands(commands: np.ndarray) -> np.ndarray:
    orders = np.zeros((len(commands), len(LINEAR_STATES)))
    orders[:, _COMMANDED] = commands
    return orders


def _edges(
    loop: TrialLoop, gain: np.ndarray, plant: str, reach: tuple[float, float, float], seconds: float
) -> list[Edge]:
    def start(values: np.ndarray, index: int) -> Trials:
        starts = np.zeros((len(values), len(STATES)))
        starts[:, index] = values
        return loop.fly(gain, starts, np.zeros((len(values), len(LINEAR_STATES))), seconds)

    def command(values: np.ndarray) -> Trials:
        return loop.fly(gain, np.zeros((len(values), len(STATES))), _commands(values), seconds)

    at_trim = np.zeros(len(LINEAR_STATES))
    rays: list[tuple[str, Callable[[np.ndarray], Trials], Callable[[Trials, np.ndarray], np.ndarray], float]] = [
        ("speed", lambda v: start(v, _SPEED), lambda t, v: t.returned(at_trim), reach[0]),
        ("dihedral", lambda v: start(v, _DIHEDRAL), lambda t, v: t.returned(at_trim), reach[1]),
        ("dihedral command", command, lambda t, v: t.arrived(v), reach[2]),
    ]
    return [_edge(axis, sign, plant, fly, back, far) for axis, fly, back, far in rays for sign in (-1, 1) if far > 0.0]


def _edge(
    axis: str,
    sign: int,
    plant: str,
    fly: Callable[[np.ndarray], Trials],
    back: Callable[[Trials, np.ndarray], np.ndarray],
    far: float,
) -> Edge:
    values = far * np.arange(1, _SCAN + 1) / _SCAN
    scan = fly(sign * values)
    held, failure = _bisected(values, scan.held, lambda v: fly(sign * v).held, far)
    state, time = "", np.inf
    if failure < np.inf:
        beyond = fly(np.array([sign * failure]))
        state, time = STATES[int(beyond.left[0])], float(beyond.when[0])
    returned, _ = _bisected(values, back(scan, sign * values), lambda v: back(fly(sign * v), sign * v), far)
    return Edge(axis, sign, plant, held, state, time, returned, far)


def _bisected(
    values: np.ndarray, good: np.ndarray, judge: Callable[[np.ndarray], np.ndarray], far: float
) -> tuple[float, float]:
    """The last good and the first bad value, between the first bad one of the scan and the good one before it."""
    if good.all():
        return far, np.inf
    first = int(np.argmin(good))
    low, high = (float(values[first - 1]) if first > 0 else 0.0), float(values[first])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if judge(np.array([middle]))[0] else (low, middle)
    return low, high
