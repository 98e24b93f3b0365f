"""A flight of the nonlinear aircraft beside the prediction of its linear model, and its report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air import ALPHA, ANGLE_OF_ATTACK, OVER_GROUND, UPDRAFT, flown_through_air
from hfa_flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant
from hfa_flight.envelope import (
    ControlExcess,
    Departure,
    control_excesses,
    control_limits,
    departure,
    envelope_data,
    limits_text,
    outside,
    refuse_start,
)
from hfa_flight.flight_history import Flight
from hfa_flight.limit_cycle import LimitCycle, limit_cycle
from hfa_flight.policies import GainPolicy, OpenLoop, Policy
from hfa_flight.results import FlightData
from hfa_flight.scenario import Scenario, Uncertainty, with_errors
from hfa_flight.simulation import CompiledLoop
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.limits import Limits
from trim.point.operating_point import OperatingPoint, at_scheduled

#: Note on a flight that stays at trim.
UNDISTURBED = (
    "nothing disturbs this flight: give initial errors, a gust, turbulence, noise, a command or"
    " errors of parameters"
)
#: Largest deviations of a flight that stays at trim, in the units of states and inputs.
_STILL = 1e-6


@checks_arguments
def fly(
    model: Model,
    point: OperatingPoint,
    policy: Policy,
    scenario: Scenario,
    envelope: Limits,
    *,
    predict: bool = True,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """The flight of X' = f(X, U, w) + d with U = U0 + u of the policy and, with `predict`, that of
    x' = A x + B u + E w + d, the linear model.

    model: the aircraft as designed
    point: the trim X0, U0 about which it flies
    policy: u, from the deviations from trim
    scenario: what happens during the flight; all of it drawn
    envelope: limits of the states
    predict: whether the linear model flies too
    progress: called during the nonlinear flight

    The prediction is of the aircraft as designed: without the parameter errors. Both end at the
    first tick in which the nonlinear flight leaves the envelope.

    BadInputError when the flight does not begin inside, or part of the scenario is still to be
    drawn.

    >>> import hfa
    >>> from controller import GainPolicy, Scenario, flight_envelope, fly
    >>> model = hfa.aircraft()
    >>> point = hfa.find_operating_point(model, hfa.paper.level_flight(0.2))
    >>> K = hfa.solve_game(hfa.paper.published_game(hfa.linearize(model, point))).K
    >>> second = Scenario(duration=1.0)
    >>> envelope = flight_envelope(model, point)
    >>> fly(model, point, GainPolicy("exact", K), second, envelope).states.shape
    (1001, 7)
    """
    if scenario.uncertainty != Uncertainty():
        raise BadInputError(
            "part of the scenario is still to be drawn;"
            " simulate scenario.drawn(seed, member, point)"
        )
    scenario = scenario.on(model)
    plant = NonlinearPlant(with_errors(model, scenario), point)
    loop = ClosedLoop(plant, policy, scenario)
    result = fly_within(CompiledLoop(loop), envelope, progress=progress)
    start = result.flight.limited[0] + np.array(point.states)
    refuse_start(envelope, start, scenario.moving_air)
    if not predict:
        return result
    linear = replace(loop, plant=LinearPlant.at(model, point, loop.wind_names))
    ticks = (len(result.flight.times) - 1) // scenario.steps_per_tick
    return replace(result, predicted=CompiledLoop(linear).fly(ticks=ticks))


def fly_within(
    compiled: CompiledLoop,
    envelope: Limits,
    scenario: Scenario | None = None,
    parameters: np.ndarray | None = None,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """One flight of a nonlinear loop about its trim, without a prediction of the linear model; it
    ends with the first tick outside the envelope.

    compiled: the loop
    envelope: limits of the states, in their own values, not as deviations
    scenario: flown in place of the loop's own; what may differ is in `CompiledLoop.fly`
    parameters: of the flown aircraft, as `CompiledLoop.fly` takes them; None for the loop's own
    progress: as `CompiledLoop.fly` calls it
    """
    loop = compiled.loop if scenario is None else replace(compiled.loop, scenario=scenario)
    trim = np.array(loop.plant.point.states)

    def stop(rows: Flight) -> np.ndarray:
        return outside(envelope, rows.limited + trim)

    flight = compiled.fly(loop.scenario, parameters=parameters, stop=stop, progress=progress)
    left_at = departure(envelope, flight.times, flight.limited + trim, loop.scenario.moving_air)
    cycle = None
    if left_at is None and not isinstance(loop.policy, OpenLoop):
        cycle = limit_cycle(loop.plant.point.model, flight, loop.scenario.driven_until)
    return NonlinearFlight(envelope, loop, flight, left_at, cycle)


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearFlight(Reported):
    """A flight, up to the first tick that left the envelope.

    envelope: limits of the states
    loop: what was flown
    flight: deviations from `point`
    departure: which state left the envelope first, None when none did
    cycle: what still oscillates at the end, None when nothing does
    predicted: the same flight of the linear model, None when none was asked for
    """

    envelope: Limits
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

    def title(self) -> str:
        """Which flight, and whether it stayed within its limits."""
        flight = f"Flight, {self.point.called}"
        scheduled = at_scheduled(self.point).removeprefix("at ")
        if scheduled:
            flight += f", {scheduled}"
        flight += f", law {self.loop.policy.name}"
        if isinstance(self.loop.policy, GainPolicy):
            flight += ", frozen"
        duration = f"{self.flight.times[-1]:g} s"
        exceeded = ", ".join(excess.text() for excess in self.exceeded)
        wrong = self.departure or self.cycle
        if wrong is not None:
            outcome = wrong.text()
        elif exceeded:
            outcome = f"inside the envelope for {duration}, but not within the control limits"
        else:
            outcome = f"stayed within limits: {duration} inside the envelope and the control limits"
        lines = [flight, outcome]
        if exceeded:
            lines.append(f"exceeded control limits: {exceeded}")
        return "\n".join(lines)

    def report(self) -> Report:
        """Outcome, states against the envelope and the linear prediction, inputs against the
        control limits; the data are those of `data`."""
        data = self.data()
        moving = bool(self.flight.winds) and flown_through_air(self.point.model)
        parts: list[Part] = []
        if data.get("commanded"):
            parts.append(_tracking_table(data["commanded"]))
        parts.append(self._states(data, moving))
        if moving:
            parts.append(OVER_GROUND)
        parts.append(self._inputs(data))
        largest = max(np.abs(self.flight.states).max(), np.abs(self.flight.inputs).max())
        notes = [UNDISTURBED] if largest <= _STILL else []
        return Report(self.title(), parts, notes, data, self._records())

    def data(self) -> dict[str, Any]:
        """What JSON has of a flight, in the units of the model; not the `history`.

        held: whether the envelope was not left, and no limit cycle is left over
        """
        model = self.point.model
        flight = self.flight
        late = flight.errors[len(flight.errors) // 2 :]
        beyond = ~control_limits(model).within(self.inputs)
        envelope = envelope_data(self.envelope, bool(flight.winds))
        data: dict[str, Any] = {
            "dynamics": self.point.dynamics,
            **names_and_units(model),
            "operating_point": self.point,
            "scenario": self.loop.scenario.to_dict(),
            "envelope": {name: np.array(limits) for name, limits in envelope.items()},
            "within_limits": self.within_limits,
            "held": self.departure is None and self.cycle is None,
            "departure": self.departure,
            "limit_cycle": self.cycle,
            "exceeded": self.exceeded,
            "flown": float(flight.times[-1]),
            "final": _by_name(model.states, self.states[-1]),
            "largest_deviation": _by_name(model.states, np.abs(flight.states).max(axis=0)),
            "rms_error": _by_name(model.linear, np.sqrt(np.mean(late**2, axis=0))),
            "share_beyond_control_limits": _by_name(model.inputs, beyond.mean(axis=0)),
            "checks": [],
            "policy": self.loop.policy.data(model),
        }
        if flown_through_air(model):
            angles = self.angles_of_attack
            trim = getattr(self.point.states, ALPHA)
            data["final"][ANGLE_OF_ATTACK] = float(angles[-1])
            data["largest_deviation"][ANGLE_OF_ATTACK] = float(np.abs(angles - trim).max())
        if self.predicted is not None:
            difference = np.abs(flight.states - self.predicted.states).max(axis=0)
            data["largest_difference_from_linear"] = _by_name(model.states, difference)
        commanded = self.loop.policy.tracking_errors(flight)
        if commanded:
            data["commanded"] = commanded
        return FlightData(**data).as_data()

    def _states(self, data: dict[str, Any], moving: bool) -> Table:
        """A row a state, and where the air moves one of alpha through it."""
        model = self.point.model
        header = ["state", "unit", "largest deviation", "final deviation", "rms error, 2nd half"]
        header.append("envelope")
        differences = data.get("largest_difference_from_linear")
        if differences is not None:
            header.append("off the linear model")
        rows = []
        for index, state in enumerate(model.states):
            unit = model.unit(state)
            limits = limits_text(self.envelope.lowest[index], self.envelope.highest[index], unit)
            names = (state, ANGLE_OF_ATTACK) if state == ALPHA and moving else (state,)
            for name in names:
                final = data["final"][name] - self.point.states[index]
                cells = [name, shown_unit(unit)]
                cells.append(short_number(data["largest_deviation"][name], unit))
                cells.append(short_number(final, unit))
                errors = data["rms_error"]
                cells.append(short_number(errors[name], unit) if name in errors else "")
                cells.append(limits if name == names[-1] else "")
                if differences is not None:
                    shown = name in differences
                    cells.append(short_number(differences[name], unit) if shown else "")
                rows.append(tuple(cells))
        return Table(tuple(header), rows)

    def _inputs(self, data: dict[str, Any]) -> Table:
        """A row an input."""
        model = self.point.model
        rows = []
        for name, column in zip(model.inputs, self.inputs.T, strict=True):
            unit = model.unit(name)
            lowest = short_number(column.min(), unit)
            highest = short_number(column.max(), unit)
            beyond = f"{100 * data['share_beyond_control_limits'][name]:.3g} %"
            rows.append((name, shown_unit(unit), lowest, highest, beyond))
        return Table(("input", "unit", "lowest", "highest", "time beyond control limits"), rows)

    def history(self) -> dict[str, Any]:
        """Once a tick: times (N,), states (N, n), inputs (N, m), angles of attack, all absolute;
        errors, updrafts."""
        every = slice(None, None, self.loop.scenario.steps_per_tick)
        columns = {
            "times": self.flight.times[every],
            "errors": self.flight.errors[every],
            "updrafts": self.flight.updrafts[every],
            "states": self.states[every],
            "inputs": self.inputs[every],
        }
        if flown_through_air(self.point.model):
            columns["angles_of_attack"] = self.angles_of_attack[every]
        return {"history": columns}

    def _records(self) -> Table:
        """The history, one row a tick, each column with its unit: an array, because a flight may be
        long."""
        history = self.history()["history"]
        model = self.point.model
        units = {"time": "s"} | {name: model.unit(name) for name in (*model.states, *model.inputs)}
        columns = [history["times"], history["states"], history["inputs"]]
        if UPDRAFT in model.disturbances:
            units[UPDRAFT] = model.unit(UPDRAFT)
            columns.append(history["updrafts"])
        if flown_through_air(model):
            units[ANGLE_OF_ATTACK] = model.unit(ALPHA)
            columns.append(history["angles_of_attack"])
        rows: Any = np.column_stack(columns)
        return Table(tuple(f"{name} [{unit}]" for name, unit in units.items()), rows)


def _tracking_table(commanded: dict[str, dict[str, Any]]) -> Table:
    """A row a commanded output: its rms and largest error over the flight, with their unit.

    commanded: what `Policy.tracking_errors` returns.
    """
    rows = []
    for name, errors in commanded.items():
        unit = errors["unit"]
        rms = short_number(errors["rms_error"], unit)
        largest = short_number(errors["largest_error"], unit)
        rows.append((name, shown_unit(unit), rms, largest))
    return Table(("commanded output", "unit", "rms error", "largest error"), rows)


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
