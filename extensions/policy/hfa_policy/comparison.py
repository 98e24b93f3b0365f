"""Comparison of several deployments of one aircraft at equal trims and initial conditions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hfa_policy.assessment import AssessedPoint
from hfa_policy.assessment_report import Assessment
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result, Reported):
    """Assessments of several deployments on one aircraft.

    assessments: one for each deployment, in the order given.
    """

    schema = "hfa.assessments/1"
    made_by = "hfa assess"
    json_keys = "first_line ok assessments"

    assessments: tuple[Assessment, ...]

    @property
    def ok(self) -> bool:
        """True if every policy passes."""
        return all(assessment.ok for assessment in self.assessments)

    @property
    def first_line(self) -> str:
        """Verdict and number of deployments that pass."""
        count = sum(assessment.ok for assessment in self.assessments)
        return f"{verdict_text(self.ok)}: {count} of {len(self.assessments)} deployments pass"

    def report(self) -> Report:
        """Return a report with the table of the deployments, and their first lines."""
        table = Table(_HEADER, [_row(assessment) for assessment in self.assessments])
        lines = [
            f"{assessment.deployed.deployment.origin}: {assessment.first_line}"
            for assessment in self.assessments
        ]
        return Report(self.first_line, (table, *lines), data=self.as_data(), records=table)


_HEADER = (
    *("deployment", "verdict", "trims held", "radius", "unstable at ms", "disk margin"),
    *("linear cost %", "converge", "leave", "disturbed"),
)


def _row(assessment: Assessment) -> tuple[str, ...]:
    """Return the row of a deployment, with the worst value over the trims in each column.

    The delay is the shortest one among the trims that have an unstable delay.
    """
    points = assessment.points
    held = sum(point.holds for point in points)
    limits = [point.delays.limit for point in points if point.delays is not None]
    delays = [1e3 * limit for limit in limits if limit is not None]
    disks = [point.margins.disk.disk for point in points if point.margins is not None]
    costs = [point.cost.largest for point in points if point.cost is not None]
    return (
        assessment.deployed.deployment.origin,
        verdict_text(assessment.ok),
        f"{held} of {len(points)}",
        _worst(max, [point.radius for point in points], ".5f"),
        _worst(min, delays, ".4g"),
        _worst(min, disks if len(disks) == len(points) else [], ".3f"),
        _worst(max, costs, ".4g"),
        *_flown(points),
    )


def _worst(of: Callable[..., float], values: Sequence[float], form: str) -> str:
    """Return the worst value as text, or "-" if there are no values or a value is not finite.

    of: max or min
    form: format of the number
    """
    finite = [value for value in values if math.isfinite(value)]
    if not finite or len(finite) < len(values):
        return "-"
    return format(of(finite), form)


def _flown(points: Sequence[AssessedPoint]) -> tuple[str, str, str]:
    """Return the numbers of flights that converge, leave the envelope, and converge after a pulse.

    Each is a sum over the trims as text, or "-" without flights.
    """
    plain = [point.flights for point in points if point.flights is not None]
    disturbed = [point.disturbed for point in points if point.disturbed is not None]
    if not plain:
        return "-", "-", "-"
    starts = sum(flights.starts for flights in plain)
    return (
        f"{sum(flights.returned for flights in plain)} of {starts}",
        str(sum(flights.lost for flights in plain)),
        f"{sum(flights.returned for flights in disturbed)} of {starts}",
    )
