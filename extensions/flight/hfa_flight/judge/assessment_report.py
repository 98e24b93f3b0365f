"""Tables of an assessment: sampled loop and flights at each trim, actions, changed aircraft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from hfa_flight.judge.action_effects import ActionEffect
from hfa_flight.judge.assessed_point import AssessedPoint, scheduled_value
from hfa_flight.judge.endings import BALL
from hfa_flight.judge.findings import where_text
from hfa_flight.judge.variations import Variation, variation_table
from hfa_flight.judge.weights import weights_at
from hfa_flight.plan.problem import cost_text
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.simulate.returned import RULE
from hfa_support.reporting.text import Table, shown_unit

_CONVERGES = (
    f"A flight converges if it ends within {100 * BALL:g} % of the initial-condition box about the "
    "policy's equilibrium."
)


def report_parts(
    deployed: Deployed, points: Sequence[AssessedPoint], variations: Sequence[Variation]
) -> list[Any]:
    """Return the parts of the report of an assessment, in reading order."""
    parts: list[Any] = [deployed.deployment.actor.chain]
    if any(point.best is not None for point in points):
        parts += [_weights_text(deployed, points[0]), f"{_CONVERGES} {RULE}"]
    elif any(point.flights is not None for point in points):
        parts.append(_CONVERGES)
    parts += [loop_table(points), flights_table(points)]
    error = points[0].integration
    if error is not None and error.is_resolved:
        parts.append(error.text())
    parts += _actions(points)
    trims = [where_text([point], points) for point in points]
    parts += [
        replace(point.in_air, title=f"{trim}: {point.in_air.title}")
        for trim, point in zip(trims, points, strict=True)
        if point.in_air is not None
    ]
    if variations:
        parts.append(variation_table(variations, trims))
    return parts


def _weights_text(deployed: Deployed, point: AssessedPoint) -> str:
    """Return the weights of the cost as text."""
    signals = (*deployed.model.linear, *deployed.commanded)
    has_cost = deployed.deployment.cost is not None
    text = cost_text(deployed.model, signals, *weights_at(deployed, point.point))
    return f"cost: {text}" if has_cost else f"cost: {text}; the deployment has no [cost]"


def loop_table(points: Sequence[AssessedPoint]) -> Table:
    """Return the table of the sampled loop at each trim."""
    header = (
        *(_trim_header(points), "holds", "radius", "unstable at ms", "margin"),
        *("cost %", "mean %", "sampled %"),
    )
    rows = []
    for point in points:
        limit = None if point.delays is None else point.delays.limit
        cells = [_trim_cell(point), "yes" if point.holds else "no"]
        cells.append("-" if math.isnan(point.radius) else f"{point.radius:.5f}")
        cells.append("-" if limit is None else f"{1e3 * limit:.4g}")
        cells.append("-" if point.margins is None else f"{point.margins.disk.disk:.3f}")
        for lost in ("worst", "mean", "sampled_worst"):
            number = math.nan if point.cost is None else getattr(point.cost, lost)
            cells.append(f"{number:.4g}" if math.isfinite(number) else "-")
        rows.append(tuple(cells))
    return Table(header, rows)


def flights_table(points: Sequence[AssessedPoint]) -> Table:
    """Return the table of the flights at each trim, with the medians of the cost ratios."""
    header = (
        *(_trim_header(points), "converge", "leave", "disturbed"),
        *("over best", "over LQR", "LQR over best"),
    )
    rows = []
    for point in points:
        cells = [_trim_cell(point), *point.counts]
        costs = point.best
        for name in ("policy_over_best", "policy_over_lqr", "lqr_over_best"):
            ratios = None if costs is None else getattr(costs, name)
            cells.append("-" if ratios is None else f"{ratios.median:.4g}")
        rows.append(tuple(cells))
    return Table(header, rows)


def _trim_header(points: Sequence[AssessedPoint]) -> str:
    model = points[0].point.model
    return f"{model.schedule} {shown_unit(model.schedule_unit)}" if model.schedule else "trim"


def _trim_cell(point: AssessedPoint) -> str:
    value = next(iter(scheduled_value(point.point).values()), None)
    return "-" if value is None else f"{value:.4g}"


def _actions(points: Sequence[AssessedPoint]) -> list[Any]:
    """Return the table of the actions' effects, with its caption."""
    with_actions = [point for point in points if point.actions]
    if not with_actions:
        return []
    worst = min(with_actions, key=_most_reversed)
    where = where_text([worst], points)
    caption = f"actions {where}: lowering of the sum of the eigenvalues, 1/s"
    return [caption, actions_table(worst.actions)]


def _most_reversed(point: AssessedPoint) -> float:
    """Return the least effect of an action relative to that of the exact gain, 0 if both are 0."""
    effects = [(each.effect, each.exact_effect) for each in point.actions]
    return min(effect / exact if exact else 0.0 for effect, exact in effects)


def actions_table(actions: Sequence[ActionEffect]) -> Table:
    """Return a table of the effects of the actions beside those of the exact gain."""
    rows = [(each.action, f"{each.effect:+.3g}", f"{each.exact_effect:+.3g}") for each in actions]
    return Table(("action", "of the policy", "of the exact gain"), rows)


def records_table(points: Sequence[AssessedPoint]) -> Table:
    """Return the table of results with all digits, one row for each trim."""
    model = points[0].point.model
    key = model.schedule_key if model.schedule else "trim"
    header = (
        *(key, "holds", "spectral_radius", "delay_limit [s]", "disk_margin"),
        *("converged", "left_envelope", "flights"),
    )
    rows = []
    for number, point in enumerate(points):
        value = next(iter(scheduled_value(point.point).values()), float(number))
        data = point.as_data()
        flown = point.flights
        counts = (0, 0, 0) if flown is None else (flown.returned, flown.lost, flown.starts)
        names = ("holds", "spectral_radius", "delay_limit", "disk_margin")
        rows.append((value, *(data[name] for name in names), *counts))
    return Table(header, rows)
