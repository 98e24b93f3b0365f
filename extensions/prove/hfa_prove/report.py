"""Reports of proofs: text, tables and data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.certificate import kind_of
from hfa_prove.check import Proved
from hfa_prove.hfa import identity_of
from hfa_prove.results import (
    Content,
    ProofCheck,
    _not_covered,
    breakpoint_data,
    schedule_data,
)
from hfa_prove.statements.flight import Flight
from hfa_prove.statements.game import SAME_GAIN, GameStatement, Plant, Weights
from hfa_prove.statements.schedule import (
    Controller,
    Run,
    ScheduleStatement,
    UncertainActuators,
)
from hfa_prove.subject import qualified
from hfa_prove.words import at_least, at_most
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, matrix_table, numbered


def proof_report(statement: ScheduleStatement | GameStatement, data: Content) -> Report:
    """Return the report of a proof.

    statement: the proved statement
    data: data of the report
    """
    if isinstance(statement, ScheduleStatement):
        moving = {"dihedral_rate_deg_s", "scheduled_rate"} & data.keys()
        title = f"every {interval_text(statement.flight)}, {statement.flight.model.title}"
        parts = schedule_parts(statement, bool(moving), data)
        return Report(f"{_verdict(data)}: {title}", parts, data=data)
    return game_report(data)


def _verdict(data: Content) -> str:
    """Return the first word of the report of a schedule's proof."""
    if data["refuted"]:
        return "Refuted"
    return "Proved" if data["proved"] else "Left open"


def schedule_parts(statement: ScheduleStatement, moving: bool, data: Content) -> list[Part]:
    """Return sentences and tables about the proved, refuted and open parts of a schedule.

    The tables list the numbers of unstable modes of the loop and of the aircraft.

    moving: whether stability for a moving scheduling variable is claimed
    data: data of the report, which contain the number of boxes
    """
    flight = statement.flight
    variable = flight.model.schedule
    unit = flight.model.schedule_unit
    stable = all(run.most == 0 for run in statement.loop)
    parts: list[Part] = ["\n".join(_loop_sentences(statement, stable, data))]
    if isinstance(statement.actuators, UncertainActuators):
        parts.append(_actuators_text(statement.actuators, stable))
    rate = statement.scheduled_rate
    if rate is not None:
        parts.append(
            f"stable while the {variable} moves by at most {at_least(rate, 4)} {unit}/s, for any "
            "such motion"
        )
    elif moving:
        interval = f"{flight.low:.10g} to {flight.high:.10g}"
        parts.append(f"open: a moving {variable} from {interval} {unit}")
    parts.append(_not_covered(statement))
    for name, runs in (("loop", statement.loop), ("aircraft A", statement.modes)):
        heading = (f"{name}: {variable}, {unit}", "unstable modes")
        parts.append(
            Table(heading, [(_span(run), _count_text(run.least, run.most)) for run in runs])
        )
    return parts


def _loop_sentences(statement: ScheduleStatement, stable: bool, data: Content) -> list[str]:
    """Return sentences on the intervals where the loop is proved stable or unstable, or neither.

    stable: whether the loop is proved stable on the whole interval
    data: data of the report, which contain the number of boxes
    """
    flight = statement.flight
    unit = flight.model.schedule_unit
    every = "angle" if unit == "deg" else flight.model.schedule
    lines = []
    for run in statement.loop:
        if run.least > 0:
            modes = f"{_count_text(run.least, run.most)} unstable modes"
            lines.append(f"the loop has {modes} at every {every} from {_span(run)} {unit}")
    for run in statement.loop:
        if run.least == 0 < run.most:
            lines.append(f"open: the loop from {_span(run)} {unit}")
    if stable:
        what = _stable_loop_clause(statement)
        lines.append(f"the trim exists within its limits and {what} at every {every}")
    if len(flight.trims) != 1:
        starts = ", ".join(f"{trim.breakpoint:.10g}" for trim in flight.trims[:4])
        lines.append(f"open: whether the trims from {starts or 'any value'} on are one branch")
    hurwitz = any(run.most == 0 for run in statement.loop)
    if hurwitz and not isinstance(statement.actuators, UncertainActuators):
        lines.append(
            f"decay rate where the loop is Hurwitz: {at_least(statement.decay_rate, 6)} 1/s"
        )
    if "boxes" in data.get("loop", {}):
        counts = [data[name]["boxes"] for name in ("loop", "modes")]
        lines.append(f"boxes: {counts[0]} for the loop, {counts[1]} for the aircraft's modes")
    return lines


def _stable_loop_clause(statement: ScheduleStatement) -> str:
    """Return a clause on the loop that is proved stable."""
    if statement.actuators is not None:
        return "the loop through the actuators is stable"
    if statement.controller.A.shape[1]:
        return "the loop of aircraft and controller is stable"
    return "A - B K is Hurwitz"


def _actuators_text(actuators: UncertainActuators, stable: bool) -> str:
    """Return text about the intervals of the actuators that the statement covers.

    stable: whether the loop is proved stable. If not, the text begins with "requested".
    """
    slow, fast = actuators.bandwidth
    least, most = actuators.effectiveness
    return (
        f"{'' if stable else 'requested '}for every actuator bandwidth from {slow:g} to {fast:g} "
        f"rad/s, the same for all inputs; for effectiveness from {least:g} to {most:g}\n"
        f"and delay up to {actuators.delay:g} s of each input independently, changing at any time, "
        "as when commands are sampled and held"
    )


def _span(run: Run) -> str:
    """Return the range of scheduling values of a run as text, such as "5 to 15"."""
    return f"{run.low:.10g} to {run.high:.10g}"


def _count_text(least: int, most: int) -> str:
    """Return the number of unstable modes as text, such as "2" or "0 to 2".

    The second form is used if only bounds are proved.
    """
    return str(least) if least == most else f"{least} to {most}"


def game_report(
    data: Content, states: tuple[str, ...] = (), origin: str = "a plant", file: str = "the critic"
) -> Report:
    """Return the report of a proof about the solution of a game or about a critic.

    data: data of the proof, with "solution" or "critic" as the entry `statement`
    states: names of the rows of P, or () for z1, z2, ...
    origin: origin of the game, for the title
    file: file of the critic, for the title
    """
    if data["statement"] == "critic":
        verdict = _stabilizing(data["closed_loop_hurwitz"], f"the gain of {file}")
        title = f"{verdict}\ndistance from the exact solution of the game of {origin}"
        return Report(title, _critic_parts(data), data=data)
    verdict = "Proved" if data["proved"] else "Left open"
    title = f"{verdict}: the solution of the game of {origin}"
    return Report(title, _solution_parts(data, states), data=data)


def _stabilizing(hurwitz: bool | None, gain: str) -> str:
    """Return the first line of a report on whether a gain stabilizes.

    hurwitz: whether A - B K is proved Hurwitz or proved not Hurwitz, or None if neither is proved
    gain: description of the gain
    """
    if hurwitz is None:
        return f"Left open: whether {gain} stabilizes"
    return f"Proved: {gain} stabilizes" if hurwitz else f"Refuted: {gain} does not stabilize"


def _critic_parts(data: Content) -> list[Part]:
    """Return a table of the bounds of a critic's distances, and a line on its closed loop."""
    rows = [
        (name, at_least(bounds["at_least"], 7), at_most(bounds["at_most"], 7))
        for name, bounds in data["distances"].items()
    ]
    loop = f"A - B K with this gain: {_hurwitz(data['closed_loop_hurwitz'])}"
    return [Table(("|X - X*| / |X*|", "at least", "at most"), rows), loop]


def _solution_parts(data: Content, states: tuple[str, ...]) -> list[Part]:
    """Return a table of the claims about a solution with their results, and a table of P."""
    above = data["delta_min_above"]
    most = data["delta_min_at_most"]
    bracket = "open"
    if above is not None:
        bracket = f"above {at_least(above, 10)}, at most {at_most(most, 10)}"
    width = "" if above is None else f"{(most - above) / most:.2g}"
    words = {True: "proved", False: "refuted", None: "open"}
    statements = [
        ("the stabilizing solution exists and is unique", words[data["worst_case_hurwitz"]]),
        ("P is positive definite", words[data["positive_definite"]]),
        ("A - S P is Hurwitz", words[data["worst_case_hurwitz"]]),
        ("A - B K is Hurwitz", words[data["closed_loop_hurwitz"]]),
        ("relative radius about the printed P", at_most(data["relative_radius"], 3)),
        ("delta_min", bracket),
        ("relative width of the bracket", width),
        ("unstable modes of A", _count_text(*data["unstable_modes_between"])),
    ]
    states = states or numbered("z", len(data["P"]))
    return [
        Table(("statement", "result"), statements),
        matrix_table("P", states, states, data["P"]),
    ]


def _hurwitz(closed_loop: bool | None) -> str:
    """Return a clause on whether a closed loop is Hurwitz.

    closed_loop: True if proved Hurwitz, False if proved not Hurwitz, None if neither is proved
    """
    if closed_loop is None:
        return "open: a mode may lie on the axis"
    return "proved Hurwitz" if closed_loop else "proved not Hurwitz"


def interval_text(flight: Flight) -> str:
    """Return the interval of scheduling values as text, such as "dihedral from 5 to 15 deg"."""
    unit = flight.model.schedule_unit
    return f"{flight.model.schedule} from {flight.low:g} to {flight.high:g} {unit}"


def checked_report(verified: Proved, not_given: Sequence[str] = ()) -> Report:
    """Return the report of a statement that the checker has proved.

    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement = verified.statement
    content = statement.content()
    data: Content = {
        "schema": ProofCheck.schema,
        "statement": "check",
        "kind": kind_of(statement),
        "boxes": verified.size,
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
    else:
        parts += _game_parts(statement, data)
        lines += weights_lines(statement.weights)
        data["game"] = content["weights"]
        data["proved"] = data["closed_loop_hurwitz"] is True
        what = "exact game, the plant of a file"
        if isinstance(statement.plant, Flight):
            unit = statement.plant.model.schedule_unit
            what = f"exact game, {statement.plant.model.schedule} {statement.plant.low:g} {unit}"
    origin = "written by hfa {version} on {date}: {command}".format(**verified.written)
    parts += ["\n".join([*lines, f"boxes: {verified.size}"]), origin]
    title = qualified(f"{_checked_verdict(statement, data)}: {what}", not_given)
    return Report(title, parts, data=data)


def _checked_verdict(statement: ScheduleStatement | GameStatement, data: Content) -> str:
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
        "source": model.source.digest,
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
    return None if flight.model.source.digest else identity_of(flight.parameters)


def _aircraft_text(flight: Flight) -> str:
    model = flight.model
    identity = _identity(flight)
    if identity is not None:
        name, digest = identity
        return f"{model.name} dynamics, parameters {name} ({digest})"
    source = f", files of SHA-256 {model.source.digest[:16]}" if model.source.digest else ""
    numbers = "".join(f", {name} {value:.10g}" for name, value in flight.parameters.items())
    return f"{model.title}{source}{numbers}"


def _values_text(model: Model, values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {model.describe(name, value)}" for name, value in values.items())


def _controller_lines(statement: ScheduleStatement) -> list[str]:
    """Return lines of text about the size, signals and actuators of the controller."""
    controller: Controller = statement.controller
    lines = [
        f"controller: {len(controller.breakpoints)} breakpoints, {controller.A.shape[1]} states, "
        f"SHA-256 {_digest(statement.content()['controller'])[:16]}",
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
    count = _count_text(*statement.loop)
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
        least, most = statement.modes
        is_open = "" if least == most else "open: the number between them; "
        lines.append(f"{is_open}A has {_count_text(least, most)} unstable modes")
    if statement.decimals:
        lines.append("the distances are valid for every number that rounds to the stored doubles")
    if isinstance(statement.plant, Plant):
        for name, values in vars(statement.plant).items():
            lines.append(f"{name} = {_matrix_text(values)}")
    for name, values in statement.critic.items():
        lines.append(f"critic's {name} = {_matrix_text(values)}")
    table = Table(("|X - X*| / |X*|, X* of the exact game", "at least", "at most"), rows)
    return [table, "\n".join(lines)]


def weights_lines(weights: Weights) -> list[str]:
    """Return lines with Q, R, E and delta of a game."""
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
