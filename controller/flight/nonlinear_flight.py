"""One flight of a nonlinear aircraft under a law, beside what the linear model predicts, and its
report."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant
from controller.flight.envelope import (
    ALPHA,
    ANGLE_OF_ATTACK,
    OVER_GROUND,
    ControlExcess,
    Departure,
    Envelope,
    LimitCycle,
    beyond_control_limits,
    control_excesses,
    flown_through_air,
    limit_cycle,
)
from controller.flight.gusts import UPDRAFT
from controller.flight.policies import FlownLaw
from controller.flight.scenario import Scenario, Uncertainty, with_errors
from controller.flight.signals import CommandSteps
from controller.flight.simulation import CompiledLoop, Flight
from controller.servo.servo_policy import MeasuredOutputs, ServoPolicy
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.point.operating_point import OperatingPoint, at_scheduled

FLIGHT_SCHEMA = "hfa.flight/1"

#: Note on a flight that stays at trim: whose deviations are at most so large, in the units of
#: states and inputs.
UNDISTURBED = "nothing disturbs this flight: give initial errors, a gust, turbulence, noise, a command or errors of parameters"
_STILL = 1e-6


def fly(
    aircraft: Model,
    point: OperatingPoint,
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    predict: bool = True,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """X' = f(X, U, w) + d with U = U0 + u of the law and, with `predict`, x' = A x + B u + E w + d
    of its linear model.

    The prediction is of the aircraft as designed: without the parameter errors. Both end at the
    first tick in which the nonlinear flight leaves the envelope. BadInputError when it does not
    begin inside, or part of the scenario is still to be drawn."""
    if scenario.uncertainty != Uncertainty():
        raise BadInputError(
            "part of the scenario is still to be drawn; simulate scenario.drawn(seed, member, point)"
        )
    scenario = scenario.on(aircraft)
    compiled = CompiledLoop(
        ClosedLoop(NonlinearPlant(with_errors(aircraft, scenario), point), law, scenario)
    )
    result = fly_within(compiled, envelope, progress=progress)
    envelope.refuse_start(result.flight.limited[:1] + np.array(point.states), scenario.moving_air)
    if not predict:
        return result
    linear = LinearPlant.at(aircraft, point, result.loop.wind_names)
    ticks = (len(result.flight.times) - 1) // scenario.steps_per_tick
    return replace(
        result, predicted=CompiledLoop(replace(result.loop, plant=linear)).fly(ticks=ticks)
    )


def fly_within(
    compiled: CompiledLoop,
    envelope: Envelope,
    scenario: Scenario | None = None,
    of_plant: np.ndarray | None = None,
    *,
    lost: Callable[[Flight], np.ndarray] | None = None,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """One flight of a loop about a trim, of its scenario or another (`CompiledLoop.fly`), without a
    prediction.

    It ends with the first tick outside the envelope or, with `lost`, at the first of the rows that
    are."""
    loop = compiled.loop if scenario is None else replace(compiled.loop, scenario=scenario)
    offsets = np.array(loop.plant.point.states)
    stop = lost or (lambda rows: envelope.outside(rows.limited + offsets))
    flight = compiled.fly(loop.scenario, of_plant=of_plant, stop=stop, progress=progress)
    departure = envelope.departure(flight.times, flight.limited + offsets, loop.scenario.moving_air)
    return NonlinearFlight(
        envelope, loop, flight, departure, limit_cycle(loop, flight) if departure is None else None
    )


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearFlight(Reported):
    """A flight, up to the first tick that left the envelope.

    loop: what was flown. flight: deviations from `point`. departure: which state left the envelope
    first, None when none did. cycle: what still oscillates at the end, None when nothing does.
    predicted: the same flight of the linear model, None when none was asked for."""

    envelope: Envelope
    loop: ClosedLoop
    flight: Flight
    departure: Departure | None
    cycle: LimitCycle | None
    predicted: Flight | None = None

    @property
    def point(self) -> OperatingPoint:
        """The trim in which it begins."""
        point: OperatingPoint = self.loop.plant.point
        return point

    @property
    def states(self) -> np.ndarray:
        """X, absolute, (N, n)."""
        return self.flight.states + np.array(self.point.states)

    @property
    def angles_of_attack(self) -> np.ndarray:
        """Alpha of the center of mass through the air, absolute, (N,), rad; alpha itself in still
        air."""
        alpha = list(self.point.model.states).index(ALPHA)
        return np.asarray(self.flight.limited[:, alpha] + self.point.states[alpha])

    @property
    def inputs(self) -> np.ndarray:
        """U, absolute, (N, m)."""
        return self.flight.inputs + np.array(self.point.inputs)

    @property
    def exceeded(self) -> tuple[ControlExcess, ...]:
        """The inputs that went beyond their control limits before the envelope was left, the
        farthest first."""
        until = np.inf if self.departure is None else self.departure.time
        return control_excesses(self.point.model, self.inputs[self.flight.times <= until])

    @property
    def within_limits(self) -> bool:
        """Whether every state stayed inside the envelope, every input within its limits, and no
        limit cycle is left."""
        return self.departure is None and not self.exceeded and self.cycle is None

    def title(self, law: str) -> str:
        """Which flight, and whether it stayed within its limits."""
        at = at_scheduled(self.point).removeprefix("at ")
        flight = f"Flight, {self.point.called}" + (f", {at}" if at else "") + law
        time, wrong = f"{self.flight.times[-1]:g} s", self.departure or self.cycle
        outcome = f"stayed within limits: {time} inside the envelope and the control limits"
        exceeded = [
            f"exceeded control limits: {', '.join(each.text() for each in self.exceeded)}"
        ] * bool(self.exceeded)
        if wrong is not None:
            outcome = wrong.text()
        elif exceeded:
            outcome = f"inside the envelope for {time}, but not within the control limits"
        return "\n".join([flight, outcome, *exceeded])

    def report(self) -> Report:
        """Outcome, states against the envelope and the linear prediction, inputs against the
        control limits.

        data: in the units of the model, without the flight itself, which is `history`; "held":
        whether the envelope was not left, and no limit cycle is left over."""
        model, flight, law = self.point.model, self.flight, self.loop.law
        moving = bool(flight.winds) and flown_through_air(model)
        largest = _by_name(model.states, np.abs(flight.states).max(axis=0))
        final = _by_name(model.states, self.states[-1])
        if flown_through_air(model):
            largest[ANGLE_OF_ATTACK] = float(
                np.abs(self.angles_of_attack - getattr(self.point.states, ALPHA)).max()
            )
            final[ANGLE_OF_ATTACK] = float(self.angles_of_attack[-1])
        late = flight.errors[len(flight.errors) // 2 :]
        data: dict[str, Any] = {
            "schema": FLIGHT_SCHEMA,
            "dynamics": self.point.dynamics,
            **names_and_units(model),
            "operating_point": self.point.to_dict(),
            "scenario": self.loop.scenario.to_dict(),
            "envelope": self.envelope.to_dict(bool(flight.winds)),
            "within_limits": self.within_limits,
            "held": self.departure is None and self.cycle is None,
            "departure": None if self.departure is None else self.departure._asdict(),
            "limit_cycle": None if self.cycle is None else self.cycle._asdict(),
            "exceeded": [each._asdict() for each in self.exceeded],
            "flown": float(flight.times[-1]),
            "final": final,
            "largest_deviation": largest,
            "rms_error": _by_name(model.linear, np.sqrt(np.mean(late**2, axis=0))),
            "share_beyond_control_limits": _by_name(
                model.inputs, beyond_control_limits(model, self.inputs).mean(axis=0)
            ),
            "checks": [],
            "policy": {"law": law.name},
        }
        if self.predicted is not None:
            off = np.abs(flight.states - self.predicted.states).max(axis=0)
            data["largest_difference_from_linear"] = _by_name(model.states, off)
        if len(law.gains):
            data["policy"] |= {"state_units": list(model.units(model.linear)), "K": law.gains[-1]}
        parts: list[Part] = [
            self._states(data, moving),
            *[OVER_GROUND] * moving,
            self._inputs(data),
        ]
        if isinstance(law.policy, ServoPolicy):
            rows, commanded = [], {}
            for each in tracked(flight, law.policy.regulated, law.policy.commands):
                commanded[each.name] = {
                    "rms_error": each.rms,
                    "largest_error": each.largest,
                    "unit": each.unit,
                }
                errors = (short_number(error, each.unit) for error in (each.rms, each.largest))
                rows.append((each.name, shown_unit(each.unit), *errors))
            data["commanded"] = commanded
            parts[:0] = [
                Table(("commanded output", "unit", "rms error", "largest error"), rows)
            ] * bool(rows)
        still = max(np.abs(flight.states).max(), np.abs(flight.inputs).max()) <= _STILL
        title = self.title(f", law {law.name}{', frozen' * bool(len(law.gains))}")
        return Report(title, parts, [UNDISTURBED] * bool(still), data, self._records())

    def _states(self, data: dict[str, Any], moving: bool) -> Table:
        """Of each state, and where the air moves of alpha through it, what the data have; the
        limits beside."""
        model, rows = self.point.model, []
        differences = data.get("largest_difference_from_linear")
        for index, name in enumerate(model.states):
            unit, limits = model.unit(name), self.envelope.limits_text(index)
            through_air = name == ALPHA and moving
            for what in (name, ANGLE_OF_ATTACK)[: 1 + through_air]:
                deviations = (
                    data["largest_deviation"][what],
                    data["final"][what] - self.point.states[index],
                )
                cells = [
                    what,
                    shown_unit(unit),
                    *(short_number(value, unit) for value in deviations),
                ]
                cells += [
                    short_number(data["rms_error"][what], unit) if what in model.linear else ""
                ]
                cells += ["" if through_air and what == name else limits]
                if differences is not None:
                    cells += [short_number(differences[what], unit) if what in differences else ""]
                rows.append(tuple(cells))
        deviated = ("largest deviation", "final deviation", "rms error, 2nd half")
        return Table(
            ("state", "unit", *deviated, "envelope", "off the linear model")[: len(rows[0])], rows
        )

    def _inputs(self, data: dict[str, Any]) -> Table:
        rows = []
        for index, (name, share) in enumerate(data["share_beyond_control_limits"].items()):
            unit, column = self.point.model.unit(name), self.inputs[:, index]
            ends = (short_number(each, unit) for each in (column.min(), column.max()))
            rows.append((name, shown_unit(unit), *ends, f"{100 * share:.3g} %"))
        return Table(("input", "unit", "lowest", "highest", "time beyond control limits"), rows)

    def history(self) -> dict[str, Any]:
        """Once a tick: times (N,), states (N, n), inputs (N, m), angles of attack, all absolute;
        errors, updrafts."""
        every = slice(None, None, self.loop.scenario.steps_per_tick)
        of_flight = {
            name: getattr(self.flight, name)[every] for name in ("times", "errors", "updrafts")
        }
        names = (
            "states",
            "inputs",
            *(("angles_of_attack",) if flown_through_air(self.point.model) else ()),
        )
        absolute = {name: getattr(self, name)[every] for name in names}
        return {"history": of_flight | absolute}

    def _records(self) -> Table:
        """The history, one row a tick, each column with its unit: an array, because a flight may be
        long."""
        flown, model = self.history()["history"], self.point.model
        units = {"time": "s"} | {name: model.unit(name) for name in (*model.states, *model.inputs)}
        columns = [flown[name] for name in ("times", "states", "inputs")]
        if UPDRAFT in model.disturbances:
            units[UPDRAFT] = model.unit(UPDRAFT)
            columns.append(flown["updrafts"])
        if flown_through_air(model):
            units[ANGLE_OF_ATTACK] = model.unit(ALPHA)
            columns.append(flown["angles_of_attack"])
        rows: Any = np.column_stack(columns)
        return Table(tuple(f"{name} [{unit}]" for name, unit in units.items()), rows)


def _by_name(names: Iterable[str], values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def names_and_units(model: Model) -> dict[str, list[str]]:
    """What data about all states and inputs says of them."""
    return {
        "states": list(model.states),
        "state_units": list(model.units(tuple(model.states))),
        "inputs": list(model.inputs),
        "input_units": list(model.units(tuple(model.inputs))),
    }


class Tracked(NamedTuple):
    """An output and its command, (N,) each as deviations from trim; root mean square and largest of
    their difference.

    Of the whole flight, in the output's unit.
    """

    name: str
    output: np.ndarray
    command: np.ndarray
    unit: str
    rms: float
    largest: float


def tracked(flight: Flight, outputs: MeasuredOutputs, commands: CommandSteps) -> list[Tracked]:
    """Each commanded output of a flight beside its command, without the noise of the sensors."""
    model, found = outputs.model, []
    rows = [list(model.states).index(name) for name in model.linear]
    z, r = (
        flight.states[:, rows] @ outputs.C.T + flight.inputs @ outputs.D.T,
        commands.sampled(flight.times),
    )
    if outputs.F.size:
        z += flight.updrafts[:, None] @ outputs.F.T
    for name, output, command in zip(commands.names, z.T, r.T, strict=True):
        off = np.abs(output - command)
        errors = float(np.sqrt(np.mean(off**2))), float(off.max())
        found.append(Tracked(name, output, command, model.unit(model.part(name)[0]), *errors))
    return found
