"""How far from trim a linear policy works: many starts and dihedral commands, nonlinear and linear, and the report."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop
from controller.flight.envelope import Envelope, control_excesses
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.simulation import SummedLoop
from controller.policy.policies import Memoryless, Seen, gain_constants
from controller.riccati.balancing import spectrum
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, STATE_SCALES, STATE_UNITS, STATES
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, in_degrees, short_number, shown_unit
from trim.point.operating_point import OperatingPoint

MAP_SCHEMA = "hfa.recoverable-map/1"
#: Step of a flight, s: the fastest closed loop of the paper's weights (45 rad/s) is followed to 1e-5 of itself. And how
#: often it is asked whether the flight is lost.
STEP, TICK = 0.005, 1.0
#: Length of a flight in time constants of the slowest mode of the linear loop.
TIME_CONSTANTS = 8.0
#: A map holds at most this many points, about ten minutes of flights.
MOST_POINTS = 50_000
#: Flights along a ray before the bisection between the last that succeeds and the first that fails, and its halvings.
_SCAN, _HALVINGS = 24, 12
#: A flight is lost, and ends, this many envelope widths away or below this part of the slowest speed: seen never to
#: come back from there.
_LOST_WIDTHS, _LOST_SPEED = 100.0, 0.1
#: A flight is at rest on its target when each state is this close to it, as a fraction of its scale.
CLOSE = 0.01
PLANTS = ("nonlinear", "linear")
_N, _M = len(LINEAR_STATES), len(INPUTS)
_SPEED, _DIHEDRAL = STATES.index("speed"), STATES.index("dihedral")
_COMMANDED = LINEAR_STATES.index("dihedral")


class _CommandedGain(Memoryless):
    """u = -K (z - c): the gain K and a constant command c (6,) are constants of each flight."""

    constants_size = _M * _N + _N

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        return -ca.mtimes(ca.reshape(p[: _M * _N], _M, _N), seen.error - p[_M * _N :])


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What became of flights, arrays of any one shape.

    left: index into `STATES` of the state that left the envelope first, -1 when none did. when: s, inf when none did.
    exceeded: index into `INPUTS` of the input that went farthest beyond its control limits inside the envelope, -1
    when none did. final: (.., 7), the last deviation from trim; NaN when the flight was lost. settled: whether the
    rates of the six controlled states had died out at the end.
    """

    left: np.ndarray
    when: np.ndarray
    exceeded: np.ndarray
    final: np.ndarray
    settled: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """Which flights stayed inside the envelope."""
        return self.left < 0

    @property
    def within_limits(self) -> np.ndarray:
        """Which flights stayed inside the envelope and within the control limits."""
        return self.inside & (self.exceeded < 0)

    def arrived(self, dihedrals: np.ndarray) -> np.ndarray:
        """Which flights ended at rest nearer to their dihedral command, rad, than to trim.

        Feedback alone leaves an offset from a command; but rest at another equilibrium is no arrival.
        """
        off = np.abs(self.final[..., _DIHEDRAL] - dihedrals)
        return self.settled & (off <= np.maximum(np.abs(dihedrals) / 2, CLOSE * STATE_SCALES.dihedral))

    def returned(self) -> np.ndarray:
        """Which flights ended at rest within `CLOSE` of the trim, wherever they went in between."""
        error = np.abs(self.final[..., LINEAR_ROWS]) / np.array(STATE_SCALES)[LINEAR_ROWS]
        return self.settled & (error <= CLOSE).all(axis=-1)

    def of_starts(self) -> dict[str, np.ndarray]:
        """held: inside the envelope and back at trim; within_limits: within the control limits too; returned: back at
        trim; exceeded and left_first as above."""
        back = self.returned()
        return {
            "held": self.inside & back,
            "within_limits": self.within_limits & back,
            "exceeded": self.exceeded,
            "returned": back,
            "left_first": self.left,
        }


class ManyFlights:
    """A plant under u = -K (x - c), flown from many starts to many commands, wherever it goes."""

    def __init__(self, plant: NonlinearPlant | LinearizedAircraft, point: OperatingPoint, envelope: Envelope) -> None:
        loop = ClosedLoop(plant, _CommandedGain())
        each = round(TICK / STEP)
        self._loop = SummedLoop(loop, point, envelope, step=STEP, steps_per_tick=each, stops=False, compile_code=True)
        offsets = np.array(point.states)
        lowest, highest = np.array(envelope.lowest) - offsets, np.array(envelope.highest) - offsets
        self._far_below = lowest - _LOST_WIDTHS * (highest - lowest)
        self._far_above = highest + _LOST_WIDTHS * (highest - lowest)
        self._far_below[_SPEED] = _LOST_SPEED * envelope.lowest.speed - offsets[_SPEED]

    def fly(
        self,
        gain: np.ndarray,
        starts: np.ndarray,
        commands: np.ndarray,
        seconds: float,
        progress: Callable[[], None] | None = None,
    ) -> Outcomes:
        """Flights of `seconds` (rounded up to whole seconds).

        gain: K (5, 6). starts: (.., 7), deviations from trim. commands: (.., 6), deviations of `LINEAR_STATES`.
        progress: called after each flight.
        """
        shape = starts.shape[:-1]
        left, when, exceeded = np.full(shape, -1), np.full(shape, np.inf), np.full(shape, -1)
        final, settled = np.empty(starts.shape), np.zeros(shape, dtype=bool)
        p, rounded = np.append(gain_constants(gain), np.zeros(_N)), TICK * np.ceil(seconds / TICK - 1e-9)
        for index in np.ndindex(shape):
            p[-_N:] = commands[index]
            flown = self._loop.fly(starts[index], lambda _: p, rounded, self._lost)
            final[index] = np.nan if self._lost(flown.final) else flown.final
            if flown.left >= 0:
                left[index], when[index] = flown.left, flown.flown
            for excess in control_excesses(flown.lowest_input, flown.highest_input)[:1]:
                exceeded[index] = INPUTS.index(excess.input)
            rates = np.abs(self._loop.rate(final[index], p)[LINEAR_ROWS]) / np.array(STATE_SCALES)[LINEAR_ROWS]
            settled[index] = (rates <= CLOSE).all()
            if progress is not None:
                progress()
        return Outcomes(left, when, exceeded, final, settled)

    def _lost(self, x: np.ndarray) -> bool:
        return not bool(((x >= self._far_below) & (x <= self._far_above)).all())


class Edge(NamedTuple):
    """How far one can go along a ray from trim: what is varied and in which direction, and on which plant.

    inside: the largest deviation (ft/s or rad, absolute value) up to which every flight stays in the envelope. state:
    which one leaves it just beyond, and when, s. within_limits: up to where every flight also stays within the control
    limits, and `control` the input that exceeds its limit just beyond, "" where the envelope is left first. returned:
    up to where every flight comes to rest on its target, whether or not it left the envelope. reach: the end of the
    scanned range; a value that equals it met no failure, and `state` is then "".
    """

    axis: str
    sign: int
    plant: str
    inside: float
    state: str
    time: float
    within_limits: float
    control: str
    returned: float
    reach: float

    @property
    def unit(self) -> str:
        """Of the deviations."""
        return "ft/s" if self.axis == "speed" else "rad"


@dataclass(frozen=True, eq=False, repr=False)
class RecoverableMap(Reported):
    """Flights from a grid of initial deviations and to a line of dihedral commands, by both plants.

    speeds: (S,), ft/s; dihedrals: (D,), rad: deviations at the start; starts: of each of `PLANTS` the flights of all
    pairs, (D, S). commands: (C,), rad, steps of the dihedral command from trim; commanded: of each plant their flights.
    """

    dynamics: str
    point: OperatingPoint
    envelope: Envelope
    speeds: np.ndarray
    dihedrals: np.ndarray
    starts: dict[str, Outcomes]
    commands: np.ndarray
    commanded: dict[str, Outcomes]
    edges: tuple[Edge, ...]

    def report(self) -> Report:
        """See `map_report`."""
        return map_report((self,))


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
    flight lasts `TIME_CONSTANTS` of the slowest mode of A - B K. BadInputError when a list is empty or not finite, the
    map too large, or A - B K not Hurwitz.
    """
    for name, values in (("speeds", speeds), ("dihedrals", dihedrals), ("commands", commands)):
        if len(values) == 0 or not np.all(np.isfinite(values)):
            raise BadInputError(f"the map's {name} are empty or not finite; give numbers")
    if len(speeds) * len(dihedrals) > MOST_POINTS:
        raise BadInputError(f"the map has {len(speeds) * len(dihedrals)} points; at most {MOST_POINTS} are allowed")
    model = LinearizedAircraft.at(aircraft, point)
    abscissa = spectrum(model.A[np.ix_(LINEAR_ROWS, LINEAR_ROWS)] - model.B[LINEAR_ROWS] @ gain).abscissa
    if abscissa >= 0.0:
        raise BadInputError(f"A - B K has abscissa {abscissa:+.4g} 1/s; give a gain that stabilizes the linear model")
    grid = np.stack(np.meshgrid(speeds, dihedrals), axis=-1)
    seconds, total, done = TIME_CONSTANTS / -abscissa, 2 * (grid[..., 0].size + len(commands)), itertools.count(1)
    each_done = None if progress is None else lambda: progress(next(done), total)
    starts, commanded, edges = {}, {}, list[Edge]()
    plants: tuple[NonlinearPlant | LinearizedAircraft, ...] = NonlinearPlant(aircraft, point), model
    for name, plant in zip(PLANTS, plants, strict=True):
        flights = ManyFlights(plant, point, envelope)

        def from_starts(values: np.ndarray, states: list[int], *done: Any, flights: ManyFlights = flights) -> Outcomes:
            begin = np.zeros((*values.shape[:-1], len(STATES)))
            begin[..., states] = values
            return flights.fly(gain, begin, np.zeros((*values.shape[:-1], _N)), seconds, *done)

        def to_commands(values: np.ndarray, *done: Any, flights: ManyFlights = flights) -> Outcomes:
            orders = np.zeros((len(values), _N))
            orders[:, _COMMANDED] = values
            return flights.fly(gain, np.zeros((len(values), len(STATES))), orders, seconds, *done)

        starts[name] = from_starts(grid, [_SPEED, _DIHEDRAL], each_done)
        commanded[name] = to_commands(commands, each_done)
        for axis, values, fly in (
            ("speed", speeds, lambda v: from_starts(v[:, None], [_SPEED])),
            ("dihedral", dihedrals, lambda v: from_starts(v[:, None], [_DIHEDRAL])),
            ("dihedral command", commands, to_commands),
        ):
            far = float(np.abs(values).max())
            edges += [_edge(axis, sign, name, fly, far) for sign in (-1, 1) if far > 0.0]
    return RecoverableMap(
        aircraft.variant.name, point, envelope, speeds, dihedrals, starts, commands, commanded, tuple(edges)
    )


def _edge(axis: str, sign: int, plant: str, fly: Callable[[np.ndarray], Outcomes], far: float) -> Edge:
    def back(flown: Outcomes, values: np.ndarray) -> np.ndarray:
        return flown.arrived(values) if axis == "dihedral command" else flown.returned()

    values = sign * far * np.arange(1, _SCAN + 1) / _SCAN
    scan = fly(values)

    def bisected(good: Callable[[Outcomes, np.ndarray], np.ndarray]) -> tuple[float, Outcomes | None]:
        """The last good value, and the flight of the first bad one, None where all of the scan are good."""
        passed = good(scan, values)
        if passed.all():
            return far, None
        first = int(np.argmin(passed))
        low, high = (float(values[first - 1]) if first > 0 else 0.0), float(values[first])
        for _ in range(_HALVINGS):
            middle = np.array([(low + high) / 2])
            low, high = (float(middle[0]), high) if good(fly(middle), middle)[0] else (low, float(middle[0]))
        return abs(low), fly(np.array([high]))

    inside, left = bisected(lambda flown, _: flown.inside)
    limits, exceeded = bisected(lambda flown, _: flown.within_limits)
    state, time = ("", np.inf) if left is None else (STATES[left.left[0]], float(left.when[0]))
    control = "" if exceeded is None else (*INPUTS, "")[exceeded.exceeded[0]]
    return Edge(axis, sign, plant, inside, state, time, limits, control, bisected(back)[0], far)


def map_report(maps: tuple[RecoverableMap, ...], law: str = "") -> Report:
    """How far along each axis the policy works, nonlinear beside linear; maps: about the same dihedral.

    law: whose gain it is.
    """
    dihedral = in_degrees(maps[0].point.states.dihedral)
    limits = [
        (name, shown_unit(unit), maps[0].envelope.limits_text(index))
        for index, (name, unit) in enumerate(zip(STATES, STATE_UNITS, strict=True))
    ]
    return Report(
        title=f"How far from trim u = -K z works, dihedral {dihedral:g} deg" + (f", law {law}" if law else ""),
        parts=(*map(_edges, maps), ("envelope", Table(("state", "unit", "limits"), limits))),
        data={
            "schema": MAP_SCHEMA,
            "states": list(STATES),
            "inputs": list(INPUTS),
            "maps": {each.dynamics: _one_map(each) for each in maps},
        },
        records=_records(maps),
    )


def _edges(each: RecoverableMap) -> Part:
    parts: list[str | Table] = []
    header = ("from trim", "unit", "inside the envelope", "then leaves", "within control limits", "then exceeds")
    for plant in PLANTS:
        rows = [_edge_row(edge) for edge in each.edges if edge.plant == plant]
        parts.append(Table((*header, "comes back"), rows))
        found = each.starts[plant].of_starts()
        within, over = found["within_limits"], found["held"] & ~found["within_limits"]
        text = f"{plant}: of {within.size} starts {within.sum()} stayed within limits"
        if over.any():
            names, counts = np.unique(found["exceeded"][over], return_counts=True)
            listed = ", ".join(f"{INPUTS[name]} {n}" for name, n in zip(names, counts, strict=True))
            text += f", {over.sum()} stayed inside the envelope and exceeded control limits ({listed})"
        parts.append(f"{text}, {found['returned'].sum()} came back")
    return (f"{each.dynamics} dynamics", *parts)


def _edge_row(edge: Edge) -> tuple[str, ...]:
    inside, within, returned = (
        f"{'+' if edge.sign > 0 else '-'}{short_number(value, edge.unit)}" + " (all)" * (value == edge.reach)
        for value in (edge.inside, edge.within_limits, edge.returned)
    )
    leaving = f"{edge.state} at {edge.time:.3g} s" if edge.state else ""
    return edge.axis, shown_unit(edge.unit), inside, leaving, within, edge.control, returned


def _records(maps: tuple[RecoverableMap, ...]) -> Table:
    """One row a start and plant. held: whether it stayed inside the envelope and came back."""
    rows: list[tuple[Any, ...]] = []
    for each, plant in itertools.product(maps, PLANTS):
        found = {name: values.ravel().tolist() for name, values in each.starts[plant].of_starts().items()}
        grid = itertools.product(each.dihedrals.tolist(), each.speeds.tolist())
        rows += [
            (each.dynamics, plant, speed, dihedral, int(held), int(back), (*STATES, "")[left], int(within), over)
            for (dihedral, speed), held, within, over, back, left in zip(
                grid,
                found["held"],
                found["within_limits"],
                [(*INPUTS, "")[index] for index in found["exceeded"]],
                found["returned"],
                found["left_first"],
                strict=True,
            )
        ]
    of_a_start = ("dynamics", "plant", "speed [ft/s]", "dihedral [rad]", "held", "returned", "left_first")
    return Table((*of_a_start, "within_limits", "exceeded"), rows)


def _one_map(each: RecoverableMap) -> dict[str, Any]:
    """held: inside the envelope and back at trim."""
    data: dict[str, Any] = {
        "operating_point": each.point.to_dict(),
        "envelope": each.envelope.to_dict(),
        "speeds": each.speeds,
        "speed_units": "ft/s",
        "dihedrals": each.dihedrals,
        "commands": each.commands,
        "edges": [{**edge._asdict(), "held": edge.inside, "unit": edge.unit} for edge in each.edges],
    }
    for plant in PLANTS:
        commands = each.commanded[plant]
        data[plant] = each.starts[plant].of_starts() | {
            "commands_held": commands.inside,
            "commands_within_limits": commands.within_limits,
            "commands_exceeded": commands.exceeded,
            "commands_arrived": commands.arrived(each.commands),
            "commands_left_first": commands.left,
            "commands_reached": commands.final[:, _DIHEDRAL],
        }
    return data
