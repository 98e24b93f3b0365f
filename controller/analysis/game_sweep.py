"""The game at every point of a sweep: its gain, the smallest delta and the margins, side by side."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from controller.game.zero_sum import published_game
from controller.riccati.frequency_response import disk_margin
from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import minimum_delta
from hfa_support.errors import NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress, told
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_value
from hfa_support.reporting.unit_system import gain_unit
from trim.sweeps.sweep import Sweep


class GameSweep(NamedTuple):
    """The games of N points; nan where there is no trim or no certified solution, and why in `reasons` ("" elsewhere).

    K: (N, m, n). delta_min: (N,), there wherever any delta has a solution. disk_margin, gain_margin, phase_margin_deg:
    (N,) of all inputs at once (as `DiskMargin`).
    """

    delta: float
    K: np.ndarray
    delta_min: np.ndarray
    disk_margin: np.ndarray
    gain_margin: np.ndarray
    phase_margin_deg: np.ndarray
    reasons: tuple[str, ...]


def sweep_games(found: Sweep, progress: Progress | None = None, **changes: Any) -> GameSweep:
    """The paper's game, with `changes` of its Q, R or delta, at every trimmed point of a sweep of six states.

    progress is called with (points done, points in all).
    """
    trimmed = np.flatnonzero(found.trimmed)
    models = [SimpleNamespace(A=found.A[i], B=found.B[i], states=found.model_states) for i in trimmed]
    games = [published_game(model, **changes) for model in models]  # type: ignore[arg-type]
    n, m = found.B.shape[1:]
    K = np.full((len(found.reasons), m, n), np.nan)
    delta_min, disk, gain, phase = np.full((4, len(found.reasons)), np.nan)
    reasons = list(found.reasons)
    for i, game in told(list(zip(trimmed, games, strict=True)), progress):
        try:
            delta_min[i] = minimum_delta(game).value
            K[i] = solve_game(game).K
            disk[i], gain[i], phase[i], _ = disk_margin(game, K[i])
        except NoSolutionError as error:
            reasons[i] = str(error)
    delta = games[0].delta if games else float(changes.get("delta", np.nan))
    return GameSweep(delta, K, delta_min, disk, gain, phase, tuple(reasons))


def with_games(report: Report, found: Sweep, games: GameSweep) -> Report:
    """The report of a sweep with its games: a table, one line a point; `game` in the data; columns in the records."""
    points = [tuple(map(shown_value, row, found.units)) for row in found.values]
    numbers = np.array(games[2:6]).T
    header = [f"{name} {shown_unit(unit)}" for name, unit in zip(found.variables, found.units, strict=True)]
    rows = [
        (*point, *("-" if np.isnan(value) else f"{value:.4g}" for value in line))
        for point, line in zip(points, numbers, strict=True)
    ]
    refused = [
        f"{', '.join(point)}: {reason}"
        for point, no_trim, reason in zip(points, found.reasons, games.reasons, strict=True)
        if reason and not no_trim
    ]
    part = Report(
        title=f"Game at delta {games.delta:.6g}; margins of all inputs at once",
        parts=(Table((*header, "delta_min", "disk", "gain", "phase deg"), rows), *["\n".join(refused)][: len(refused)]),
    )
    records = report.records
    if records is not None:
        unit = found.model.unit
        pairs = [(row, column) for row in found.model.inputs for column in found.model_states]
        entries = [f"K({row}, {column}) [{gain_unit(unit(row), unit(column))}]" for row, column in pairs]
        names = ("delta_min", "disk_margin", "gain_margin", "phase_margin [deg]", "game_reason", *entries)
        more = zip(records.rows, numbers, games.reasons, games.K, strict=True)
        lines = [(*row, *line, reason, *K.ravel()) for row, line, reason, K in more]
        records = Table((*records.header, *names), lines)
    game = games._asdict() | {"delta": finite_or_none(games.delta), "reasons": list(games.reasons)}
    return replace(report, parts=(*report.parts, part), data=dict(report.data) | {"game": game}, records=records)
