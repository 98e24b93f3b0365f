"""Stability of the linear loops of drawn aircraft, each at its own trim."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.policies.policy import OpenLoop
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result, given
from hfa_support.reporting.text import WIDTH, Table, shown_unit, shown_value, wrapped
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition
from trim.point.linearize import linearize
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, trim

#: Percentiles at the ends of a 95 % band.
_BAND = (2.5, 97.5)
#: A band that is narrower than this fraction of its ends is not listed.
_CONSTANT = 1e-9


class Band(NamedTuple):
    """Interval that contains 95 % of the drawn aircraft, with the value of the given aircraft."""

    value: float
    low: float
    high: float
    unit: str

    @classmethod
    def of(cls, value: float, drawn: Sequence[float], unit: str) -> Band:
        """Return the band of drawn values, with ends NaN if there are none."""
        low, high = np.percentile(drawn, _BAND).tolist() if len(drawn) else (np.nan, np.nan)
        return cls(float(value), low, high, unit)


@dataclass(frozen=True, eq=False)
class DrawnLoops(Result):
    """Stability of drawn aircraft.

    count, seed, parameters: number of aircraft, seed, and names of the drawn parameters
    trimmed: number of aircraft that have a trim within their limits
    stable: number of aircraft that the gain stabilizes, or None without a gain
    stable_alone: number of aircraft that are stable without control, or None with a gain
    bands: quantity -> its band
    """

    count: int
    seed: int
    parameters: tuple[str, ...]
    trimmed: int
    stable: int | None
    stable_alone: int | None
    bands: Mapping[str, Band]

    @property
    def ok(self) -> bool:
        """True if every aircraft has a trim and the gain, if any, stabilizes every aircraft."""
        return self.trimmed == self.count and self.stable in (None, self.count)

    @property
    def first_line(self) -> str:
        """Numbers of trimmed aircraft and of stable linear models, in one line."""
        aircraft = f"of {self.count} drawn aircraft"
        if self.stable is None:
            return (
                f"trimmed: {self.trimmed} {aircraft}; stable without control: {self.stable_alone}"
            )
        if self.trimmed < self.count:
            return f"trimmed: {self.trimmed} {aircraft}; linear loop stable for {self.stable}"
        return f"linear loop stable for {self.stable} {aircraft}"

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        names = ("count", "seed", "parameters", "trimmed", "ok", "first_line")
        bands = {name: band._asdict() for name, band in self.bands.items()}
        entries = {name: getattr(self, name) for name in names} | {"bands": bands}
        return entries | given(stable=self.stable, stable_alone=self.stable_alone)

    def added_to(self, report: Report) -> Report:
        """Return a report with these results: a line, a table of the bands, and an entry `draws`.

        The line follows the first line of the report, or precedes it if the loops fail and the
        report does not.
        """
        rows = []
        for name, (value, low, high, unit) in self.bands.items():
            if high - low > _CONSTANT * max(abs(high), abs(low)):
                values = [shown_value(number, unit) for number in (value, low, high)]
                rows.append((name, *values, shown_unit(unit)))
        about = f"95 % of {self.count} aircraft, drawn from {len(self.parameters)} parameters"
        table = Table((about, "itself", "low", "high", "unit"), tuple(rows))
        line = wrapped(self.first_line, WIDTH - len("FAIL: "))
        first, *others = report.title.splitlines()
        lines = [first, line, *others]
        if not self.ok and not first.startswith("FAIL"):
            lines = [f"FAIL: {line}", first, *others]
        failure = "" if self.ok else self.first_line
        parts = (*report.parts, table)
        shown = replace(report, title="\n".join(lines), parts=parts, failure=failure)
        return shown.with_data(draws=self.as_data())


def with_stability(
    report: Report, plan: MonteCarlo, condition: TrimCondition, progress: Progress
) -> Report:
    """Return the report of a Monte Carlo simulation with the stability of each drawn aircraft.

    For each aircraft, the loop is linearized at the aircraft's own trim. Without a policy, the
    stability is that of the uncontrolled aircraft. The report is unchanged if the policy has no
    constant gain, or if the loop has delay or actuators.

    condition: trim condition of all aircraft
    progress: callback for the progress of the trims
    """
    assert plan.spread is not None  # the plan draws aircraft
    is_open = isinstance(plan.policy, OpenLoop)
    K = plan.policy.gain
    if not is_open and (K is None or plan.scenario.delay or plan.scenario.actuators is not None):
        return report
    points = trims(plan.aircraft, condition, plan.point, progress)
    models = [linearize(point.model, point) for point in points]
    stable = stable_alone = None
    if is_open:
        stable_alone = sum(_abscissa(linear) < 0.0 for linear in models)
        free = [name for name in plan.point.values if name not in condition.imposed]
        unit = plan.point.model.unit
        bands = {
            name: Band.of(plan.point[name], [point[name] for point in points], unit(name))
            for name in free
        }
    else:
        itself = _abscissa(linearize(plan.point.model, plan.point), K)
        slowest = [_abscissa(linear, K) for linear in models]
        stable = sum(each < 0.0 for each in slowest)
        bands = {"abscissa of the loop": Band.of(itself, slowest, "1/s")}
    names = tuple(plan.spread.values)
    loops = DrawnLoops(plan.members, plan.seed, names, len(points), stable, stable_alone, bands)
    return loops.added_to(report)


def trims(
    aircraft: Iterable[Model],
    condition: TrimCondition,
    nominal: OperatingPoint,
    progress: Progress | None = None,
) -> list[OperatingPoint]:
    """Return the trims of drawn aircraft, without aircraft that have no trim.

    nominal: trim of the given aircraft, from which each search begins
    """
    found = []
    for model in with_progress([*aircraft], progress):
        try:
            found.append(trim(model, condition, nominal))
        except TrimError:
            continue
    return found


def _abscissa(linear: LinearModel, K: np.ndarray | None = None) -> float:
    """Return the largest real part of the eigenvalues of A, or of A - B K."""
    A = linear.A if K is None else linear.A - linear.B @ K
    return float(np.linalg.eigvals(A).real.max())
