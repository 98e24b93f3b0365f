"""Tables of an assessment: sampled loop and flights at each trim."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from controller.game.linear_game import matrix_text
from hfa_flight.judge.assessed_point import AssessedPoint, schedule_entry
from hfa_flight.judge.flight_costs import weights_at
from hfa_flight.judge.outcomes import BALL, Outcomes
from hfa_flight.plan.problem import cost_text
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.reporting.rows import Group, Row, Sheet, matrix_of
from hfa_support.reporting.text import Table, beside_unit, short_number, shown_unit

#: An equilibrium closer to the trim, relative to the initial-condition box, counts as the trim.
_AT_TRIM = 0.01
#: Largest number of trims that are listed.
_MOST_LISTED = 3


class Severity(StrEnum):
    """Severity of a finding, the worst first."""

    FAILURE = "failure"
    WARNING = "warning"
    NOTE = "note"


class Finding(NamedTuple):
    """Finding of an assessment.

    severity: "failure" if the policy fails because of it, else "warning" or "note".
    text: one sentence, with the trims if the finding does not concern all.
    """

    severity: Severity
    text: str


class _AtTrim(NamedTuple):
    """Finding at one trim. Of those of the same kind, that with the largest size is the worst."""

    severity: Severity
    text: str
    size: float = 0.0


def findings_at_trims(points: Sequence[AssessedPoint]) -> list[Finding]:
    """Return the findings at all trims, worst first.

    Of several findings of one kind, that at the worst trim is returned, with the number of trims.
    """
    findings: list[Finding] = []
    for kind in _KINDS:
        by_trim = [(point, kind(point)) for point in points]
        of_kind = [finding for _, finding in by_trim if finding is not None]
        if not of_kind:
            continue
        worst = max(of_kind, key=lambda finding: finding.size)
        alike = [point for point, finding in by_trim if finding and finding.text == worst.text]
        text = _with_trims(worst.text, alike, points)
        if len(of_kind) > len(alike):
            text += f" (worst of {len(of_kind)} trims)"
        findings.append(Finding(worst.severity, text))
    for remark in dict.fromkeys(remark for point in points for remark in point.remarks):
        alike = [point for point in points if remark in point.remarks]
        findings.append(Finding(Severity.NOTE, _with_trims(remark, alike, points)))
    return worst_first(findings)


def _with_trims(text: str, points: Sequence[AssessedPoint], among: Sequence[AssessedPoint]) -> str:
    """Return a finding with the trims that it concerns, unless it concerns all."""
    return text if len(points) == len(among) else f"{where_text(points, among)}: {text}"


def worst_first(findings: Sequence[Finding]) -> list[Finding]:
    """Return findings ordered by severity. Findings of equal severity keep their order."""
    order = list(Severity)
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def where_text(points: Sequence[AssessedPoint], among: Sequence[AssessedPoint]) -> str:
    """Return trims as text, such as "from 38 to 60 m/s" or "at 45 m/s".

    Without a scheduling variable, the text is "at the trim". A range is given only if no other trim
    lies inside.

    among: all trims of the assessment
    """
    model = among[0].point.model
    values = [value for point in points for value in schedule_entry(point.point).values()]
    if not values:
        return "at the trim"
    unit = shown_unit(model.schedule_unit)
    if min(values) == max(values):
        return f"at {values[0]:.4g} {unit}"
    every = [value for point in among for value in schedule_entry(point.point).values()]
    inside = [value for value in every if min(values) <= value <= max(values)]
    if len(inside) == len(values):
        return f"from {min(values):.4g} to {max(values):.4g} {unit}"
    listed = ", ".join(f"{value:.4g}" for value in values[:_MOST_LISTED])
    more = len(values) - _MOST_LISTED
    return f"at {listed} {unit}" + (f" and {more} more" if more > 0 else "")


# Kinds of findings. Each function returns the finding of its kind at one trim, or None.


def _of_linear(point: AssessedPoint) -> Severity:
    """Return the severity of a linear figure, which decides only without flights."""
    return Severity.FAILURE if point.flights is None else Severity.WARNING


def _no_equilibrium(point: AssessedPoint) -> _AtTrim | None:
    """Return the failure of a policy without an equilibrium."""
    if point.equilibrium is not None:
        return None
    return _AtTrim(_of_linear(point), "no equilibrium near the trim")


def _saturation(point: AssessedPoint) -> _AtTrim | None:
    """Return the failure of an equilibrium at which actions or inputs are saturated."""
    if point.equilibrium is None or not point.equilibrium.clips:
        return None
    what = " and ".join(point.equilibrium.clips)
    text = f"saturated at the equilibrium: {what}"
    return _AtTrim(_of_linear(point), text)


def _beyond_limits(point: AssessedPoint) -> _AtTrim | None:
    """Return the failure of an equilibrium beyond the limits of a state."""
    if not point.beyond:
        return None
    return _AtTrim(_of_linear(point), f"at the equilibrium, {point.beyond[0]}")


def _instability(point: AssessedPoint) -> _AtTrim | None:
    """Return the failure of a sampled loop that is unstable at its equilibrium."""
    if not point.radius >= 1.0:
        return None
    text = f"unstable at its equilibrium (spectral radius {point.radius:.5f})"
    return _AtTrim(_of_linear(point), text, size=point.radius)


def _leaving_flights(point: AssessedPoint, flown: Outcomes | None, when: str) -> _AtTrim | None:
    """Return the finding on the flights that leave the envelope."""
    if flown is None or not flown.left_envelope:
        return None
    text = f"{when}{flown.left_envelope} of {flown.starts} flights leave the envelope"
    if flown.departure is not None:
        text += f" (first: {flown.departure.cause()})"
    severity = Severity.WARNING if point.holds else Severity.FAILURE
    return _AtTrim(severity, text, size=flown.left_envelope)


def _convergence(point: AssessedPoint) -> _AtTrim | None:
    """Return the finding on the flights that stay and do not converge."""
    flown = point.flights
    if flown is None:
        return _AtTrim(Severity.NOTE, "no flight was simulated")
    staying = flown.starts - flown.left_envelope - flown.converged
    if staying:
        text = f"{staying} of {flown.starts} flights do not converge within {flown.seconds:.3g} s"
        severity = Severity.WARNING if point.holds else Severity.FAILURE
        return _AtTrim(severity, text, size=staying)
    return None


def _smaller_box(point: AssessedPoint) -> _AtTrim | None:
    """Return the note that the exact gain leaves the envelope from the whole box."""
    if point.box < 1.0:
        percent_of_box = f"{100.0 * point.box:.0f} % of the initial-condition box"
        text = (
            f"flights begin in {percent_of_box}, the largest in which the exact gain stays inside"
        )
        return _AtTrim(Severity.WARNING, text, size=1.0 - point.box)
    if point.costs is None or not point.costs.exact_left:
        return None
    text = f"{point.costs.exact_left} of {point.costs.flights} flights of the exact gain leave"
    return _AtTrim(Severity.WARNING, text, size=point.costs.exact_left)


def _delay(point: AssessedPoint) -> _AtTrim | None:
    """Return the delay at which the loop becomes unstable. The least one is the worst."""
    if point.delays is None or not point.holds:
        return None
    limit = point.delays.limit
    if limit is None:
        longest = point.delays.searched
        text = f"stable with the examined delays up to {1e3 * longest:.4g} ms"
        return _AtTrim(Severity.NOTE, text, size=-longest)
    return _AtTrim(Severity.NOTE, f"unstable with {1e3 * limit:.4g} ms of delay", size=-limit)


def _steady_state_error(point: AssessedPoint) -> _AtTrim | None:
    """Return the finding on the steady-state error at a stable equilibrium."""
    offset = point.offset
    if offset is None or not point.holds:
        return None
    model = point.point.model
    shares = np.abs(offset) / point.case.sizes  # of the half-width in each linear state
    index = int(np.argmax(shares))
    if shares[index] < _AT_TRIM:
        return _AtTrim(Severity.NOTE, "no steady-state error")
    name = model.linear[index]
    unit = model.unit(name)
    sign = "+" if offset[index] > 0.0 else "-"
    size = beside_unit(short_number(abs(float(offset[index])), unit), unit)
    text = f"steady-state {name} error {sign}{size}, so that its cost grows with time"
    return _AtTrim(Severity.WARNING, text, size=float(shares[index]))


def _clipped_observations(point: AssessedPoint) -> _AtTrim | None:
    """Return the warning that the normalizer clips observations at the equilibrium."""
    if point.equilibrium is None or not point.equilibrium.clipped_observations:
        return None
    names = ", ".join(point.equilibrium.clipped_observations)
    return _AtTrim(Severity.WARNING, f"the normalizer clips {names} at the equilibrium")


def _integration(point: AssessedPoint) -> _AtTrim | None:
    """Return the warning that the integration of the flights is not accurate."""
    error = point.integration
    if error is None or error.is_resolved:
        return None
    return _AtTrim(Severity.WARNING, error.text())


#: Kinds of findings, in the order of the report.
_KINDS: tuple[Callable[[AssessedPoint], _AtTrim | None], ...] = (
    *(_no_equilibrium, _saturation, _beyond_limits),
    lambda point: _leaving_flights(point, point.flights, ""),
    *(_instability, _convergence, _smaller_box),
    lambda point: _leaving_flights(point, point.disturbed, "with a disturbance pulse: "),
    _clipped_observations,
    *(_delay, _steady_state_error),
    _integration,
)


_RULE_OF_CONVERGENCE = (
    f"A flight converges if it ends within {100 * BALL:g} % of the initial-condition box about the "
    "policy's equilibrium, and the distances of most flights do not grow."
)
_RULE_WITH_ERRORS = (
    "Errors of sensors do not end: a flight converges if it stays within the limits. Flights of "
    "the exact gain, figures of the sampled loop and the steady-state error are without them."
)


def report_parts(
    deployed: Deployed, points: Sequence[AssessedPoint], *, with_errors: bool
) -> list[Any]:
    """Return the parts of the report of an assessment, in reading order.

    with_errors: whether the flights have sensors
    """
    rule = _RULE_WITH_ERRORS if with_errors else _RULE_OF_CONVERGENCE
    actor = deployed.deployment.actor
    # The notes in `actor.notes` are findings; the others have no other place in the report.
    other_notes = [note for note in actor.declared.notes if note not in actor.notes]
    parts: list[Any] = ["; ".join([actor.chain, *other_notes])]
    if any(point.costs is not None for point in points):
        parts += [_weights_text(deployed, points[0]), rule]
    elif any(point.flights is not None for point in points):
        parts.append(rule)
    parts.append(_figures("sampled loop", points, loop_rows))
    parts.append(_figures("flights", points, flight_rows))
    error = points[0].integration
    if error is not None and error.is_resolved:
        parts.append(error.text())
    return parts


def _weights_text(deployed: Deployed, point: AssessedPoint) -> str:
    """Return the weights of the cost as text."""
    signals = (*deployed.model.linear, *deployed.commanded)
    weights = weights_at(deployed, point.point)
    if deployed.deployment.cost is None:
        return f"cost: {cost_text(deployed.model, signals, *weights)}"
    shown = (f"{name} {matrix_text(each)}" for name, each in zip("QR", weights, strict=True))
    return f"cost of {deployed.deployment.origin}: {', '.join(shown)}"


def loop_rows(point: AssessedPoint) -> list[Row]:
    """Return the figures of the sampled loop at a trim, without those that do not exist."""
    limit = None if point.delays is None else point.delays.limit
    margin = None if point.margins is None else point.margins.disk.disk
    rows = [
        Row("holds", "yes" if point.holds else "no"),
        Row("radius", point.radius, note="spectral radius of the sampled loop", digits=5),
        Row("unstable at", limit, "s", "smallest unstable delay", digits=4),
        Row("margin", margin, note="disk margin, all inputs at once", digits=3),
    ]
    return [row for row in rows if _exists(row.value)]


def _exists(value: Any) -> bool:
    """Return whether a figure is neither None nor a number that is not finite."""
    return value is not None and (not isinstance(value, float) or math.isfinite(value))


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
    if point.costs is not None:
        costs = point.costs
        rows += [
            Row("over LQR", costs.median, note=f"median ratio of costs in {costs.seconds:.3g} s"),
            Row("least", costs.low, note="end of its 95 % band"),
            Row("most", costs.high, note="the other end"),
        ]
    return rows


def _at(point: AssessedPoint) -> Row:
    """Return the value of the scheduling variable at a trim as a row, or a row without a value."""
    model = point.point.model
    entry = schedule_entry(point.point)
    if not entry:
        return Row("trim", "-")
    (value,) = entry.values()
    return Row(model.schedule, value, shown_unit(model.schedule_unit))


def _figures(
    title: str, points: Sequence[AssessedPoint], rows_of: Callable[[AssessedPoint], list[Row]]
) -> Group | Table:
    """Return the rows of one trim, or a table with a row for each of several trims."""
    if len(points) == 1:
        return Group(title, tuple(rows_of(points[0])))
    return _table([[_at(point), *rows_of(point)] for point in points])


def _table(sheets: Sequence[Sequence[Row]]) -> Table:
    """Return a table with the figures of each sheet in a row."""
    columns = {row.name: row.cells().unit for sheet in sheets for row in sheet}
    cells = [{row.name: row.cells().value for row in sheet} for sheet in sheets]
    header = tuple(f"{name} {unit}".rstrip() for name, unit in columns.items())
    return Table(header, [tuple(row.get(name, "-") for name in columns) for row in cells])


def records_table(points: Sequence[AssessedPoint]) -> Table:
    """Return the table of the figures with all digits, one row for each trim."""
    sheets = []
    for point in points:
        rows = (_at(point), *loop_rows(point), *flight_rows(point))
        sheets.append(Sheet.of([("", rows, ())]))  # one group, without a title and sentences
    return matrix_of(sheets)
