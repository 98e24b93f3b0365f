"""Report of a checked certificate."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_proof.checker.checker import Verified
from hfa_proof.checker.riccati import SAME_GAIN
from hfa_proof.checker.statement import (
    Controller,
    Flight,
    GameStatement,
    Plant,
    Run,
    ScheduleStatement,
    Statement,
    Weights,
    content_of,
    kind_of_statement,
)
from hfa_proof.flexible_aircraft import identity_of
from hfa_proof.outward import at_least, at_most
from hfa_proof.search.report import (
    INTERPOLATION_ERRORS,
    SCHEMA,
    Content,
    breakpoint_data,
    count_text,
    interval_text,
    schedule_data,
    schedule_parts,
)
from hfa_proof.subject import qualified
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table


def checked_report(verified: Verified, not_given: Sequence[str] = ()) -> Report:
    """Return the report of a statement that the checker has proved.

    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement = verified.statement
    content = content_of(statement)
    data: Content = {
        "schema": SCHEMA,
        "statement": "check",
        "kind": kind_of_statement(statement),
        "boxes": verified.boxes,
        "written": verified.written,
        "statement_sha256": _digest(content),
        "claim": content,
        "not_given": list(not_given),
    }
    lines = [f"statement: SHA-256 {data['statement_sha256'][:16]}"]
    parts: list[Part] = []
    flight = getattr(statement, "flight", getattr(statement, "plant", None))
    if isinstance(flight, Flight):
        description, of_aircraft = _flight_text_and_data(flight)
        parts.append(description)
        data |= of_aircraft
    if isinstance(statement, ScheduleStatement):
        moving = statement.scheduled_rate is not None
        result = schedule_data(statement, moving)
        data |= {name: result[name] for name in result if name not in ("schema", "statement")}
        parts += schedule_parts(statement, moving, {})
        lines += _controller_lines(statement)
        what = interval_text(statement.flight)
    elif isinstance(statement, GameStatement):
        parts += _game_parts(statement, data)
        lines += _weights_lines(statement.weights)
        data["game"] = content["weights"]
        data["proved"] = data["closed_loop_hurwitz"] is True
        what = "exact game, the plant of a file"
        if isinstance(statement.plant, Flight):
            unit = statement.plant.model.schedule_unit
            what = f"exact game, {statement.plant.model.schedule} {statement.plant.low:g} {unit}"
    else:
        rows = [
            (INTERPOLATION_ERRORS[name], at_most(error, 3))
            for name, error in statement.errors.items()
        ]
        parts.append(Table(("error of linear interpolation, at most", "bound"), rows))
        lines += _weights_lines(statement.weights)
        tables = ("breakpoints", "A", "B", "inputs", "K")
        lines.append(
            "tables, SHA-256: "
            + ", ".join(f"{name} {_digest(content[name])[:16]}" for name in tables)
        )
        data |= {"error": dict(statement.errors), "nodes": len(statement.breakpoints)}
        data["proved"] = True
        data["game"] = content["weights"]
        what = f"{len(statement.breakpoints)} models, {interval_text(statement.flight)}"
    origin = "written by hfa {version} on {date}: {command}".format(**verified.written)
    parts += ["\n".join([*lines, f"boxes: {verified.boxes}"]), origin]
    title = qualified(f"{_checked_verdict(statement, data)}: {what}", not_given)
    return Report(title, parts, data=data)


def _checked_verdict(statement: Statement, data: Content) -> str:
    """Return the first words of the report of a certificate that the checker has verified.

    A verified certificate may prove the full claim, refute it or leave it open. The words state
    which.

    data: data of the report, with the entry `proved`
    """
    if data["proved"]:
        return "Verified, proved"
    if not isinstance(statement, GameStatement):
        return "Verified, but not proved on the whole interval"
    if data["closed_loop_hurwitz"] is None:
        return "Verified, but whether the gain stabilizes is open"
    return "Verified, refuted, the gain does not stabilize"


def _flight_text_and_data(flight: Flight) -> tuple[str, Content]:
    """Return text and data about the aircraft of a statement.

    They contain the parameters with their errors, the trims and the limits.
    """
    model = flight.model
    lines = [_aircraft_text(flight)]
    lines.append(f"trims at {_values_text(model, flight.imposed)}")
    for trim in flight.trims:
        unknowns = _values_text(model, trim.unknowns)
        lines.append(f"trim at {trim.breakpoint:.10g} {model.schedule_unit}: {unknowns}")
    limits = [
        f"{name} {' to '.join(model.describe(name, end) for end in ends)}"
        for name, ends in flight.limits.items()
    ]
    lines.append(f"limits of the trims: {', '.join(limits) or 'none'}")
    if flight.spread:
        lines.append(f"for all values of {len(flight.spread)} parameters within these half-widths:")
        lines.append(_values_text(model, flight.spread))
    data: Content = {
        "dynamics": model.name,
        "source": model.extras.source[1],
        **breakpoint_data(model, [flight.low, flight.high]),
        "limits": {name: list(ends) for name, ends in flight.limits.items()},
        "spread": dict(flight.spread),
        "parameters": dict(flight.parameters),
    }
    identity = _identity(flight)
    if identity is not None:
        data["parameters"], data["parameter_hash"] = identity
    return "\n".join(lines), data


def _identity(flight: Flight) -> tuple[str, str] | None:
    """Return the name and the hash of the parameters, or None for a user's aircraft."""
    return None if flight.model.extras.source[1] else identity_of(flight.parameters)


def _aircraft_text(flight: Flight) -> str:
    model = flight.model
    identity = _identity(flight)
    if identity is not None:
        name, digest = identity
        return f"{model.name} dynamics, parameters {name} ({digest})"
    source = f", files of SHA-256 {model.extras.source[1][:16]}" if model.extras.source[1] else ""
    numbers = "".join(f", {name} {value:.10g}" for name, value in flight.parameters.items())
    return f"{model.title}{source}{numbers}"


def _values_text(model: Model, values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {model.describe(name, value)}" for name, value in values.items())


def _controller_lines(statement: ScheduleStatement) -> list[str]:
    """Return lines of text about the size, signals and actuators of the controller."""
    controller: Controller = statement.controller
    lines = [
        f"controller: {len(controller.breakpoints)} breakpoints, {controller.A.shape[1]} states, "
        f"SHA-256 {_digest(content_of(statement)['controller'])[:16]}",
        f"measurements: {', '.join(controller.measurements)}",
        f"inputs: {', '.join(controller.inputs)}",
    ]
    actuators = statement.actuators
    if actuators is not None:
        numbers = ", ".join(f"{name} {_plain(value)}" for name, value in vars(actuators).items())
        lines.append(f"actuators: {numbers}")
    return lines


def _plain(value: Any) -> str:
    entries = np.atleast_1d(np.asarray(value, dtype=float)).tolist()
    return " ".join(f"{entry:.10g}" for entry in entries)


def _game_parts(statement: GameStatement, data: Content) -> list[Part]:
    """Return a table of the distances of the critic, and text about modes and delta_min.

    The proved values are added to `data`.
    """
    rows = [
        (name, at_least(low, 6), at_most(high, 6))
        for name, (low, high) in statement.distances.items()
    ]
    least, most = statement.loop
    count = count_text(Run(0.0, 0.0, least, most))
    lines = ["open: whether A - B K with the critic's K is Hurwitz"]
    if statement.hurwitz:
        lines = ["A - B K with the critic's K is Hurwitz"]
    elif statement.hurwitz is False:
        lines = [f"A - B K with the critic's K is not Hurwitz: {count} unstable"]
    of_value = " and ".join(name for name in ("P", "W") if name in statement.critic)
    if statement.gain_of_value:
        lines.append(f"the critic's K is the gain of its {of_value}, to within {SAME_GAIN:g}")
    elif of_value:
        lines.append(f"the critic's K is not the gain of its {of_value}")
    data["distances"] = dict(statement.distances)
    data["closed_loop_hurwitz"] = statement.hurwitz
    if statement.delta_min is not None and statement.modes is not None:
        above, value = statement.delta_min
        data["delta_min_above"] = above
        data["delta_min_at_most"] = value
        data["unstable_modes_between"] = list(statement.modes)
        lines.append(f"delta_min is above {at_least(above, 10)}, at most {at_most(value, 10)}")
        modes = Run(0.0, 0.0, *statement.modes)
        count = "" if modes.least == modes.most else "open: the number between them; "
        lines.append(f"{count}A has {count_text(modes)} unstable modes")
    if statement.decimals:
        lines.append("the distances are valid for every number that rounds to the stored doubles")
    if isinstance(statement.plant, Plant):
        for name, values in vars(statement.plant).items():
            lines.append(f"{name} = {_matrix_text(values)}")
    for name, values in statement.critic.items():
        lines.append(f"critic's {name} = {_matrix_text(values)}")
    table = Table(("|X - X*| / |X*|, X* of the exact game", "at least", "at most"), rows)
    return [table, "\n".join(lines)]


def _weights_lines(weights: Weights) -> list[str]:
    lines = [f"{name} = {_matrix_text(getattr(weights, name))}" for name in "QRE"]
    return [*lines, f"delta = {weights.delta:.10g}"]


def _matrix_text(values: np.ndarray) -> str:
    """Return a matrix as short text: "I", its diagonal, or its size and SHA-256."""
    diagonal = np.diag(values)
    if values.shape[0] == values.shape[1] and np.array_equal(values, np.diag(diagonal)):
        if set(diagonal.tolist()) == {1.0}:
            return "I"
        return f"diag({', '.join(f'{entry:.10g}' for entry in diagonal)})"
    rows, columns = values.shape
    return f"matrix {rows} x {columns}, SHA-256 {_digest(values.tolist())[:16]}"


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()
