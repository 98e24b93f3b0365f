"""One flight of a nonlinear aircraft under a policy, beside what the linear model predicts, and its report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.flight.closed_loop import ClosedLoop
from controller.flight.envelope import (
    ALPHA,
    ANGLE_OF_ATTACK,
    OVER_GROUND,
    ControlExcess,
    Departure,
    Envelope,
    beyond_control_limits,
    control_excesses,
    flown_through_air,
)
from controller.flight.limit_cycle import LimitCycle, limit_cycle
from controller.flight.plants import UPDRAFT, LinearPlant, NonlinearPlant
from controller.flight.scenario import Scenario, Uncertainty, with_errors
from controller.flight.simulation import CompiledLoop, Flight
from controller.policy.policies import FlownLaw, OpenLoop
from controller.policy.servo_policy import MeasuredOutputs, ServoPolicy
from controller.policy.signals import CommandSteps
from hfa_support.errors import BadInputError
from hfa_support.model import HasModel, Model
from hfa_support.progress import Progress
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.point.operating_point import OperatingPoint, at_scheduled

FLIGHT_SCHEMA = "hfa.flight/1"

#: Note on a flight that stays at trim: whose deviations are at most so large, in the units of states and inputs.
UNDISTURBED = (
    "nothing disturbs this flight: give initial errors, a gust, turbulence, noise, a command or errors of parameters"
)
_STILL = 1e-6


def fly(
    aircraft: HasModel,
    point: OperatingPoint,
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """X' = f(X, U, w) + d with U = U0 + u of the law, and its linear prediction x' = A x + B u + E w + d.

    The prediction is of the aircraft as designed: without the parameter errors. Both end at the first tick in
    which the nonlinear flight leaves the envelope.
    """
    scenario = scenario.on(aircraft.model)
    result = fly_law(NonlinearPlant(with_errors(aircraft, scenario), point), law, scenario, envelope, progress=progress)
    model = LinearPlant.at(aircraft, point, result.loop.wind_names)
    predicted = CompiledLoop(replace(result.loop, plant=model), law.fastest)
    ticks = (len(result.flight.times) - 1) // scenario.steps_per_tick
    flight = predicted.fly(scenario.initial, law.constants, memory=law.memory, ticks=ticks)
    return replace(result, predicted=flight)


def fly_law(
    plant: NonlinearPlant,
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """The nonlinear aircraft under a law, without a prediction.

    BadInputError when it does not begin inside the envelope, or part of the scenario is still to be drawn.
    """
    if scenario.uncertainty != Uncertainty():
        raise BadInputError("part of the scenario is still to be drawn; simulate scenario.drawn(seed, member, point)")
    scenario, offsets = scenario.on(plant.model), np.array(plant.point.states)
    loop = ClosedLoop(plant, law.policy, scenario, np.array(plant.point.inputs))
    compiled = CompiledLoop(loop, law.fastest)
    start = next(compiled.blocks(loop.start(scenario.initial, law.memory), loop.constants(law.constants), 0))
    envelope.refuse_start(start.limited + offsets, scenario.moving_air)
    flight = compiled.fly(
        scenario.initial,
        law.constants,
        memory=law.memory,
        stop=lambda rows: envelope.outside(rows.limited + offsets),
        progress=progress,
    )
    departure = envelope.departure(flight.times, flight.limited + offsets, scenario.moving_air)
    loose = departure is not None or isinstance(law.policy, OpenLoop)
    cycle = None if loose else limit_cycle(plant.model, scenario, flight)
    return NonlinearFlight(scenario, plant.point, envelope, loop, flight, None, departure, cycle)


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearFlight(Reported):
    """A flight, up to the first tick that left the envelope.

    loop: what was flown. flight: of the nonlinear aircraft, deviations from `point`. predicted: the same of its linear
    model, None when none was asked for. departure: which state left the envelope first, None when none did. cycle: what
    still oscillates at the end, None when nothing does.
    """

    scenario: Scenario
    point: OperatingPoint
    envelope: Envelope
    loop: ClosedLoop
    flight: Flight
    predicted: Flight | None
    departure: Departure | None
    cycle: LimitCycle | None = None

    @property
    def states(self) -> np.ndarray:
        """X, absolute, (N, n)."""
        return self.flight.states + np.array(self.point.states)

    @property
    def angles_of_attack(self) -> np.ndarray:
        """Alpha of the center of mass through the air, absolute, (N,), rad; alpha itself in still air."""
        alpha = list(self.point.model.states).index(ALPHA)
        return np.asarray(self.flight.limited[:, alpha] + self.point.states[alpha])

    @property
    def inputs(self) -> np.ndarray:
        """U, absolute, (N, m)."""
        return self.flight.inputs + np.array(self.point.inputs)

    @property
    def exceeded(self) -> tuple[ControlExcess, ...]:
        """The inputs that went beyond their control limits before the envelope was left, the farthest first."""
        until = np.inf if self.departure is None else self.departure.time
        inside = self.inputs[self.flight.times <= until]
        return control_excesses(self.point.model, inside.min(axis=0), inside.max(axis=0))

    @property
    def within_limits(self) -> bool:
        """Whether every state stayed inside the envelope, every input within its limits, and no limit cycle is left."""
        return self.departure is None and not self.exceeded and self.cycle is None

    def title(self, law: str) -> str:
        """Which flight, and whether it stayed within its limits."""
        at = at_scheduled(self.point).removeprefix("at ")
        flight = f"Flight, {self.point.called}" + (f", {at}" if at else "") + law
        time, lines = f"{self.flight.times[-1]:g} s", []
        if self.departure is not None:
            lines.append(self.departure.text())
        elif self.cycle is not None:
            lines.append(self.cycle.text())
        elif self.exceeded:
            lines.append(f"inside the envelope for {time}, but not within the control limits")
        else:
            lines.append(f"stayed within limits: {time} inside the envelope and the control limits")
        if self.exceeded:
            lines.append(f"exceeded control limits: {', '.join(each.text() for each in self.exceeded)}")
        return "\n".join([flight, *lines])

    def report(self, law: FlownLaw | None = None) -> Report:
        """Outcome, states against the envelope and the linear prediction, inputs against the control limits.

        law: what was flown, for the title and the data. data: in the units of the model, without the flight itself,
        which is `history`; "held": whether the envelope was not left, and no limit cycle is left over.
        """
        model, flight, trim = self.point.model, self.flight, self.point.states
        moving = bool(flight.winds) and flown_through_air(model)
        largest = dict(zip(model.states, np.abs(flight.states).max(axis=0).tolist(), strict=True))
        final = dict(zip(model.states, self.states[-1].tolist(), strict=True))
        if flown_through_air(model):
            largest[ANGLE_OF_ATTACK] = float(np.abs(self.angles_of_attack - getattr(trim, ALPHA)).max())
            final[ANGLE_OF_ATTACK] = float(self.angles_of_attack[-1])
        late = flight.errors[len(flight.errors) // 2 :]
        data: dict[str, Any] = {
            "schema": FLIGHT_SCHEMA,
            "dynamics": self.point.dynamics,
            **names_and_units(model),
            "operating_point": self.point.to_dict(),
            "scenario": self.scenario.to_dict(),
            "envelope": self.envelope.to_dict(bool(flight.winds)),
            "within_limits": self.within_limits,
            "held": self.departure is None and self.cycle is None,
            "departure": None if self.departure is None else self.departure._asdict(),
            "limit_cycle": None if self.cycle is None else self.cycle._asdict(),
            "exceeded": [each._asdict() for each in self.exceeded],
            "flown": float(flight.times[-1]),
            "final": final,
            "largest_deviation": largest,
            "rms_error": dict(zip(model.linear, np.sqrt(np.mean(late**2, axis=0)).tolist(), strict=True)),
            "share_beyond_control_limits": dict(
                zip(model.inputs, beyond_control_limits(model, self.inputs).mean(axis=0).tolist(), strict=True)
            ),
            "checks": [],
        }
        if self.predicted is not None:
            count = min(len(flight.times), len(self.predicted.times))
            off = np.abs(flight.states[:count] - self.predicted.states[:count]).max(axis=0)
            data["largest_difference_from_linear"] = dict(zip(model.states, off.tolist(), strict=True))
        followed: tuple[Tracked, ...] = ()
        if law is not None:
            data["policy"] = {"law": law.name}
            if len(law.gains):
                data["policy"] |= {"state_units": list(model.units(model.linear)), "K": law.gains[-1]}
            if isinstance(law.policy, ServoPolicy) and isinstance(law.policy.commands, CommandSteps):
                followed = tracked(flight, law.policy.regulated, law.policy.commands)
                data["commanded"] = {
                    each.name: {"rms_error": each.rms, "largest_error": each.largest, "unit": each.unit}
                    for each in followed
                }
        words = "" if law is None else f", law {law.name}{', frozen' * bool(len(law.gains))}"
        parts: list[Part] = [self._states(data, moving), *[OVER_GROUND] * moving, self._inputs(data)]
        if followed:
            rows = [
                (each.name, shown_unit(each.unit), *(short_number(x, each.unit) for x in (each.rms, each.largest)))
                for each in followed
            ]
            parts.insert(0, Table(("commanded output", "unit", "rms error", "largest error"), rows))
        still = max(np.abs(flight.states).max(), np.abs(flight.inputs).max()) <= _STILL
        return Report(self.title(words), parts, [UNDISTURBED] * bool(still), data, self._records())

    def _states(self, data: dict[str, Any], moving: bool) -> Table:
        """Of each state, and where the air moves of alpha through it, what the data have; the limits beside."""
        model, rows = self.point.model, []
        differences = data.get("largest_difference_from_linear")
        for index, name in enumerate(model.states):
            unit, limits = model.unit(name), self.envelope.limits_text(index)
            through_air = name == ALPHA and moving
            for what in (name, ANGLE_OF_ATTACK)[: 1 + through_air]:
                deviations = data["largest_deviation"][what], data["final"][what] - self.point.states[index]
                cells = [what, shown_unit(unit), *(short_number(value, unit) for value in deviations)]
                cells += [short_number(data["rms_error"][what], unit) if what in model.linear else ""]
                cells += ["" if through_air and what == name else limits]
                if differences is not None:
                    cells += [short_number(differences[what], unit) if what in differences else ""]
                rows.append(tuple(cells))
        deviated = ("largest deviation", "final deviation", "rms error, 2nd half")
        return Table(("state", "unit", *deviated, "envelope", "off the linear model")[: len(rows[0])], rows)

    def _inputs(self, data: dict[str, Any]) -> Table:
        rows = []
        for index, (name, share) in enumerate(data["share_beyond_control_limits"].items()):
            unit, column = self.point.model.unit(name), self.inputs[:, index]
            ends = (short_number(each, unit) for each in (column.min(), column.max()))
            rows.append((name, shown_unit(unit), *ends, f"{100 * share:.3g} %"))
        return Table(("input", "unit", "lowest", "highest", "time beyond control limits"), rows)

    def history(self) -> dict[str, Any]:
        """Once a tick: times (N,), states (N, n), inputs (N, m), angles of attack, all absolute; errors, updrafts."""
        every = slice(None, None, self.scenario.steps_per_tick)
        of_flight = {name: getattr(self.flight, name)[every] for name in ("times", "errors", "updrafts")}
        names = ("states", "inputs", *(("angles_of_attack",) if flown_through_air(self.point.model) else ()))
        absolute = {name: getattr(self, name)[every] for name in names}
        return {"history": of_flight | absolute}

    def _records(self) -> Table:
        """The history, one row a tick, each column with its unit: an array, because a flight may be long."""
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


def names_and_units(model: Model) -> dict[str, list[str]]:
    """What data about all states and inputs says of them."""
    return {
        "states": list(model.states),
        "state_units": list(model.units(tuple(model.states))),
        "inputs": list(model.inputs),
        "input_units": list(model.units(tuple(model.inputs))),
    }


class Tracked(NamedTuple):
    """An output and its command, (N,) each as deviations from trim; root mean square and largest of their difference.

    Of the whole flight, in the output's unit.
    """

    name: str
    output: np.ndarray
    command: np.ndarray
    unit: str

    @property
    def rms(self) -> float:
        """sqrt(mean (z - r)²)."""
        return float(np.sqrt(np.mean((self.output - self.command) ** 2)))

    @property
    def largest(self) -> float:
        """max |z - r|."""
        return float(np.abs(self.output - self.command).max())


def tracked(flight: Flight, outputs: MeasuredOutputs, commands: CommandSteps) -> tuple[Tracked, ...]:
    """Each commanded output of a flight beside its command, without the noise of the sensors."""
    model = outputs.model
    rows = [list(model.states).index(name) for name in model.linear]
    z = flight.states[:, rows] @ outputs.C.T + flight.inputs @ outputs.D.T
    if outputs.F.size:
        z += flight.updrafts[:, None] @ outputs.F.T
    units = model.units([model.part(name)[0] for name in commands.names])
    return tuple(map(Tracked, commands.names, z.T, commands.sampled(flight.times).T, units))
