"""Tables of an assessment: sampled loop and flights at each trim, actions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from hfa_flight.judge.assessed_point import AssessedPoint, schedule_entry
from hfa_flight.judge.endings import BALL
from hfa_flight.judge.findings import where_text
from hfa_flight.judge.weights import weights_at
from hfa_flight.plan.problem import cost_text
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.simulate.returned import RULE
from hfa_support.reporting.rows import Group, Row, Sheet, matrix_of
from hfa_support.reporting.text import Table, shown_unit

_CONVERGES = (
    f"A flight converges if it ends within {100 * BALL:g} % of the initial-condition box about the "
    "policy's equilibrium."
)


def report_parts(deployed: Deployed, points: Sequence[AssessedPoint]) -> list[Any]:
    """Return the parts of the report of an assessment, in reading order."""
    actor = deployed.deployment.actor
    other_notes = [note for note in actor.stated.notes if note not in actor.notes]  # not findings
    parts: list[Any] = ["; ".join([actor.chain, *other_notes])]
    if any(point.costs is not None for point in points):
        parts += [_weights_text(deployed, points[0]), f"{_CONVERGES} {RULE}"]
    elif any(point.flights is not None for point in points):
        parts.append(_CONVERGES)
    parts.append(_figures("sampled loop", points, loop_rows))
    parts.append(_figures("flights", points, flight_rows))
    error = points[0].integration
    if error is not None and error.is_resolved:
        parts.append(error.text())
    parts += _actions(points)
    return parts


def _weights_text(deployed: Deployed, point: AssessedPoint) -> str:
    """Return the weights of the cost as text."""
    signals = (*deployed.model.linear, *deployed.commanded)
    has_cost = deployed.deployment.cost is not None
    text = cost_text(deployed.model, signals, *weights_at(deployed, point.point))
    return f"cost: {text}" if has_cost else f"cost: {text}; the deployment has no [cost]"


def loop_rows(point: AssessedPoint) -> list[Row]:
    """Return the figures of the sampled loop at a trim, without those that do not exist."""
    limit = None if point.delays is None else point.delays.limit
    margin = None if point.margins is None else point.margins.disk.disk
    rows = [
        Row("holds", "yes" if point.holds else "no"),
        Row("radius", point.radius, note="spectral radius of the sampled loop", digits=5),
        Row("unstable at", limit, "s", "smallest unstable delay in whole samples"),
        Row("margin", margin, note="disk margin, all inputs at once", digits=3),
    ]
    if point.cost is not None:
        rows += [
            Row("cost", point.cost.worst, "%", "worst of the sampled loop above the optimum"),
            Row("mean", point.cost.mean, "%", "the same on average"),
        ]
    return [row for row in rows if _exists(row.value)]


def _exists(value: Any) -> bool:
    """Return whether a figure is there, and no number that is not finite."""
    return value is not None and not (isinstance(value, float) and not math.isfinite(value))


def flight_rows(point: AssessedPoint) -> list[Row]:
    """Return the figures of the flights at a trim, with the median of their cost ratios."""
    rows = []
    if point.flights is not None and point.disturbed is not None:
        rows += [
            Row("flown", point.flights.starts),
            Row("converge", point.flights.converged),
            Row("leave", point.flights.left_envelope),
            Row("disturbed", point.disturbed.converged, note="converge after a disturbance pulse"),
        ]
    if point.costs is not None and point.costs.ratios is not None:
        rows.append(Row("over LQR", point.costs.median, note="median ratio of costs"))
    return rows


def _at(point: AssessedPoint) -> Row:
    """Return the value of the scheduling variable at a trim as a row."""
    model = point.point.model
    for value in schedule_entry(point.point).values():
        return Row(model.schedule, value, shown_unit(model.schedule_unit))
    return Row("trim", "-")


def _figures(
    title: str, points: Sequence[AssessedPoint], rows_of: Callable[[AssessedPoint], list[Row]]
) -> Group | Table:
    """Return the rows of one trim, or a table with a row for each of several trims."""
    if len(points) == 1:
        return Group(title, tuple(rows_of(points[0])))
    return _table([[_at(point), *rows_of(point)] for point in points])


def _table(sheets: Sequence[Sequence[Row]]) -> Table:
    """Return a table with the figures of each sheet in a row."""
    columns = {row.name: row.printed_unit for sheet in sheets for row in sheet}
    cells = [{row.name: row.cells()[1] for row in sheet} for sheet in sheets]
    header = tuple(f"{name} {unit}".rstrip() for name, unit in columns.items())
    return Table(header, [tuple(row.get(name, "-") for name in columns) for row in cells])


def _actions(points: Sequence[AssessedPoint]) -> list[Group]:
    """Return the effects of the actions at the trim at which one is most reversed."""
    with_actions = [point for point in points if point.actions]
    if not with_actions:
        return []
    worst = min(with_actions, key=_least_relative_effect)
    rows = tuple(
        Row(each.action, each.effect, "1/s", f"exact gain {each.exact_effect:+.3g}", digits=3)
        for each in worst.actions
    )
    effect = "Effect of an action: by how much it lowers the sum of the loop's eigenvalues."
    return [Group(f"actions {where_text([worst], points)}", rows, (effect,))]


def _least_relative_effect(point: AssessedPoint) -> float:
    """Return the least effect of an action relative to that of the exact gain, 0 if both are 0."""
    effects = [(each.effect, each.exact_effect) for each in point.actions]
    return min(effect / exact if exact else 0.0 for effect, exact in effects)


def records_table(points: Sequence[AssessedPoint]) -> Table:
    """Return the table of the figures with all digits, one row for each trim."""
    rows = ((_at(point), *loop_rows(point), *flight_rows(point)) for point in points)
    return matrix_of([Sheet.of([("", each, ())]) for each in rows])
