"""A flight of the nonlinear aircraft, and what it says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.flight.closed_loop import ClosedLoop, Flight
from controller.flight.envelope import ANGLE_OF_ATTACK, OVER_GROUND, Departure, Envelope, angles_of_attack
from controller.flight.scenario import Scenario
from controller.flight.tracking import Tracked, tracked, tracking_table
from controller.policy.commands import CommandSteps
from controller.policy.flown_law import FlownLaw
from controller.policy.servo_policy import ServoPolicy
from hfa_model.vectors import (
    INPUT_UNITS,
    INPUTS,
    LINEAR_ROWS,
    LINEAR_STATES,
    LINEAR_UNITS,
    NAMES_AND_UNITS,
    STATE_UNITS,
    STATES,
    UNITS,
)
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, in_degrees, short_number, shown_unit
from trim.point.condition import CONTROL_LIMITS
from trim.point.operating_point import OperatingPoint

FLIGHT_SCHEMA = "hfa.flight/1"

#: Said of a flight that stays at trim: whose deviations are at most so large, in the units of states and inputs.
UNDISTURBED = (
    "nothing disturbs this flight: give initial errors, a gust, turbulence, noise, a command or errors of parameters"
)
_STILL = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearFlight(Reported):
    """A flight, up to the first tick that left the envelope.

    loop: what was flown. flight: of the nonlinear aircraft, deviations from `point`. predicted: the same of its linear
    model, None when none was asked for. departure: which state left the envelope first, None when it held.
    """

    scenario: Scenario
    point: OperatingPoint
    envelope: Envelope
    loop: ClosedLoop
    flight: Flight
    predicted: Flight | None
    departure: Departure | None

    @property
    def states(self) -> np.ndarray:
        """X, absolute, (N, 7)."""
        return self.flight.states + np.array(self.point.states)

    @property
    def angles_of_attack(self) -> np.ndarray:
        """Alpha of the center of mass through the air, absolute, (N,), rad; alpha itself in still air."""
        return angles_of_attack(self.states, self.flight.updrafts if self.scenario.moving_air else None)

    @property
    def inputs(self) -> np.ndarray:
        """U, absolute, (N, 5)."""
        return self.flight.inputs + np.array(self.point.inputs)

    @property
    def rms_errors(self) -> np.ndarray:
        """Root mean square of the tracking error z over the second half of the flight, (6,)."""
        late = self.flight.errors[len(self.flight.errors) // 2 :]
        return np.asarray(np.sqrt(np.mean(late**2, axis=0)))

    @property
    def beyond_limits(self) -> np.ndarray:
        """Share of the flight in which each input lay beyond `CONTROL_LIMITS`, (5,)."""
        limits = np.array(CONTROL_LIMITS)
        slack = 1e-9 * (1 + np.abs(limits))
        outside = (self.inputs < limits[:, 0] - slack[:, 0]) | (self.inputs > limits[:, 1] + slack[:, 1])
        return np.asarray(outside.mean(axis=0))

    @property
    def differences(self) -> np.ndarray | None:
        """Largest |nonlinear - linear| of each state, (7,); None without a prediction."""
        if self.predicted is None:
            return None
        count = min(len(self.flight.times), len(self.predicted.times))
        return np.asarray(np.abs(self.flight.states[:count] - self.predicted.states[:count]).max(axis=0))

    def title(self, law: str) -> str:
        """Which flight, and whether it stayed in its envelope."""
        dihedral = in_degrees(self.point.states.dihedral)
        flight = f"Flight, {self.point.dynamics} dynamics, dihedral {dihedral:g} deg{law}"
        return f"{flight}\n{_outcome(self.departure, self.flight.times[-1])}"

    def report(self, law: FlownLaw | None = None, checks: tuple[Check, ...] = ()) -> Report:
        """Outcome, states against the envelope and the linear prediction, inputs against the control limits.

        law: what was flown, for the title and the data. data: without the flight itself, which is `history`.
        """
        kind = "" if law is None or not len(law.gains) else f", {'learning in flight' if law.online else 'frozen'}"
        words = "" if law is None else f", law {law.name}{kind}"
        parts: list[Part] = [] if law is None or not law.online else [_learning(law)]
        parts += [_states(self), *([OVER_GROUND] if self.scenario.moving_air else []), _inputs(self)]
        if law is not None and isinstance(law.policy, ServoPolicy) and law.policy.commands.names:
            parts.insert(0, tracking_table(_tracked(self, law.policy)))
        if checks:
            parts.append(checks_block(checks))
        still = max(np.abs(self.flight.states).max(), np.abs(self.flight.inputs).max()) <= _STILL
        notes = [UNDISTURBED] if still else []
        return Report(self.title(words), parts, notes, _data(self, law, checks), _records(self))

    def history(self) -> dict[str, Any]:
        """Once a tick: times (N,), states (N, 7), inputs (N, 5), angles of attack, all absolute; errors, updrafts."""
        every = slice(None, None, self.scenario.steps_per_tick)
        return {
            "history": {
                "times": self.flight.times[every],
                "states": self.states[every],
                "inputs": self.inputs[every],
                "errors": self.flight.errors[every],
                "updrafts": self.flight.updrafts[every],
                "angles_of_attack": self.angles_of_attack[every],
            }
        }


def _tracked(result: NonlinearFlight, policy: ServoPolicy) -> tuple[Tracked, ...]:
    assert isinstance(policy.commands, CommandSteps)
    return tracked(result.flight, policy.regulated, policy.commands)


def _outcome(departure: Departure | None, time: float) -> str:
    if departure is None:
        return f"held: {time:g} s inside the envelope"
    unit = UNITS[departure.state]
    return (
        f"left the envelope: {departure.state} first, at {departure.time:.4g} s, "
        f"{short_number(departure.value, unit)} {shown_unit(unit)} beyond {short_number(departure.limit, unit)}"
    )


def _learning(law: FlownLaw) -> str:
    assert law.learned is not None, "a gain that changes in flight is learned"
    taking_over = f"at {law.certified_from:g} s" if np.isfinite(law.certified_from) else "never"
    last = law.learned.times[-1]
    return (
        f"learning in flight: the baseline gain is used until the first stabilizing certificate, {taking_over}; "
        f"then the last certified gain of each tick; at {last:g} s, the end of the learning, every certificate holds"
    )


def _states(result: NonlinearFlight) -> Table:
    final, largest, differences = result.flight.states[-1], np.abs(result.flight.states).max(axis=0), result.differences
    rows = []
    for index, (name, unit) in enumerate(zip(STATES, STATE_UNITS, strict=True)):
        cells = [name, shown_unit(unit), short_number(largest[index], unit), short_number(final[index], unit)]
        cells += [short_number(result.rms_errors[LINEAR_ROWS.index(index)], unit) if index in LINEAR_ROWS else ""]
        cells += [result.envelope.limits_text(index)]
        cells += [] if differences is None else [short_number(differences[index], unit)]
        rows.append(tuple(cells))
        if name == "alpha" and result.scenario.moving_air:
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
    rows = [
        (name, shown_unit(unit), short_number(low[i], unit), short_number(high[i], unit), f"{100 * beyond[i]:.3g} %")
        for i, (name, unit) in enumerate(zip(INPUTS, INPUT_UNITS, strict=True))
    ]
    return Table(("input", "unit", "lowest", "highest", "time beyond control limits"), rows)


def _data(result: NonlinearFlight, law: FlownLaw | None, checks: tuple[Check, ...]) -> dict[str, Any]:
    """English units and radians."""
    data: dict[str, Any] = {
        "schema": FLIGHT_SCHEMA,
        "dynamics": result.point.dynamics,
        **NAMES_AND_UNITS,
        "operating_point": result.point.to_dict(),
        "scenario": result.scenario.to_dict(),
        "envelope": result.envelope.to_dict(result.scenario.moving_air),
        "held": result.departure is None,
        "departure": None
        if result.departure is None
        else {**result.departure._asdict(), "unit": UNITS[result.departure.state]},
        "flown": float(result.flight.times[-1]),
        "final": dict(zip(STATES, result.states[-1].tolist(), strict=True)),
        "largest_deviation": dict(zip(STATES, np.abs(result.flight.states).max(axis=0).tolist(), strict=True)),
        "rms_error": dict(zip(LINEAR_STATES, result.rms_errors.tolist(), strict=True)),
        "share_beyond_control_limits": dict(zip(INPUTS, result.beyond_limits.tolist(), strict=True)),
        "checks": [check.to_dict() for check in checks],
    }
    data["final"][ANGLE_OF_ATTACK] = float(result.angles_of_attack[-1])
    deviations = result.angles_of_attack - result.point.states.alpha
    data["largest_deviation"][ANGLE_OF_ATTACK] = float(np.abs(deviations).max())
    if result.differences is not None:
        data["largest_difference_from_linear"] = dict(zip(STATES, result.differences.tolist(), strict=True))
    if law is not None:
        data["policy"] = {"law": law.name, "online": law.online, "certified_from": law.certified_from}
        if len(law.gains):
            data["policy"] |= {"state_units": list(LINEAR_UNITS), "K": law.gains[-1]}
        if isinstance(law.policy, ServoPolicy):
            errors = _tracked(result, law.policy)
            data["commanded"] = {
                each.name: {"rms_error": each.rms, "largest_error": each.largest, "unit": each.unit} for each in errors
            }
    return data


def _records(result: NonlinearFlight) -> Table:
    """One row a tick: time, states, inputs and the air, each with its unit; an array, because a flight may be long."""
    every = slice(None, None, result.scenario.steps_per_tick)
    parts = [result.flight.times[every, None], result.states[every], result.inputs[every]]
    updrafts = result.flight.updrafts[every].reshape(len(parts[0]), -1)
    rows: Any = np.hstack([*parts, updrafts, result.angles_of_attack[every, None]])
    names = ("updraft",) if updrafts.shape[1] == 1 else ("updraft_center", "updraft_outer")
    air = dict.fromkeys(names, "ft/s") | {ANGLE_OF_ATTACK: STATE_UNITS.alpha}
    units = {"time": "s"} | STATE_UNITS._asdict() | INPUT_UNITS._asdict() | air
    return Table(tuple(f"{name} [{unit}]" for name, unit in units.items()), rows)
