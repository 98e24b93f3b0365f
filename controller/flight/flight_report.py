"""What a nonlinear flight says."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.flight.envelope import ANGLE_OF_ATTACK, Departure, Envelope
from controller.flight.simulate import NonlinearFlight
from controller.flight.tracking import Tracked, tracked, tracking_table
from controller.policy.flown_law import FlownLaw
from controller.policy.servo_policy import ServoPolicy
from hfa_model.reporting.checks import Check, checks_block
from hfa_model.reporting.report import Part, Report
from hfa_model.reporting.text import Table, in_degrees, short_number, shown_unit
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, STATES, UNITS

FLIGHT_SCHEMA = "hfa.flight/1"
#: Said where the air moves.
OVER_GROUND = f"alpha is over ground; the envelope limits {ANGLE_OF_ATTACK}, which is through the air"
_ROWS = [STATES.index(name) for name in LINEAR_STATES]


def flight_report(result: NonlinearFlight, law: FlownLaw | None = None, checks: tuple[Check, ...] = ()) -> Report:
    """Outcome, states against the envelope and the linear prediction, inputs against the control limits.

    law: what was flown, for the title and the data. data: without the flight itself, which is `history`.
    """
    kind = "" if law is None or not len(law.gains) else f", {'learning in flight' if law.online else 'frozen'}"
    words = "" if law is None else f", law {law.name}{kind}"
    parts: list[Part] = [] if law is None or not law.online else [_learning(law)]
    parts += [_states(result), *([OVER_GROUND] if result.scenario.moving_air else []), _inputs(result)]
    if law is not None and isinstance(law.policy, ServoPolicy) and law.policy.commands.names:
        parts.insert(0, tracking_table(_tracked(result, law.policy)))
    if checks:
        parts.append(checks_block(checks))
    return Report(title(result, words), parts, data=_data(result, law, checks), records=_records(result))


def _tracked(result: NonlinearFlight, policy: ServoPolicy) -> tuple[Tracked, ...]:
    return tracked(result, policy.regulated, policy.commands)


def title(result: NonlinearFlight, law: str) -> str:
    """Which flight, and whether it stayed in its envelope."""
    dihedral = in_degrees(result.point.states.dihedral)
    flight = f"Flight, {result.point.dynamics} dynamics, dihedral {dihedral:g} deg{law}"
    return f"{flight}\n{_outcome(result.departure, result.flight.times[-1])}"


def history(result: NonlinearFlight) -> dict[str, Any]:
    """The flight once a tick: times (N,), states (N, 7), inputs (N, 5), angles of attack absolute, errors, updrafts."""
    every = slice(None, None, result.scenario.steps_per_tick)
    return {
        "history": {
            "times": result.flight.times[every],
            "states": result.states[every],
            "inputs": result.inputs[every],
            "errors": result.flight.errors[every],
            "updrafts": result.flight.updrafts[every],
            "angles_of_attack": result.angles_of_attack[every],
        }
    }


def limits_text(envelope: Envelope, index: int) -> str:
    """The limits of a state, degrees for angles."""
    unit = STATE_UNITS[index]
    return f"{short_number(envelope.lowest[index], unit)} to {short_number(envelope.highest[index], unit)}"


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
        cells += [short_number(result.rms_errors[_ROWS.index(index)], unit) if index in _ROWS else ""]
        cells += [limits_text(result.envelope, index)]
        cells += [] if differences is None else [short_number(differences[index], unit)]
        rows.append(tuple(cells))
        if name == "alpha" and result.scenario.moving_air:
            deviations = result.angles_of_attack - result.point.states.alpha
            shown = (short_number(value, unit) for value in (np.abs(deviations).max(), deviations[-1]))
            limited = (ANGLE_OF_ATTACK, shown_unit(unit), *shown, "", limits_text(result.envelope, index), "")
            rows[-1] = (*cells[:5], "", *cells[6:])
            rows.append(limited[: len(cells)])
    header = ("state", "unit", "largest deviation", "final deviation", "rms error", "envelope", "off the linear model")
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
        "states": list(STATES),
        "state_units": list(STATE_UNITS),
        "inputs": list(INPUTS),
        "input_units": list(INPUT_UNITS),
        "operating_point": result.point.to_dict(),
        "scenario": result.scenario.to_dict(),
        "envelope": result.envelope.to_dict(result.scenario.moving_air),
        "held": result.departure is None,
        "departure": None if result.departure is None else result.departure._asdict(),
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
        data["policy"] |= {"K": law.gains[-1]} if len(law.gains) else {}
        if isinstance(law.policy, ServoPolicy):
            errors = _tracked(result, law.policy)
            data["commanded"] = {each.name: {"rms_error": each.rms, "largest_error": each.largest} for each in errors}
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
