"""Comparison of several deployments of one aircraft at equal trims and initial conditions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os.path import commonpath
from pathlib import Path
from typing import Any

from hfa_policy.assessed_point import AssessedPoint
from hfa_policy.assessment import Assessment
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

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"assessments": self.assessments, "ok": self.ok, "first_line": self.first_line}

    def report(self) -> Report:
        """Return a report with the table of the deployments, and their first lines."""
        rows = [_row(assessment) for assessment in self.assessments]
        origins = [assessment.deployed.deployment.origin for assessment in self.assessments]
        columns = zip(_COLUMNS, *rows, strict=True)
        width = sum(2 + max(map(len, column)) for column in columns)
        names = _short_names(origins, _WIDTH - width)
        lines = [
            f"{origin}: {assessment.first_line}"
            for origin, assessment in zip(origins, self.assessments, strict=True)
        ]
        return Report(
            self.first_line,
            (_table(names, rows), *lines),
            data=self.as_data(),
            records=_table(origins, rows),
        )


#: Columns after the name of the deployment. The delay is the first unstable one.
_COLUMNS = (
    *("verdict", "trims", "delay ms", "margin"),
    *("over LQR", "converge", "leave"),
)
#: Largest number of columns of the printed table, and of a name if the other columns are wide.
_WIDTH = 80
_NAME = 12


def _table(names: Sequence[str], rows: Sequence[tuple[str, ...]]) -> Table:
    """Return a table of the rows, each after the name of its deployment."""
    named = [(name, *row) for name, row in zip(names, rows, strict=True)]
    return Table(("deployment", *_COLUMNS), named)


def _short_names(origins: Sequence[str], longest: int) -> list[str]:
    """Return the paths below the common folder of all files."""
    longest = max(longest, _NAME)
    paths = [Path(origin).absolute() for origin in origins]
    folder = commonpath([path.parent for path in paths])
    names = [str(path.relative_to(folder)) for path in paths]
    begin = (longest - 3) // 3
    end = longest - 3 - begin
    return [name if len(name) <= longest else f"{name[:begin]}...{name[-end:]}" for name in names]


def _row(assessment: Assessment) -> tuple[str, ...]:
    """Return the row of a deployment without its name: the worst value over the trims."""
    points = assessment.points
    held = sum(point.holds for point in points)
    limits = [point.delays.limit for point in points if point.delays is not None]
    delays = [1e3 * limit for limit in limits if limit is not None]
    disks = [point.margins.disk.disk for point in points if point.margins is not None]
    flown = [point.best.policy_over_lqr for point in points if point.best is not None]
    ratios = [math.inf if each is None else each.median for each in flown]
    return (
        verdict_text(assessment.ok),
        f"{held} of {len(points)}",
        _worst(min, delays, ".4g"),
        _worst(min, disks if len(disks) == len(points) else [], ".3f"),
        _worst(max, ratios, ".4g"),
        *_flight_counts(points),
    )


def _worst(of: Callable[..., float], values: Sequence[float], form: str) -> str:
    """Return the worst value as text, or "-" if there are no values or a value is not finite."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite or len(finite) < len(values):
        return "-"
    return format(of(finite), form)


def _flight_counts(points: Sequence[AssessedPoint]) -> tuple[str, str]:
    """Return the numbers of flights that converge and that leave the envelope, over all trims."""
    flown = [point.flights for point in points if point.flights is not None]
    if not flown:
        return "-", "-"
    starts = sum(flights.starts for flights in flown)
    converging = sum(flights.returned for flights in flown)
    return f"{converging} of {starts}", f"{sum(flights.lost for flights in flown)}"
