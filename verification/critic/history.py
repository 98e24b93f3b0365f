"""Check of critics over time, from a file or a training run, against the exact solution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.normal_form import NormalForm
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.text import Table
from verification.critic.critic_check import verify
from verification.critic_errors import critic_errors
from verification.error_table import COLUMNS, ErrorTable, time_checks
from verification.hfa_box import usual_box
from verification.scope import LIMIT, Scope
from verification.verdict import Details, Section, Verdict, shown_number

#: Number of rows in the table of a report. Files contain all rows.
_TIMES = 9


@checks_arguments
def check_history(
    game: Game,
    critics: Sequence[Critic],
    *,
    limit: float = LIMIT,
    scope: Scope | None = None,
    predefined_time: float | None = None,
    progress: Progress | None = None,
) -> Verdict:
    """Return the verdict on the last critic of a history, with a table of the errors of all
    critics.

    game: the game
    critics: in the order of their `time`, from `critics_in` or `critics_over_time`
    limit: limit of every error and of the residual
    scope: further data for the checks of the last critic; by default `Scope()`
    predefined_time: T_w, s; a check requires every error to be within the limit from T_w on. None
        for no such check.
    progress: called with (checked critics, all critics), or None

    Raises BadInputError if there is no critic, or a critic has no time.
    """
    if not critics or any(critic.time is None for critic in critics):
        raise BadInputError(
            "a critic or its time is missing; create the history with critics_over_time"
        )
    verdict = verify(game, critics[-1], limit=limit, scope=scope)
    box = (scope or Scope()).box or usual_box(game)
    rows = []
    for critic in with_progress(critics, progress):
        errors = {
            check.name: check.value
            for check in critic_errors(game, critic, verdict.exact, limit, box)
        }
        row = {
            "P_rel_error": errors.get("P_rel_error", math.nan),
            "K_rel_error": errors["K_rel_error"],
            "riccati_residual": math.nan if critic.P is None else _residual(game, critic.P),
            "largest_error": max(errors.values()),
        }
        rows.append(row)
    times = np.array([critic.time for critic in critics], dtype=float)
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    table = ErrorTable(times, columns, "largest_error", limit, predefined_time)
    checks = (*verdict.checks, *time_checks(table))
    sections = (*verdict.sections, _section(table))
    return replace(verdict, checks=checks, sections=sections, table=table)


def _section(table: ErrorTable) -> Section:
    """Return a section of the report on a history: its settling time, and the errors at some times.

    The records of the section contain the errors at all times.

    table: errors at all times
    """
    columns = np.column_stack([table.times, *table.errors.values()])
    some = np.unique(np.linspace(0, len(columns) - 1, _TIMES).round().astype(int))
    rows = [(f"{time:.4g}", *map(shown_number, errors)) for time, *errors in columns[some].tolist()]
    shown = Table(("time, s", *(COLUMNS[name] for name in table.errors)), rows)
    records = Table(("time [s]", *table.errors), columns)  # type: ignore[arg-type]
    return Section((shown, table.sentence), Details(history=table), records)


def _residual(game: Game, P: np.ndarray) -> float:
    """Return the relative residual of the Riccati equation for P, (n, n), in balanced units."""
    form = NormalForm.of(game)
    return float(form.relative_residual(form.of_value(P)))
