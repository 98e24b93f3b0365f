"""Reports of proofs: text, tables and data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from hfa_aircraft.model import Model
from hfa_proof.checker.statement import (
    Flight,
    GameStatement,
    ModelsStatement,
    Run,
    ScheduleStatement,
    Statement,
    UncertainActuators,
)
from hfa_proof.outward import at_least, at_most
from hfa_proof.search.results import ProofData
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, matrix_table, numbered

SCHEMA = ProofData.schema
Content = dict[str, Any]
Found = TypeVar("Found")
INTERPOLATION_ERRORS = {
    "A": "|A - interpolated| / |A|",
    "B": "|B - interpolated| / |B|",
    "K": "|K - interpolated| / |K|",
    "inputs": "|U0 - interpolated|, in nominal units",
}


def joined(runs: Sequence[tuple[float, float, Found]]) -> list[tuple[float, float, Found]]:
    """Return consecutive intervals with results, in which neighbors with equal results are merged.

    runs: (low, high, result), in ascending order
    """
    together: list[tuple[float, float, Found]] = []
    for low, high, result in runs:
        if together and together[-1][1:] == (low, result):
            together[-1] = (together[-1][0], high, result)
        else:
            together.append((low, high, result))
    return together


def gaps(runs: Sequence[Run], low: float, high: float) -> list[tuple[float, float]]:
    """Return the intervals (low, high) between `low` and `high` that no run covers, ascending.

    runs: intervals with results, in any order, which may overlap
    """
    empty = []
    reached = low
    for run in sorted(runs):
        if run.low > reached:
            empty.append((reached, run.low))
        reached = max(reached, run.high)
    if reached < high:
        empty.append((reached, high))
    return empty


def breakpoint_data(model: Model, breakpoints: Any) -> Content:
    """Return key -> scheduling values, as an entry of the data of a report.

    For the flexible aircraft, the entry is `dihedral_deg`. For another aircraft, the entry is
    `scheduled` and contains the name of the scheduling variable.
    """
    if model.extras.names_schedule:
        return {model.schedule_key: breakpoints}
    return {"scheduled": {model.schedule: breakpoints}}


def schedule_data(statement: ScheduleStatement, moving: bool) -> Content:
    """Return the data of a statement about a schedule: proved, refuted and open intervals.

    moving: whether a rate of the scheduling variable is claimed
    """
    flight = statement.flight
    model = flight.model
    suffix = "_deg" if model.schedule_unit == "deg" else ""

    def ends(run: Run, **more: Any) -> Content:
        return {f"from{suffix}": run.low, f"to{suffix}": run.high} | more

    def counted(runs: Sequence[Run]) -> list[Content]:
        return [ends(run, unstable=run.least) for run in runs if run.least == run.most]

    refuted = [ends(run, unstable=run.least) for run in statement.loop if run.least > 0]
    still_open = [ends(run) for run in statement.loop if run.least == 0 < run.most]
    crossings = [
        ends(run, at_least=run.least, at_most=run.most)
        for run in statement.modes
        if run.least < run.most
    ]
    stable = not (refuted or still_open)
    one_branch = len(flight.trims) == 1
    data: Content = {
        "schema": SCHEMA,
        "statement": "schedule",
        "dynamics": model.name,
        **breakpoint_data(model, [flight.low, flight.high]),
        "proved": stable and one_branch and not (moving and statement.scheduled_rate is None),
        "one_branch": one_branch,
        "decay_rate": statement.decay_rate,
        "loop": {"proved": counted(statement.loop), "open": still_open},
        "modes": {"proved": counted(statement.modes), "open": crossings},
        "refuted": refuted,
        "not_covered": _not_covered(statement),
    }
    if isinstance(statement.actuators, UncertainActuators):
        names = ("bandwidth", "effectiveness", "delay")
        data["actuators"] = {name: getattr(statement.actuators, name) for name in names}
    if moving:
        key = f"{model.schedule}_rate_deg_s" if model.extras.names_schedule else "scheduled_rate"
        data[key] = statement.scheduled_rate or 0.0
    return data


def _not_covered(statement: ScheduleStatement) -> str:
    others = "other actuators"
    if not isinstance(statement.actuators, UncertainActuators):
        others = "actuators outside the loop, delay"
    return (
        f"not covered: {others}, sampling of the states of a controller, a "
        f"{statement.flight.model.schedule} that the loop itself\nmoves, limits of the inputs, the "
        "nonlinear aircraft"
    )


def proof_report(statement: Statement, data: Content) -> Report:
    """Return the report of a proof.

    statement: the proved statement
    data: data of the report
    """
    if isinstance(statement, ScheduleStatement):
        moving = {"dihedral_rate_deg_s", "scheduled_rate"} & data.keys()
        title = f"every {interval_text(statement.flight)}, {statement.flight.model.title}"
        parts = schedule_parts(statement, bool(moving), data)
        return Report(f"{_verdict(statement, bool(moving))}: {title}", parts, data=data)
    if isinstance(statement, GameStatement):
        return game_report(data)
    return _models_report(statement, data)


def _verdict(statement: ScheduleStatement, moving: bool) -> str:
    if any(run.least > 0 for run in statement.loop):
        return "Refuted"
    if any(run.most > 0 for run in statement.loop) or len(statement.flight.trims) != 1:
        return "Left open"
    return "Proved"


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
        parts.append(Table(heading, [(_span(run), count_text(run)) for run in runs]))
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
            modes = f"{count_text(run)} unstable modes"
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


def count_text(run: Run) -> str:
    """Return the number of unstable modes as text, such as "2" or "0 to 2".

    The second form is used if only bounds are proved.
    """
    return str(run.least) if run.least == run.most else f"{run.least} to {run.most}"


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
    least_modes, most_modes = data["unstable_modes_between"]
    statements = [
        ("the stabilizing solution exists and is unique", words[data["worst_case_hurwitz"]]),
        ("P is positive definite", words[data["positive_definite"]]),
        ("A - S P is Hurwitz", words[data["worst_case_hurwitz"]]),
        ("A - B K is Hurwitz", words[data["closed_loop_hurwitz"]]),
        ("relative radius about the printed P", at_most(data["relative_radius"], 3)),
        ("delta_min", bracket),
        ("relative width of the bracket", width),
        ("unstable modes of A", count_text(Run(0.0, 0.0, least_modes, most_modes))),
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


def _models_report(statement: ModelsStatement, data: Content) -> Report:
    """Return the report of interpolated models.

    The report contains the bounds of the errors and the steps between breakpoints. The records
    contain the matrices.
    """
    model = statement.flight.model
    breakpoints = statement.breakpoints
    unit = model.schedule_unit
    steps = np.diff(breakpoints)
    every = "angle" if unit == "deg" else model.schedule
    bounds = [
        (INTERPOLATION_ERRORS[name], at_most(error, 3)) for name, error in statement.errors.items()
    ]
    heading = (model.schedule_key, "matrix", "row", "column", "value", "unit")
    return Report(
        title=f"Proved: {len(breakpoints)} models from {breakpoints[0]:g} to {breakpoints[-1]:g} "
        f"{unit}, {model.title}, interpolate linearly within {data['tolerance']:g}",
        parts=[
            Table((f"error at every {every} between, at most", "bound"), bounds),
            f"steps from {steps.min():g} to {steps.max():g} {unit}",
        ],
        data=data,
        records=Table(heading, _entries(statement)),
    )


def _entries(statement: ModelsStatement) -> list[tuple[Any, ...]]:
    """Return one row (breakpoint, matrix, row, column, value, unit) for each entry of the models.

    The entries are those of A, B, K and the trim inputs U0.
    """
    model = statement.flight.model
    states = model.linear
    inputs = tuple(model.inputs)
    rows: list[tuple[Any, ...]] = []
    for k, breakpoint in enumerate(statement.breakpoints.tolist()):
        for name, columns in (("A", states), ("B", inputs)):
            values = getattr(statement, name)[k]
            for (i, j), value in np.ndenumerate(values):
                unit = model.entry_unit(states[i], columns[j])
                rows.append((breakpoint, name, states[i], columns[j], float(value), unit))
        for (i, j), value in np.ndenumerate(statement.K[k]):
            unit = f"({model.unit(inputs[i])})/({model.unit(states[j])})"
            rows.append((breakpoint, "K", inputs[i], states[j], float(value), unit))
        for i, value in enumerate(statement.inputs[k].ravel().tolist()):
            rows.append((breakpoint, "U0", inputs[i], "", value, model.unit(inputs[i])))
    return rows


def interval_text(flight: Flight) -> str:
    """Return the interval of scheduling values as text, such as "dihedral from 5 to 15 deg"."""
    unit = flight.model.schedule_unit
    return f"{flight.model.schedule} from {flight.low:g} to {flight.high:g} {unit}"
