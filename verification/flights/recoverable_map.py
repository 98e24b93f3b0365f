"""How far from trim a linear policy works: many starts and commands, nonlinear and linear, and the
report."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from controller.flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant, Plant
from controller.flight.envelope import Envelope
from controller.flight.nonlinear_flight import fly_within
from controller.flight.policies import gain_law
from controller.flight.scenario import Scenario
from controller.flight.simulation import CompiledLoop, Flight
from controller.riccati.balancing import spectrum
from hfa_aircraft.model import HasModel, Model
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.progress import Progress, told
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.point.operating_point import OperatingPoint, at_scheduled

MAP_SCHEMA = "hfa.recoverable-map/1"
#: Step of a flight, s: the fastest closed loop of the paper's weights (45 rad/s) is followed to
#: 1e-5 of itself. And how often it is asked whether the flight is lost.
STEP, TICK = 0.005, 1.0
#: Length of a flight in time constants of the slowest mode of the linear loop.
TIME_CONSTANTS = 8.0
#: A map holds at most this many points, about ten minutes of flights.
MOST_POINTS = 50_000
#: Flights along a ray before the bisection between the last that succeeds and the first that fails,
#: and its halvings.
_SCAN, _HALVINGS = 24, 12
#: A flight is lost, and ends, this many envelope widths away or below this part of the slowest
#: speed: seen never to come back from there.
_LOST_WIDTHS, _LOST_SPEED = 100.0, 0.1
#: A flight is at rest on its target when each state is this close to it, as a fraction of its
#: scale.
CLOSE = 0.01
PLANTS = ("nonlinear", "linear")


class Outcome(NamedTuple):
    """What became of a flight.

    left: index of the state that left the envelope first, -1 when none did. when: s, inf when none
    did. exceeded: index of the input that went farthest beyond its control limits inside the
    envelope, -1 when none did. returned: whether it ended at rest on its target, wherever it went
    in between."""

    left: int
    when: float
    exceeded: int
    returned: bool


class ManyFlights:
    """A plant under u = -K (x - c), flown for a time from many starts to many commands, wherever it
    goes."""

    def __init__(self, plant: Plant, envelope: Envelope, gain: np.ndarray, seconds: float) -> None:
        model, offsets = envelope.model, np.array(plant.point.states)
        rounded = float(TICK * np.ceil(seconds / TICK - 1e-9))
        self.model, self._envelope, self._scenario = model, envelope, Scenario(rounded, STEP, TICK)
        loop = ClosedLoop(plant, gain_law("map", gain), self._scenario_of({}, {}))
        self._compiled = CompiledLoop(loop, MOST_POINTS)
        lowest, highest = np.array(envelope.lowest) - offsets, np.array(envelope.highest) - offsets
        self._far_below = lowest - _LOST_WIDTHS * (highest - lowest)
        self._far_above = highest + _LOST_WIDTHS * (highest - lowest)
        if "speed" in model.states:
            speed = list(model.states).index("speed")
            self._far_below[speed] = _LOST_SPEED * envelope.lowest.speed - offsets[speed]

    def fly(self, start: Mapping[str, float], command: Mapping[str, float]) -> Outcome:
        """One flight. start, command: state -> deviation."""
        model, scenario = self.model, self._scenario_of(start, command)
        result = fly_within(self._compiled, self._envelope, scenario, lost=self._lost)
        gone, end = result.departure, result.flight.states[-1]
        left, when = (
            (-1, np.inf) if gone is None else (list(model.states).index(gone.state), gone.time)
        )
        exceeded = list(model.inputs).index(result.exceeded[0].input) if result.exceeded else -1
        still = not self._is_far(end) and self._rests(end, scenario)
        return Outcome(left, when, exceeded, still and on_target(model, end, command))

    def _scenario_of(self, start: Mapping[str, float], command: Mapping[str, float]) -> Scenario:
        """A command is an offset of what is measured, which no flight needs to compile."""
        model = self.model
        initial = np.array([start.get(name, 0.0) for name in model.states])
        offset = [-command.get(name, 0.0) for name in model.linear]
        return replace(
            self._scenario, initial=initial, samples=np.tile(offset, (self._scenario.ticks, 1))
        )

    def _rests(self, x: np.ndarray, scenario: Scenario) -> bool:
        """Whether the rates of the controlled states have died out."""
        loop, states = (
            replace(self._compiled.loop, scenario=replace(scenario, initial=x)),
            self.model.states,
        )
        rates = np.array(self._compiled.rate(0.0, loop.start(), loop.constants()(0))).ravel()
        small = {
            name: abs(rate) <= CLOSE * states[name].nominal
            for name, rate in zip(states, rates, strict=True)
        }
        return all(small[name] for name in self.model.linear)

    def _lost(self, rows: Flight) -> np.ndarray:
        """Asked once a tick."""
        found, each = np.zeros(len(rows.times), dtype=bool), self._scenario.steps_per_tick
        found[::each] = self._is_far(rows.states[::each])
        return found

    def _is_far(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(~((x >= self._far_below) & (x <= self._far_above)).all(axis=-1))


def on_target(model: Model, x: np.ndarray, command: Mapping[str, float]) -> bool:
    """Whether deviations (n,) are within `CLOSE` of the trim; with a command nearer to it than to
    the trim.

    Feedback alone leaves an offset from a command; but rest at another equilibrium is no arrival.
    """
    at = dict(zip(model.states, x.tolist(), strict=True))
    if command:
        limits = {
            name: max(abs(each) / 2, CLOSE * model.states[name].nominal)
            for name, each in command.items()
        }
        return all(abs(at[name] - command[name]) <= limit for name, limit in limits.items())
    return all(abs(at[name]) <= CLOSE * model.states[name].nominal for name in model.linear)


class Edge(NamedTuple):
    """How far one can go along a ray from trim: the varied quantity, its direction, and the plant.

    inside: the largest deviation (absolute value, in `unit`) up to which every flight stays in the
    envelope. state: which one leaves it just beyond, and when, s. within_limits: up to where every
    flight also stays within the control limits, and `control` the input that exceeds its limit just
    beyond, "" where the envelope is left first. returned: up to where every flight comes to rest on
    its target, whether or not it left the envelope. reach: the end of the scanned range; a value
    that equals it met no failure, and `state` is then ""."""

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
    unit: str


@dataclass(frozen=True, eq=False, repr=False)
class RecoverableMap(Reported):
    """Flights from a grid of initial deviations, and how far one can go along axes and commands, by
    both plants.

    axes: the two states that start off trim -> their deviations, (S,) and (D,); starts: of each of
    `PLANTS` what became of all pairs, arrays (D, S): those of `Outcome`; held: inside the envelope
    and back at trim; within_limits: within the control limits too. commands: the state that is
    commanded -> the steps from trim that were asked for."""

    point: OperatingPoint
    envelope: Envelope
    axes: dict[str, np.ndarray]
    starts: dict[str, dict[str, np.ndarray]]
    commands: dict[str, np.ndarray]
    edges: tuple[Edge, ...]

    def report(self) -> Report:
        """See `map_report`."""
        return map_report((self,))


def recoverable_map(
    aircraft: HasModel,
    point: OperatingPoint,
    gain: np.ndarray,
    envelope: Envelope,
    *,
    starts: Mapping[str, np.ndarray],
    commands: Mapping[str, np.ndarray],
    progress: Progress | None = None,
) -> RecoverableMap:
    """Fly u = -K z from every start on the nonlinear aircraft and on its linear model, and find the
    edges.

    gain: K (m, k). starts: two states -> deviations at the start, whose pairs are flown. commands:
    one state of the linear model -> steps from trim, of which the largest says how far the edges
    are looked for. A flight lasts `TIME_CONSTANTS` of the slowest mode of A - B K. BadInputError
    when a list is empty or not finite, the map too large, a name unknown or A - B K not Hurwitz.
    """
    model = aircraft.model
    if len(starts) != 2 or len(commands) != 1:
        raise BadInputError(
            "a map shows two states and one command: name two with --initial and one with --command"
        )
    for of, names in ((starts, tuple(model.states)), (commands, model.linear)):
        for name, values in of.items():
            refuse_unknown("the map has no state", name, names)
            if len(values) == 0 or not np.all(np.isfinite(values)):
                raise BadInputError(f"the map's {name} are empty or not finite; give numbers")
    across, down = starts.values()
    grid = [dict(zip(starts, (x, y), strict=True)) for y in down.tolist() for x in across.tolist()]
    if len(grid) > MOST_POINTS:
        raise BadInputError(f"the map has {len(grid)} points; at most {MOST_POINTS} are allowed")
    linear = LinearPlant.at(aircraft, point)
    rows = [list(model.states).index(name) for name in model.linear]
    abscissa = spectrum(linear.A[np.ix_(rows, rows)] - linear.B[rows] @ gain).abscissa
    if abscissa >= 0.0:
        raise BadInputError(
            f"A - B K has abscissa {abscissa:+.4g} 1/s; give a gain that stabilizes the linear model"
        )
    found, edges = dict[str, dict[str, np.ndarray]](), list[Edge]()
    plants: tuple[Plant, ...] = NonlinearPlant(aircraft, point), linear
    for name, plant in zip(PLANTS, plants, strict=True):
        flights = ManyFlights(plant, envelope, gain, TIME_CONSTANTS / -abscissa)
        outcomes = [flights.fly(start, {}) for start in told(grid, progress)]
        found[name] = _starts(outcomes, (len(down), len(across)))
        for is_command, rays in ((False, starts), (True, commands)):
            for state, values in rays.items():
                far = float(np.abs(values).max())
                edges += [
                    _edge(flights, name, state, is_command, sign * far)
                    for sign in (-1, 1)
                    if far > 0.0
                ]
    return RecoverableMap(point, envelope, dict(starts), found, dict(commands), tuple(edges))


def _starts(outcomes: list[Outcome], shape: tuple[int, int]) -> dict[str, np.ndarray]:
    left, _, exceeded, returned = (
        np.array(each).reshape(shape) for each in zip(*outcomes, strict=True)
    )
    held = (left < 0) & returned
    within = held & (exceeded < 0)
    return {
        "held": held,
        "within_limits": within,
        "exceeded": exceeded,
        "returned": returned,
        "left_first": left,
    }


def _edge(flights: ManyFlights, plant: str, state: str, is_command: bool, reach: float) -> Edge:
    """reach: the end of the scanned range, signed."""
    model, values = flights.model, (reach * np.arange(1, _SCAN + 1) / _SCAN).tolist()

    @cache
    def flown(deviation: float) -> Outcome:
        there = {state: deviation}
        return flights.fly({}, there) if is_command else flights.fly(there, {})

    def bisected(good: Callable[[Outcome], bool]) -> tuple[float, Outcome | None]:
        """The last good deviation, and the flight of the first bad one, None where all of the scan
        are good."""
        first = next((place for place, each in enumerate(values) if not good(flown(each))), None)
        if first is None:
            return abs(reach), None
        low, high = (values[first - 1] if first else 0.0), values[first]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if good(flown(middle)) else (low, middle)
        return abs(low), flown(high)

    inside, left = bisected(lambda flown: flown.left < 0)
    within, exceeded = bisected(lambda flown: flown.left < 0 and flown.exceeded < 0)
    returned, _ = bisected(lambda flown: flown.returned)
    leaving, time = ("", np.inf) if left is None else ((*model.states,)[left.left], left.when)
    control = "" if exceeded is None else (*model.inputs, "")[exceeded.exceeded]
    axis, sign, unit = state + " command" * is_command, int(np.sign(reach)), model.unit(state)
    return Edge(
        axis, sign, plant, inside, leaving, time, within, control, returned, abs(reach), unit
    )


def map_report(maps: tuple[RecoverableMap, ...], law: str = "") -> Report:
    """How far along each axis the policy works, nonlinear beside linear; maps: of one aircraft
    about the same trim.

    law: whose gain it is.
    """
    first = maps[0]
    model, at = first.envelope.model, at_scheduled(first.point).removeprefix("at ")
    limits = [
        (name, shown_unit(model.unit(name)), first.envelope.limits_text(index))
        for index, name in enumerate(model.states)
    ]
    data = {"schema": MAP_SCHEMA, "states": list(model.states), "inputs": list(model.inputs)}
    return Report(
        title="How far from trim u = -K z works"
        + (f", {at}" if at else "")
        + (f", law {law}" if law else ""),
        parts=(*map(_tables, maps), ("envelope", Table(("state", "unit", "limits"), limits))),
        data=data | {"maps": {each.point.dynamics: _data(each) for each in maps}},
        records=_records(maps),
    )


def _tables(each: RecoverableMap) -> Part:
    parts: list[str | Table] = []
    header = (
        "from trim",
        "unit",
        "inside the envelope",
        "then leaves",
        "within control limits",
        "then exceeds",
    )
    inputs = tuple(each.envelope.model.inputs)
    for plant in PLANTS:
        rows = []
        for edge in (one for one in each.edges if one.plant == plant):
            inside, within, returned = (
                f"{'+' if edge.sign > 0 else '-'}{short_number(value, edge.unit)}"
                + " (all)" * (value == edge.reach)
                for value in (edge.inside, edge.within_limits, edge.returned)
            )
            leaving = f"{edge.state} at {edge.time:.3g} s" if edge.state else ""
            rows.append(
                (edge.axis, shown_unit(edge.unit), inside, leaving, within, edge.control, returned)
            )
        parts.append(Table((*header, "comes back"), rows))
        found = each.starts[plant]
        within_limits, over = found["within_limits"], found["held"] & ~found["within_limits"]
        text = f"{plant}: of {over.size} starts {within_limits.sum()} stayed within limits"
        if over.any():
            names, counts = np.unique(found["exceeded"][over], return_counts=True)
            listed = ", ".join(f"{inputs[name]} {n}" for name, n in zip(names, counts, strict=True))
            text += (
                f", {over.sum()} stayed inside the envelope and exceeded control limits ({listed})"
            )
        parts.append(f"{text}, {found['returned'].sum()} came back")
    return (each.point.called, *parts)


def _records(maps: tuple[RecoverableMap, ...]) -> Table:
    """One row a start and plant. held: whether it stayed inside the envelope and came back."""
    model, names = (
        maps[0].envelope.model,
        ("held", "returned", "left_first", "within_limits", "exceeded"),
    )
    words = {"left_first": (*model.states, ""), "exceeded": (*model.inputs, "")}
    rows: list[tuple[Any, ...]] = []
    for each, plant in itertools.product(maps, PLANTS):
        found = each.starts[plant]
        across, down = np.meshgrid(*each.axes.values())
        for place in np.ndindex(across.shape):
            cells = (int(found[name][place]) for name in names)
            shown = (
                words[name][cell] if name in words else cell
                for name, cell in zip(names, cells, strict=True)
            )
            rows.append(
                (each.point.dynamics, plant, float(across[place]), float(down[place]), *shown)
            )
    axes = [f"{name} [{model.unit(name)}]" for name in maps[0].axes]
    return Table(("dynamics", "plant", *axes, *names), rows)


def _data(each: RecoverableMap) -> dict[str, Any]:
    """held: inside the envelope and back at trim. The arrays of starts have the names of the
    states."""
    model, (commanded, steps) = each.envelope.model, next(iter(each.commands.items()))
    return {
        "operating_point": each.point.to_dict(),
        "envelope": each.envelope.to_dict(),
        **{f"{name}s": values for name, values in each.axes.items()},
        **{f"{name}_units": model.unit(name) for name in each.axes},
        "commands": steps,
        "command_units": model.unit(commanded),
        "edges": [{**edge._asdict(), "held": edge.inside} for edge in each.edges],
        **each.starts,
    }
