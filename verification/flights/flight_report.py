"""What a nonlinear flight and a schedule say: text for a person, data and tables for files."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from controller.flight.envelope import Departure, Envelope
from controller.flight.gain_plan import GainPlan
from controller.flight.signals import Signal, TimeVector
from controller.flight.simulate import NonlinearFlight, Scenario
from hfa_model.support.checks import Check, checks_text
from hfa_model.support.text import Table, columns, in_degrees
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, STATES
from verification.flights.scheduling import CertifiedSchedule

FLIGHT_SCHEMA = "hfa.flight/1"
#: Numbers smaller than this are rounding and shown as 0.
_ROUNDING = 1e-12
_ROWS = [STATES.index(name) for name in LINEAR_STATES]


def flight_data(result: NonlinearFlight, plan: GainPlan | None, checks: tuple[Check, ...]) -> dict[str, Any]:
    """The outcome without its history, ready for JSON; English units and radians."""
    differences = result.differences
    data: dict[str, Any] = {
        "schema": FLIGHT_SCHEMA,
        "dynamics": result.point.dynamics,
        "states": list(STATES),
        "state_units": list(STATE_UNITS),
        "inputs": list(INPUTS),
        "input_units": list(INPUT_UNITS),
        "operating_point": result.point.to_dict(),
        "scenario": _scenario_data(result.scenario),
        "envelope": envelope_data(result.envelope),
        "held": result.departure is None,
        "departure": None if result.departure is None else result.departure._asdict(),
        "flown": float(result.flight.times[-1]),
        "final": dict(zip(STATES, result.states[-1].tolist(), strict=True)),
        "largest_deviation": dict(zip(STATES, np.abs(result.flight.states).max(axis=0).tolist(), strict=True)),
        "rms_error": dict(zip(LINEAR_STATES, result.rms_errors.tolist(), strict=True)),
        "share_beyond_control_limits": dict(zip(INPUTS, result.beyond_limits.tolist(), strict=True)),
        "checks": [check.to_dict() for check in checks],
    }
    if differences is not None:
        data["largest_difference_from_linear"] = dict(zip(STATES, differences.tolist(), strict=True))
    if plan is not None:
        data["policy"] = {
            "law": plan.law,
            "online": plan.online,
            "certified_from": plan.certified_from,
            "K": plan.gains[-1],
        }
    return data


def with_history(data: dict[str, Any], result: NonlinearFlight) -> dict[str, Any]:
    """The same with the flight once a tick: times (N,), states (N, 7) and inputs (N, 5) absolute, errors, updrafts."""
    every = slice(None, None, result.scenario.steps_per_tick)
    return data | {
        "history": {
            "times": result.flight.times[every],
            "states": result.states[every],
            "inputs": result.inputs[every],
            "errors": result.flight.errors[every],
            "updrafts": result.flight.updrafts[every],
        }
    }


def flight_table(result: NonlinearFlight) -> Table:
    """One row a tick: time, states, inputs, updraft, each with its unit."""
    every = slice(None, None, result.scenario.steps_per_tick)
    parts = [result.flight.times[every, None], result.states[every], result.inputs[every]]
    rows = np.hstack([*parts, result.flight.updrafts[every, None]])
    units = {"time": "s"} | STATE_UNITS._asdict() | INPUT_UNITS._asdict() | {"updraft": "ft/s"}
    return Table(tuple(f"{name} [{unit}]" for name, unit in units.items()), [tuple(row) for row in rows.tolist()])


def flight_text(result: NonlinearFlight, plan: GainPlan | None, checks: tuple[Check, ...], title: str) -> str:
    """Outcome, states against the envelope and the linear prediction, inputs against the control limits."""
    parts = [f"{title}\n{verdict(result.departure, result.flight.times[-1])}"]
    if plan is not None and plan.online:
        parts.append(_learning_text(plan))
    parts += [_states_text(result), _inputs_text(result)]
    if checks:
        parts.append(checks_text(checks))
    return "\n\n".join(parts)


def _states_text(result: NonlinearFlight) -> str:
    final, largest, differences = result.flight.states[-1], np.abs(result.flight.states).max(axis=0), result.differences
    rows = []
    for index, (name, unit) in enumerate(zip(STATES, STATE_UNITS, strict=True)):
        cells = [name, unit_text(unit), number_text(largest[index], unit), number_text(final[index], unit)]
        cells += [number_text(result.rms_errors[_ROWS.index(index)], unit) if index in _ROWS else ""]
        cells += [limits_text(result.envelope, index)]
        cells += [] if differences is None else [number_text(differences[index], unit)]
        rows.append(tuple(cells))
    header = ("state", "unit", "largest deviation", "final deviation", "rms error", "envelope", "off the linear model")
    return columns(header[: len(rows[0])], rows)


def _inputs_text(result: NonlinearFlight) -> str:
    low, high, beyond = result.inputs.min(axis=0), result.inputs.max(axis=0), result.beyond_limits
    rows = [
        (name, unit_text(unit), number_text(low[i], unit), number_text(high[i], unit), f"{100 * beyond[i]:.3g} %")
        for i, (name, unit) in enumerate(zip(INPUTS, INPUT_UNITS, strict=True))
    ]
    return columns(("input", "unit", "lowest", "highest", "time beyond control limits"), rows)


def verdict(departure: Departure | None, time: float) -> str:
    """Whether the flight stayed in its envelope, and if not, what left it."""
    if departure is None:
        return f"held: {time:g} s inside the envelope"
    unit = getattr(STATE_UNITS, departure.state)
    return (
        f"left the envelope: {departure.state} first, at {departure.time:.4g} s, "
        f"{number_text(departure.value, unit)} {unit_text(unit)} beyond {number_text(departure.limit, unit)}"
    )


def schedule_text(certified: CertifiedSchedule, law: str) -> str:
    """One row a grid point, and what holds between them."""
    rows = [
        (
            f"{in_degrees(row.point.states.dihedral):g}",
            f"{row.control_abscissa:.4f}",
            f"{row.game_abscissa:.4f}",
            f"{row.distance:.1e}" if law != "exact" else "0",
            f"{row.certificates} hold",
        )
        for row in certified.grid
    ]
    header = ("dihedral deg", "abscissa A-BK 1/s", "abscissa A-SP 1/s", "K off the exact", "certificates")
    between = f"halfway between the points, interpolated gain: largest abscissa of A-BK {certified.between:.4f} 1/s"
    return columns(header, rows) + "\n" + between


def schedule_data(certified: CertifiedSchedule, law: str) -> dict[str, Any]:
    """The grid, ready for JSON."""
    return {
        "law": law,
        "dihedrals": certified.schedule.dihedrals,
        "gains": certified.schedule.gains,
        "control_abscissae": [row.control_abscissa for row in certified.grid],
        "game_abscissae": [row.game_abscissa for row in certified.grid],
        "distances_from_exact": [row.distance for row in certified.grid],
        "largest_abscissa_between": certified.between,
    }


def _scenario_data(scenario: Scenario) -> dict[str, Any]:
    return {
        "duration": scenario.duration,
        "step": scenario.step,
        "tick": scenario.tick,
        "initial": scenario.initial,
        "errors": dict(scenario.errors),
        "reference": _signal_data(scenario.reference),
        "disturbance": _signal_data(scenario.disturbance),
        "noise": _signal_data(scenario.noise),
        "actuators": None if scenario.actuators is None else asdict(scenario.actuators),
        "gust": None if scenario.gust is None else _gust_data(scenario.gust),
    }


def _gust_data(gust: Any) -> dict[str, Any]:
    return {"kind": type(gust).__name__, **asdict(gust)}


def _signal_data(signal: TimeVector) -> dict[str, Any] | str:
    if not isinstance(signal, Signal):
        return type(signal).__name__
    harmonics = [{"frequency": h.frequency, "sine": h.sine, "cosine": h.cosine} for h in signal.harmonics]
    return {"constant": signal.constant, "slope": signal.slope, "harmonics": harmonics}


def envelope_data(envelope: Envelope) -> dict[str, list[float]]:
    """State -> [lowest, highest], absolute."""
    return {name: [getattr(envelope.lowest, name), getattr(envelope.highest, name)] for name in STATES}


def limits_text(envelope: Envelope, index: int) -> str:
    """The limits of a state, degrees for angles."""
    unit = STATE_UNITS[index]
    return f"{number_text(envelope.lowest[index], unit)} to {number_text(envelope.highest[index], unit)}"


def _learning_text(plan: GainPlan) -> str:
    if plan.learned is None:
        return ""
    taking_over = f"at {plan.certified_from:g} s" if np.isfinite(plan.certified_from) else "never"
    last = plan.learned.times[-1]
    return (
        f"learning in flight: the baseline flies until the first stabilizing certificate, {taking_over}; "
        f"then the last certified gain of each tick; at {last:g} s, the end of the learning, every certificate holds"
    )


def unit_text(unit: str) -> str:
    """A unit as a person reads it: degrees for radians."""
    return unit.replace("rad", "deg")


def number_text(value: float, unit: str) -> str:
    """A number of that unit, degrees for radians, four digits or more."""
    shown = float(np.degrees(value)) if unit.startswith("rad") else float(value)
    shown = 0.0 if abs(shown) < _ROUNDING else shown
    return f"{shown:.0f}" if 1e4 <= abs(shown) < 1e7 else f"{shown:.4g}"
