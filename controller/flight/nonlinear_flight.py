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
from controller.flight.plants import UPDRAFT, LinearizedAircraft, NonlinearPlant
from controller.flight.scenario import Scenario, Uncertainty, with_errors
from controller.flight.simulation import CompiledLoop, Flight
from controller.policy.policies import FlownLaw, OpenLoop
from controller.policy.servo_policy import MeasuredOutputs, ServoPolicy
from controller.policy.signals import CommandSteps
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError
from hfa_support.model import Model
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
    aircraft: Aircraft | Model,
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
    model = LinearizedAircraft.at(aircraft, point, result.loop.wind_names)
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

    @property
    def rms_errors(self) -> np.ndarray:
        """Root mean square of the tracking error z over the second half of the flight, (k,)."""
        late = self.flight.errors[len(self.flight.errors) // 2 :]
        return np.asarray(np.sqrt(np.mean(late**2, axis=0)))

    @property
    def beyond_limits(self) -> np.ndarray:
        """Share of the flight in which each input lay beyond its limits, (m,)."""
        return np.asarray(beyond_control_limits(self.point.model, self.inputs).mean(axis=0))

    @property
    def differences(self) -> np.ndarray | None:
        """Largest |nonlinear - linear| of each state, (n,); None without a prediction."""
        if self.predicted is None:
            return None
        count = min(len(self.flight.times), len(self.predicted.times))
        return np.asarray(np.abs(self.flight.states[:count] - self.predicted.states[:count]).max(axis=0))

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

        law: what was flown, for the title and the data. data: without the flight itself, which is `history`.
        """
        kind = "" if law is None or not len(law.gains) else ", frozen"
        words = "" if law is None else f", law {law.name}{kind}"
        parts: list[Part] = [_states(self), *([OVER_GROUND] if _through_air(self) else []), _inputs(self)]
        commanded = _tracked(self, law)
        if commanded:
            parts.insert(0, tracking_table(commanded))
        still = max(np.abs(self.flight.states).max(), np.abs(self.flight.inputs).max()) <= _STILL
        return Report(self.title(words), parts, [UNDISTURBED] * bool(still), _data(self, law), _records(self))

    def history(self) -> dict[str, Any]:
        """Once a tick: times (N,), states (N, 7), inputs (N, 5), angles of attack, all absolute; errors, updrafts."""
        every = slice(None, None, self.scenario.steps_per_tick)
        of_flight = {name: getattr(self.flight, name)[every] for name in ("times", "errors", "updrafts")}
        names = ("states", "inputs", *(("angles_of_attack",) if flown_through_air(self.point.model) else ()))
        absolute = {name: getattr(self, name)[every] for name in names}
        return {"history": of_flight | absolute}


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
    z = flight.states[:, _rows(model)] @ outputs.C.T + flight.inputs @ outputs.D.T
    if outputs.F.size:
        z += flight.updrafts[:, None] @ outputs.F.T
    units = model.units([model.part(name)[0] for name in commands.names])
    return tuple(map(Tracked, commands.names, z.T, commands.sampled(flight.times).T, units))


def _rows(model: Model) -> list[int]:
    """Where the states of the linear model stand among all."""
    return [list(model.states).index(name) for name in model.linear]


def _through_air(result: NonlinearFlight) -> bool:
    """Whether alpha through the air is another number than alpha."""
    return bool(result.flight.winds) and flown_through_air(result.point.model)


def tracking_table(followed: tuple[Tracked, ...]) -> Table:
    """Degrees for angles."""
    rows = []
    for each in followed:
        sizes = (short_number(value, each.unit) for value in (each.rms, each.largest))
        rows.append((each.name, shown_unit(each.unit), *sizes))
    return Table(("commanded output", "unit", "rms error", "largest error"), rows)


def _tracked(result: NonlinearFlight, law: FlownLaw | None) -> tuple[Tracked, ...]:
    if law is None or not isinstance(law.policy, ServoPolicy) or not isinstance(law.policy.commands, CommandSteps):
        return ()
    return tracked(result.flight, law.policy.regulated, law.policy.commands)


def _states(result: NonlinearFlight) -> Table:
    final, largest, differences = result.flight.states[-1], np.abs(result.flight.states).max(axis=0), result.differences
    rows: list[tuple[str, ...]] = []
    model = result.point.model
    for index, name in enumerate(model.states):
        unit = model.unit(name)
        cells = [name, shown_unit(unit), short_number(largest[index], unit), short_number(final[index], unit)]
        cells += [short_number(result.rms_errors[model.linear.index(name)], unit) if name in model.linear else ""]
        cells += [result.envelope.limits_text(index)]
        cells += [] if differences is None else [short_number(differences[index], unit)]
        rows.append(tuple(cells))
        if name == ALPHA and _through_air(result):
            deviations = result.angles_of_attack - result.point.states.alpha
            shown = (short_number(value, unit) for value in (np.abs(deviations).max(), deviations[-1]))
            limited = (ANGLE_OF_ATTACK, shown_unit(unit), *shown, "", result.envelope.limits_text(index), "")
            rows[-1] = (*cells[:5], "", *cells[6:])
            rows.append(limited[: len(cells)])
    deviations = ("largest deviation", "final deviation", "rms error, 2nd half")
    header = ("state", "unit", *deviations, "envelope", "off the linear model")
    return Table(header[: len(rows[0])], rows)


def _inputs(result: NonlinearFlight) -> Table:
    low, high, beyond = result.inputs.min(axis=0), result.inputs.max(axis=0), result.beyond_limits
    names = tuple(result.point.model.inputs)
    rows = [
        (name, shown_unit(unit), short_number(low[i], unit), short_number(high[i], unit), f"{100 * beyond[i]:.3g} %")
        for i, (name, unit) in enumerate(zip(names, result.point.model.units(names), strict=True))
    ]
    return Table(("input", "unit", "lowest", "highest", "time beyond control limits"), rows)


def _data(result: NonlinearFlight, law: FlownLaw | None) -> dict[str, Any]:
    """Units of the model, radians. held: whether the envelope was not left, and no limit cycle is left over."""
    departure, model = result.departure, result.point.model
    final = dict(zip(model.states, result.states[-1].tolist(), strict=True))
    largest = dict(zip(model.states, np.abs(result.flight.states).max(axis=0).tolist(), strict=True))
    if flown_through_air(model):
        angles = result.angles_of_attack
        final[ANGLE_OF_ATTACK] = float(angles[-1])
        largest[ANGLE_OF_ATTACK] = float(np.abs(angles - getattr(result.point.states, ALPHA)).max())
    data: dict[str, Any] = {
        "schema": FLIGHT_SCHEMA,
        "dynamics": result.point.dynamics,
        **names_and_units(model),
        "operating_point": result.point.to_dict(),
        "scenario": result.scenario.to_dict(),
        "envelope": result.envelope.to_dict(bool(result.flight.winds)),
        "within_limits": result.within_limits,
        "held": departure is None and result.cycle is None,
        "departure": None if departure is None else departure._asdict(),
        "limit_cycle": None if result.cycle is None else result.cycle._asdict(),
        "exceeded": [each._asdict() for each in result.exceeded],
        "flown": float(result.flight.times[-1]),
        "final": final,
        "largest_deviation": largest,
        "rms_error": dict(zip(model.linear, result.rms_errors.tolist(), strict=True)),
        "share_beyond_control_limits": dict(zip(model.inputs, result.beyond_limits.tolist(), strict=True)),
        "checks": [],
    }
    if result.differences is not None:
        data["largest_difference_from_linear"] = dict(zip(model.states, result.differences.tolist(), strict=True))
    if law is not None:
        data["policy"] = {"law": law.name}
        if len(law.gains):
            data["policy"] |= {"state_units": list(model.units(model.linear)), "K": law.gains[-1]}
        if isinstance(law.policy, ServoPolicy):
            data["commanded"] = {
                each.name: {"rms_error": each.rms, "largest_error": each.largest, "unit": each.unit}
                for each in _tracked(result, law)
            }
    return data


def _records(result: NonlinearFlight) -> Table:
    """One row a tick: time, states, inputs and the air, each with its unit; an array, because a flight may be long."""
    flown, model = result.history()["history"], result.point.model
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
