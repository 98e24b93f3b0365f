"""Flight of the nonlinear aircraft, compared with the prediction of its linear model."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.batch_simulation import RESOLVED
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.signals import StatesAndInputs
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.scenario import MOST_STEPS, Scenario
from hfa_flight.air.sensors import at_trim
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.policies.policy import GainPolicy, OpenLoop
from hfa_flight.simulate.closed_loop import FlightLoop, LinearPlant
from hfa_flight.simulate.envelope import (
    GIVE_LIMIT,
    NO_LIMIT,
    RULE,
    ControlExcess,
    Departure,
    control_excesses,
    departure,
    divergence,
    envelope_data,
    has_returned,
    is_limited,
    limits_text,
    note_on_air,
    outside,
    refuse_start,
    share_at_limits,
)
from hfa_flight.simulate.flight_figure import Curve, flight_figure, histories_of
from hfa_flight.simulate.history import Deviations, series
from hfa_flight.simulate.limit_cycle import (
    LimitCycle,
    duration_for,
    limit_cycle,
    slowest_recognized,
)
from hfa_flight.simulate.simulation import CompiledLoop
from hfa_support.errors import (
    NoSolutionError,
    warn,
)
from hfa_support.matrices import quadratic_forms
from hfa_support.progress import Progress
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.parts import Part, Picture
from hfa_support.reporting.report import Report, Reported, verdict_text
from hfa_support.reporting.results import Entries, Result, without_empty
from hfa_support.reporting.rows import Group, Row, with_names
from hfa_support.reporting.text import Table, percent, short_number, shown_unit
from trim.linear.delays import step_count
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: First line of a flight in which nothing happens.
_UNDISTURBED = (
    "NOT JUDGED: nothing disturbs this flight; give initial errors, a gust, turbulence, noise, a "
    "command or errors of parameters"
)
#: Deviation, in nominal values, below which what moves a flight from the trim is rounding.
_STILL = 1e-6
#: Attributes that the file of a flight contains, and those that it contains if they have a value.
_STORED = (
    *("state_units", "input_units", "dynamics", "exceeded", "held", "scenario", "flown", "final"),
    *("largest_deviation", "rms_error", "share_at_limits", "policy", "warnings"),
)
_STORED_IF_ANY = (
    *("integration_error", "largest_difference_from_linear"),
    *("cost", "cost_to_go", "returned", "uncontrolled_within_limits"),
)


def lengthened(loop: FlightLoop) -> Scenario:
    """Return the scenario of a loop, longer if limit cycles of growing modes require it.

    A longer duration is printed as a warning. A scenario with turbulence or drawn noise is returned
    unchanged, because these have its length.
    """
    scenario = loop.scenario
    if scenario.gust is not None or scenario.samples is not None:
        return scenario
    growing = loop.growing_modes()
    needed = min(duration_for(growing), MOST_STEPS * scenario.step)
    if needed <= scenario.duration:
        return scenario
    fastest = growing[np.argmax(growing.real)]
    warn(
        f"the linear loop is unstable (growth {fastest.real:.3g} 1/s at {abs(fastest.imag):.3g} "
        f"rad/s): the flight takes {needed:g} s in place of {scenario.duration:g} s"
    )
    return replace(scenario, duration=round(needed / scenario.tick) * scenario.tick)


def simulated_loop(loop: FlightLoop, *, predict: bool, progress: Progress) -> Flight:
    """Return the flight of a nonlinear loop, which must begin inside the envelope.

    predict: whether the flight is compared with that of the linear model, if the policy permits it
    """
    flight = fly_within(CompiledLoop(loop), progress=progress)
    if flight.departure is not None and flight.departure.time == 0.0:  # begins outside
        refuse_start(loop.limits, flight.deviations.limited[0])
    return replace(flight, predicts=predict and loop.policy.predicts)


def fly_within(
    compiled: CompiledLoop,
    scenario: Scenario | None = None,
    parameters: np.ndarray | None = None,
    *,
    progress: Progress | None = None,
) -> Flight:
    """Return the flight of a nonlinear loop up to the first row outside the envelope.

    A flight without an envelope is judged by whether it diverges. The linear model is not
    simulated.

    compiled: the loop
    scenario: used in place of the loop's scenario. `CompiledLoop.fly` lists the values that may
        differ
    parameters: parameters of the simulated aircraft, or None for those of the loop
    progress: called during the flight
    """
    loop = compiled.loop if scenario is None else replace(compiled.loop, scenario=scenario)
    point, envelope = loop.plant.point, loop.limits
    stop = partial(outside, envelope)
    # Before the flight, because it evaluates the policy, whose samples the flight reports.
    growth = 0.0 if is_limited(envelope) else compiled.growth
    flight = compiled.fly(loop.scenario, parameters=parameters, stop=stop, progress=progress)
    invalid = point.model.native.domain.flown
    if invalid is not None:
        _refuse_invalid(point, flight, invalid)
    first_departure = departure(envelope, flight.times, flight.limited)
    if first_departure is None and not is_limited(envelope):
        first_departure = divergence(flight, point, growth, loop.driven_until)
    cycle = None
    if first_departure is None:
        cycle = limit_cycle(point.model, flight, loop.scenario.driven_until)
    return Flight(loop, flight, first_departure, cycle)


def _refuse_invalid(
    point: OperatingPoint, flight: Deviations, invalid: Callable[[Any, Any, Any], str]
) -> None:
    """Raise NoSolutionError if the equations of the model are not valid in a flight.

    invalid: the model's function (X, U, p) of some rows -> why its equations are not valid, or ""
    """
    model = point.model
    X = model.native_values(model.state_names, flight.states + point.x)
    U = model.native_values(model.input_names, flight.inputs + point.u)

    def reason(rows: int) -> str:
        """Return the reason why the equations are not valid in the first rows, or ""."""
        return invalid(X[:rows], U[:rows], model.native.p)

    if reason(len(X)):
        # More rows than some invalid first ones are invalid, too: bisection finds the first one.
        row = bisect_left(range(1, len(X)), True, key=lambda rows: bool(reason(rows)))
        raise NoSolutionError(
            f"{model.title}: no flight: {reason(row + 1)}; it is met at {flight.times[row]:.4g} s"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Flight(StatesAndInputs, Result, Reported):
    """A simulated flight, up to the first row outside the envelope.

    loop: the simulated loop
    deviations: time history in deviations from `point`
    departure: first departure from the envelope: state, time, value, limit, or null if there is
        none. Without an envelope, the state that diverges
    cycle: limit cycle at the end: name, amplitude, frequency in rad/s, unit, or null if there is
        none.
    predicts: whether the flight is compared with that of the linear model

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> flight = hfa.fly(model, hfa.trim(model, hold={"dihedral": 0.2}), None, 1.0,
    ...                  initial={"alpha": 0.01})
    >>> flight.ok, flight["alpha"].shape
    (True, (1001,))
    """

    schema = "hfa.flight/1"

    loop: FlightLoop
    deviations: Deviations
    departure: Departure | None
    cycle: LimitCycle | None
    predicts: bool = False

    @property
    def point(self) -> OperatingPoint:
        """Trim from which deviations are measured."""
        point: OperatingPoint = self.loop.plant.point
        return point

    @property
    def dynamics(self) -> str:
        """Name of the model."""
        return self.point.dynamics

    @property
    def model(self) -> Model:
        """The model of the aircraft."""
        return self.point.model

    @property
    def time(self) -> np.ndarray:
        """Times (N,), s."""
        return self.deviations.times

    @property
    def states(self) -> np.ndarray:
        """Absolute states X (N, n), also by name: states["alpha"]."""
        point = self.point
        return with_names(self.deviations.states + point.x, (), tuple(point.model.states))

    @property
    def envelope(self) -> Limits:
        """Limits of the states, of speed and flow angles relative to moving air, and of outputs."""
        return self.loop.limits

    @cached_property
    def outputs(self) -> dict[str, np.ndarray]:
        """Absolute values (N,) of the outputs with limits, also of `airspeed` in moving air."""
        columns = zip(self.envelope.names, self.deviations.limited.T, strict=True)
        return {name: values for name, values in columns if name not in self.model.states}

    @property
    def inputs(self) -> np.ndarray:
        """Absolute inputs U (N, m), also by name."""
        point = self.point
        return with_names(self.deviations.inputs + point.u, (), tuple(point.model.inputs))

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the absolute values, (N,), of a state, an input or an output, in its unit.

        Raises BadInputError if the name is unknown.
        """
        if name in self.outputs:
            return self.outputs[name]
        # Outputs depend on the parameters of the simulated aircraft, which may have errors.
        flown = getattr(self.loop.plant, "model", self.model)
        return series(self.model, self.states, self.inputs, name, flown.p)

    @cached_property
    def exceeded(self) -> tuple[ControlExcess, ...]:
        """Inputs that exceeded their control limits inside the envelope, largest excess first.

        Each entry has the fields input, value, limit and unit.
        """
        return control_excesses(self.model, self.deviations.inputs + self.point.u)

    @cached_property
    def disturbed(self) -> bool:
        """True if a disturbance or the policy moves the aircraft from its trim."""
        model, flown = self.model, self.deviations
        moved = np.abs(np.hstack([flown.states, flown.inputs])).max(axis=0)
        nominal = [model.signals[name].nominal for name in (*model.states, *model.inputs)]
        return not self.loop.scenario.is_calm or bool(np.any(moved > _STILL * np.array(nominal)))

    @property
    def within_limits(self) -> bool:
        """True if the flight stayed inside all limits and does not end in a limit cycle.

        The limits are the envelope of the states and the control limits of the inputs. Without an
        envelope, True if it does not diverge either.
        """
        return self.departure is None and not self.exceeded and self.cycle is None

    @property
    def ok(self) -> bool:
        """True if something disturbs the flight and it stays within its limits."""
        return self.within_limits and self.disturbed

    @cached_property
    def uncontrolled_within_limits(self) -> bool | None:
        """`within_limits` of the same flight without control, omitted unless noise or turbulence is
        drawn and a policy acts.

        The flight is simulated when it is first read.
        """
        if isinstance(self.loop.policy, OpenLoop) or not self.loop.scenario.is_random:
            return None
        no_policy, scenario = policy_and_scenario(None, self.point, self.loop.scenario)
        loop = replace(self.loop, policy=no_policy, scenario=scenario, cost=None)
        return fly_within(CompiledLoop(loop)).within_limits

    def __bool__(self) -> bool:
        return self.ok

    @property
    def held(self) -> bool:
        """True if the flight stayed inside the envelope and does not end in a limit cycle."""
        return self.departure is None and self.cycle is None

    @property
    def scenario(self) -> Mapping[str, Any]:
        """Scenario of the flight."""
        return self.loop.scenario.to_dict()

    @property
    def step(self) -> float:
        """Interval of the rows of the flight, s."""
        return float(self.time[1] - self.time[0])

    @property
    def flown(self) -> float:
        """Duration of the flight, s."""
        return float(self.deviations.times[-1])

    @property
    def final(self) -> Mapping[str, float]:
        """Final absolute values of all states and `outputs`."""
        end = (self.deviations.states[-1] + self.point.x).tolist()
        values = dict(zip(self.point.model.states, end, strict=True))
        return values | {name: float(column[-1]) for name, column in self.outputs.items()}

    @property
    def largest_deviation(self) -> Mapping[str, float]:
        """Largest deviation from trim of each state and of `outputs`."""
        largest = np.abs(self.deviations.states).max(axis=0).tolist()
        values = dict(zip(self.point.model.states, largest, strict=True))
        for name, column in self.outputs.items():
            values[name] = float(np.abs(column - at_trim(self.point, (name,))).max())
        return values

    @property
    def rms_error(self) -> Mapping[str, float]:
        """Root mean square of the error of each state of the linear model, over the second half."""
        late = self.deviations.errors[len(self.deviations.errors) // 2 :]
        with np.errstate(over="ignore"):  # of a flight that diverges
            rms = np.sqrt(np.mean(late**2, axis=0)).tolist()
        return dict(zip(self.point.model.linear, rms, strict=True))

    @property
    def share_at_limits(self) -> Mapping[str, float]:
        """Fraction of the time during which each input is at or beyond a control limit."""
        return share_at_limits(self.point.model, self.inputs)

    @property
    def policy(self) -> Mapping[str, Any]:
        """Name and gain K of the policy, with the breakpoints of scheduled gains."""
        return self.loop.policy.data(self.model)

    @cached_property
    def predicted(self) -> Deviations | None:
        """Flight of the linear model, for the ticks of this flight, or None if `predicts` is False.

        It is simulated when it is first read.
        """
        if not self.predicts:
            return None
        point, flown = self.point, self.deviations
        plant = LinearPlant.of(point.model, point, tuple(flown.winds))
        linear = CompiledLoop(replace(self.loop, plant=plant, cost=None))
        return linear.fly(ticks=step_count(flown.times[-1], self.loop.scenario.tick))

    @property
    def largest_difference_from_linear(self) -> Mapping[str, float] | None:
        """State -> largest difference from the linear prediction, omitted without a prediction."""
        if self.predicted is None:
            return None
        flown = self.deviations.states
        differences = np.abs(flown - self.predicted.states[: len(flown)]).max(axis=0).tolist()
        return dict(zip(self.point.model.states, differences, strict=True))

    @property
    def integration_error(self) -> float | None:
        """Error of the integration where the rates jump, omitted if all steps are short enough.

        It is the sum of the errors of the steps that exceed the tolerance, relative to the largest
        deviation in nominal values.
        """
        return self.deviations.integration_error or None

    @property
    def cost(self) -> float | None:
        """Cost ∫ z'Qz + u'Ru dt up to the end of the flight, omitted without weights.

        It is integrated with the flight, as a further state.

        z: deviations of the states from trim and command
        u: deviations of the inputs from trim
        """
        return None if self.deviations.cost is None else float(self.deviations.cost[-1])

    @cached_property
    def _optimum(self) -> np.ndarray | None:
        """P of the linear optimum, (k, k), or None without weights or an optimum."""
        from controller.game.linear_game import game
        from controller.riccati.gare import solve

        cost = self.loop.cost
        if cost is None:
            return None
        try:
            return solve(game(self.point.linearize(), Q=cost.Q, R=cost.R, delta=np.inf)).P
        except NoSolutionError:
            return None

    @property
    def cost_to_go(self) -> float | None:
        """Linear cost-to-go z'Pz at the end, omitted without weights or a linear optimum."""
        z = self.deviations.errors[-1:]
        return None if self._optimum is None else float(quadratic_forms(z, self._optimum)[0])

    @property
    def returned(self) -> bool | None:
        """Whether the flight stays inside and has returned to the trim, omitted without cost_to_go.

        The rule is that of `optimize` and of the costs of `assess`.
        """
        if self._optimum is None or self.deviations.cost is None:
            return None
        flown, spent = self.deviations.errors, float(self.deviations.cost[-1])
        is_back = has_returned(self.model, flown, self._optimum, spent)
        return self.departure is None and is_back

    @property
    def warnings(self) -> Sequence[str]:
        """Notes on the operating point, and on moving inputs whose dynamics are not modeled."""
        # In absolute values, deviations of rounding do not move an input.
        moved = np.ptp(self.deviations.inputs + self.point.u, axis=0) > 0.0
        inputs = zip(self.point.model.inputs.values(), moved, strict=True)
        omitted = (signal.omitted_dynamics for signal, moves in inputs if moves)
        return [*self.point.warnings, *filter(None, omitted)]

    def title(self) -> str:
        """Return the first lines of the report: the verdict, a line on the flight, and findings.

        Each finding has its own line.
        """
        flight = f"Flight, {self.point.model.title}"
        scheduled = self.point.at_scheduled.removeprefix("at ")
        if scheduled:
            flight += f", {scheduled}"
        flight += f", policy {self.loop.policy.name}"
        if isinstance(self.loop.policy, GainPolicy):
            flight += ", constant gain"  # not scheduled in the flight
        duration = f"{self.deviations.times[-1]:g} s"
        wrong = self.departure or self.cycle
        has_envelope = is_limited(self.envelope)
        if wrong is not None:
            outcome = wrong.text()
        elif not has_envelope:
            outcome = f"does not diverge in {duration}"
        elif self.exceeded:
            outcome = f"inside the envelope for {duration}, but not within the control limits"
        else:
            outcome = f"{duration} inside the envelope and the control limits"
        if not has_envelope:
            outcome += f"; {NO_LIMIT}"
        if self.loop.scenario.is_random:
            outcome += f"; 1 random flight (seed {self.loop.scenario.seed})"
            if not isinstance(self.loop.policy, OpenLoop):
                outcome += f", {self.loop.scenario.text(self.model)}{self.loop.policy.tolerates()}"
        if (without := self.uncontrolled_within_limits) is not None:
            outcome += f"; without control {verdict_text(without)}"
            outcome += ", so the policy is worse" if without and not self.ok else ""
        first = f"{verdict_text(self.ok)}: {outcome}" if self.disturbed else _UNDISTURBED
        lines = [first, flight]
        if not has_envelope:
            lines.append(GIVE_LIMIT)
        lines += [f"exceeded control limit: {excess.text()}" for excess in self.exceeded]
        if self.deviations.integration_error > RESOLVED:
            error = percent(100.0 * self.deviations.integration_error, up=True)
            lines.append(
                "Not resolved: where rates jump, the errors of the shortest steps add up to "
                f"{error} of the largest deviation"
            )
        if self.loop.scenario.gust is not None:
            lines += self.loop.scenario.gust.left_out(self.point.model)
        return "\n".join(lines)

    def figure(self, title: str = "") -> Figure:
        """Return a new figure of the states and inputs over time.

        title: heading, by default that of the report
        """
        model, flown = self.point.model, self.deviations
        values = histories_of(model, self.states, self.inputs)
        reference = {
            name: values[name] - error
            for name, error in zip(model.linear, flown.errors.T, strict=True)
        }
        curves = [
            Curve("nonlinear", "C0-", flown.times, values | self.outputs | flown.winds),
            Curve("reference", "k:", flown.times, reference),
        ]
        if self.predicted is not None:
            states, inputs = self.predicted.states + self.point.x, self.predicted.inputs
            linear = histories_of(model, states, inputs + self.point.u)
            curves.append(Curve("linear", "C1--", self.predicted.times, linear))
        return flight_figure(new_figure(10.0, 8.0), self.envelope, curves, title or self.title())

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        entries: dict[str, Any] = {
            "departure": self.departure,
            "limit_cycle": self.cycle,
            "states": self.state_names,
            "inputs": self.input_names,
            "operating_point": self.point,
            "within_limits": self.within_limits,
            "envelope": envelope_data(self.envelope),
        }
        entries |= {name: getattr(self, name) for name in _STORED}
        return entries | without_empty(**{name: getattr(self, name) for name in _STORED_IF_ANY})

    def report(self) -> Report:
        """Return the report of the flight: outcome, tables of states and inputs, and a picture.

        The cost is included if there are weights.
        """
        model, flown, gust = self.point.model, self.deviations, self.loop.scenario.gust
        parts: list[Part] = [self._state_table()]
        if gust is not None and "alpha" in model.states:
            parts.append(note_on_air(self.envelope))
        if gust is not None and (in_words := gust.text(model)):
            parts.append(in_words)
        parts.append(self._input_table())
        if self.exceeded and isinstance(self.loop.policy, GainPolicy):
            parts.append(
                "the gain is not saturated at the control limits; networks, deployment files and "
                "--servo are"
            )
        if self.departure is None and self.cycle is None:
            parts.append(
                f"Oscillations slower than {slowest_recognized(flown.times[-1]):.2g} rad/s are not "
                f"recognized in {flown.times[-1]:g} s."
            )
        if flown.cost is not None:
            rows = [Row("up to the end", float(flown.cost[-1]), note="with Q and R", digits=6)]
            if self.cost_to_go is not None:
                has = "the flight has returned" if self.returned else "the flight has not returned"
                rows.append(Row("to go at the end", self.cost_to_go, note=has))
            parts.append(Group("cost", tuple(rows), (RULE,) if self.cost_to_go is not None else ()))
        parts += self.loop.policy.notes()
        parts.append(Picture("flight.png", "States and inputs over time", self.figure))
        return Report(self.title(), parts, data=Entries(self), records=self._record_table())

    def _state_table(self) -> Table:
        """Return a table of the states and `outputs`, one row each."""
        envelope = self.envelope
        differences = self.largest_difference_from_linear
        header = ["variable" if self.outputs else "state", "unit"]
        header += ["largest deviation", "final deviation", "rms error, 2nd half", "envelope"]
        if differences is not None:
            header.append("difference from linear")
        final = self.final
        largest = self.largest_deviation
        errors = self.rms_error
        rows = []
        for name, trim in zip(final, at_trim(self.point, (*final,)), strict=True):
            unit, limited = envelope.model.unit(name), ""
            if name in envelope.names:
                place = envelope.names.index(name)
                limited = limits_text(envelope.lowest[place], envelope.highest[place], unit)
                limited += ", assumed" * bool(envelope.assumed[place])
            cells = [
                name,
                shown_unit(unit),
                short_number(largest[name], unit),
                short_number(final[name] - trim, unit),
                short_number(errors[name], unit) if name in errors else "",
                limited,
            ]
            if differences is not None:
                known = name in differences
                cells.append(short_number(differences[name], unit) if known else "")
            rows.append(tuple(cells))
        return Table(tuple(header), rows)

    def _input_table(self) -> Table:
        """Return a table of the inputs, one row each: range, and time at the control limits."""
        model, inputs = self.point.model, self.deviations.inputs + self.point.u
        shares = share_at_limits(model, inputs)
        rows = []
        for name, column in zip(model.inputs, inputs.T, strict=True):
            unit = model.unit(name)
            lowest = short_number(column.min(), unit)
            highest = short_number(column.max(), unit)
            rows.append((name, shown_unit(unit), lowest, highest, f"{100 * shares[name]:.3g} %"))
        return Table(("input", "unit", "lowest", "highest", "time at control limits"), rows)

    @property
    def _ticks(self) -> np.ndarray:
        """Rows of the ticks, and the last one: a flight may leave between two ticks."""
        last = len(self.time) - 1
        return np.append(np.arange(0, last, self.loop.scenario.steps_per_tick), last)

    def history(self) -> dict[str, Any]:
        """Return the time history, absolute, with a row for each tick and the end: name -> array.

        times (N,), states (N, n), inputs (N, m), errors (N, k), each of `outputs` (N,), and winds,
        disturbance that the scenario sets -> (N,).
        """
        every = self._ticks
        return {
            "times": self.deviations.times[every],
            "errors": self.deviations.errors[every],
            "winds": {name: values[every] for name, values in self.deviations.winds.items()},
            "states": self.states[every],
            "inputs": self.inputs[every],
            **{name: values[every] for name, values in self.outputs.items()},
        }

    def _record_table(self) -> Table:
        """Return the absolute time history as a table, a row for each tick and the end."""
        point, flown = self.point, self.deviations
        model = point.model
        units = {"time": "s"} | {name: model.unit(name) for name in (*model.states, *model.inputs)}
        columns = [flown.times, flown.states + point.x, flown.inputs + point.u]
        for name, values in (flown.winds | self.outputs).items():
            units[name] = in_gusts(model).unit(name)
            columns.append(values)
        rows: Any = np.column_stack(columns)[self._ticks]
        return Table(tuple(f"{name} [{unit}]" for name, unit in units.items()), rows)
