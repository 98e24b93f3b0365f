"""Critics over time against the exact solution: a file with times, or a training run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from controller.critic.critic import Critic
from controller.game.basis import basis
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from controller.riccati.normal_form import NormalForm
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, at_least, at_most
from hfa_support.reporting.text import Table
from verification.critic.critic_check import check_critic
from verification.critic.critic_errors import critic_errors, relative_error
from verification.critic.error_table import COLUMNS, ErrorTable
from verification.critic.scope import LIMIT, Scope
from verification.critic.verdict import Details, Section, Verdict, shown_number

if TYPE_CHECKING:
    from controller.game.training_run import TrainingRun

#: Relative Riccati residual, in balanced units, below which a run counts as settled.
SETTLED = 1e-9
#: Rows of the table in a report. Files have all.
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
    """The verdict on the last critic of a history (`check_critic`), with a table of the errors of
    all its critics over time.

    game: the game that they should solve.
    critics: in order of their `time`, as `critics_in` and `critics_over_time` make them.
    limit: of every error and of the residual.
    scope: on what else the last critic is judged.
    predefined_time: T_w, s; a check is added that from then on every error stays within the limit.
        None: no such check.
    progress: called with the critics done and their number.

    BadInputError when the critics have no times.
    """
    if not critics or any(critic.time is None for critic in critics):
        raise BadInputError("a history needs critics with times; make them by critics_over_time")
    verdict = check_critic(game, critics[-1], limit=limit, scope=scope)
    box = scope.box if scope is not None else None
    rows = []
    for critic in told(critics, progress):
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
    """Some rows and the settling time for a report, all rows for a file."""
    columns = np.column_stack([table.times, *table.errors.values()])
    some = np.unique(np.linspace(0, len(columns) - 1, _TIMES).round().astype(int))
    rows = [(f"{time:.4g}", *map(shown_number, errors)) for time, *errors in columns[some].tolist()]
    shown = Table(("time, s", *(COLUMNS[name] for name in table.errors)), rows)
    records = Table(("time [s]", *table.errors), columns)  # type: ignore[arg-type]
    return Section((shown, table.sentence), Details(history=table), records)


def _residual(game: Game, P: np.ndarray) -> float:
    """The relative Riccati residual of P in balanced units."""
    form = NormalForm.of(game)
    return float(form.relative_residual(form.of_value(P)))


def run_table(game: Game, run: TrainingRun, exact: Solution) -> ErrorTable:
    """The errors of P(t) of a training run, computed anew from its weights."""
    psi = basis(run.basis, len(game.A))
    values = np.array([psi.matrix(weights) for weights in run.weights])
    form = NormalForm.of(game)
    residuals = form.relative_residual(form.of_value(values))
    errors = {
        "riccati_residual": residuals,
        "P_rel_error": np.array([relative_error(P, exact.P) for P in values]),
    }
    promised = run.settings.get("predefined_time")
    return ErrorTable(run.times, errors, "riccati_residual", SETTLED, promised)


def rank_check(run: TrainingRun) -> Check:
    """Whether the data of a run determine its weights."""
    rank = run.excitation
    poor = (
        f"the data have rank {rank.rank} of {rank.size}: whatever their residual, they do not "
        "determine the weights"
    )
    return at_least("data_rank", rank.rank, rank.size, poor, kind="data")


def time_checks(table: ErrorTable) -> list[Check]:
    """The settling time of a history or a run that promises one."""
    promised = table.predefined_time
    if promised is None:
        return []
    reason = f"{table.sentence}; T_w is {promised:g} s"
    return [at_most("settling_time", table.settling_time, promised, reason, kind="data")]
