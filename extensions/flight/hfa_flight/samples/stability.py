"""Stability of the linear loops of drawn aircraft, each at its own trim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hfa_flight.policies.policy import OpenLoop
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import WIDTH, Table, shown_unit, shown_value, wrapped
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, trim

#: Percentiles at the ends of a 95 % band.
_BAND = (2.5, 97.5)
#: A band that is narrower than this fraction of its ends is not listed.
_CONSTANT = 1e-9


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
    points = _trims(plan, condition, progress)
    slowest = [_abscissa(linearize(point.model, point), K) for point in points]
    stable = sum(each < 0.0 for each in slowest)
    aircraft = f"of {plan.members} drawn aircraft"
    if is_open:
        ok = len(points) == plan.members
        line = f"trimmed: {len(points)} {aircraft}; stable without control: {stable}"
        free = [name for name in plan.point.values if name not in condition.imposed]
        unit = plan.point.model.unit
        bands = {
            name: _band(plan.point[name], [point[name] for point in points], unit(name))
            for name in free
        }
    else:
        ok = len(points) == stable == plan.members
        line = f"linear loop stable for {stable} {aircraft}"
        if len(points) < plan.members:
            line = f"trimmed: {len(points)} {aircraft}; linear loop stable for {stable}"
        itself = _abscissa(linearize(plan.point.model, plan.point), K)
        bands = {"abscissa of the loop": _band(itself, slowest, "1/s")}
    names = list(plan.spread.values)
    found = {
        "count": plan.members,
        "seed": plan.seed,
        "parameters": names,
        "trimmed": len(points),
        "ok": ok,
        "first_line": line,
        "stable_alone" if is_open else "stable": stable,
        "bands": bands,
    }
    table = _table(f"95 % of {plan.members} aircraft, drawn from {len(names)} parameters", bands)
    first, *others = report.title.splitlines()
    shown = wrapped(line, WIDTH - len("FAIL: "))
    lines = [first, shown, *others]
    if not ok and not first.startswith("FAIL"):
        lines = [f"FAIL: {shown}", first, *others]
    return replace(
        report,
        title="\n".join(lines),
        parts=(*report.parts, table),
        failure="" if ok else line,
    ).with_data(ok=report.data["ok"] and ok, draws=found)


def _trims(plan: MonteCarlo, condition: TrimCondition, progress: Progress) -> list[OperatingPoint]:
    """Return the trims of the drawn aircraft, without aircraft that have no trim."""
    found = []
    for model in with_progress([*plan.aircraft], progress):
        try:
            found.append(trim(model, condition, plan.point))
        except TrimError:
            continue
    return found


def _abscissa(linear: LinearModel, K: np.ndarray | None) -> float:
    """Return the largest real part of the eigenvalues of A, or of A - B K."""
    A = linear.A if K is None else linear.A - linear.B @ K
    return float(np.linalg.eigvals(A).real.max())


def _band(value: float, drawn: Sequence[float], unit: str) -> dict[str, Any]:
    """Return the value of the given aircraft and the ends of the band of 95 % of the drawn."""
    low, high = np.percentile(drawn, _BAND).tolist() if drawn else (np.nan, np.nan)
    return {"value": float(value), "low": low, "high": high, "unit": unit}


def _table(about: str, bands: dict[str, dict[str, Any]]) -> Table:
    rows = []
    for name, band in bands.items():
        value, low, high, unit = band.values()
        if high - low > _CONSTANT * max(abs(high), abs(low)):
            shown = [shown_value(number, unit) for number in (value, low, high)]
            rows.append((name, *shown, shown_unit(unit)))
    return Table((about, "itself", "low", "high", "unit"), rows)
