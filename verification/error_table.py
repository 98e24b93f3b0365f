"""Errors of a critic over time, and checks of the data and settling time of a training run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.training_run import settled_at
from controller.game.basis import basis
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from controller.riccati.normal_form import NormalForm
from hfa_support.reporting.checks import Check, at_least, at_most
from hfa_support.reporting.results import UNSTORED, Result, Vector, plain, stored, stored_as
from verification.critic_errors import relative_error

if TYPE_CHECKING:
    from controller.critic.training_run import TrainingRun

#: Relative Riccati residual, in balanced units, below which a run counts as settled.
SETTLED = 1e-9
#: Column of the table of errors -> header of the column, and label of its curve.
COLUMNS = {
    "P_rel_error": "error of P",
    "K_rel_error": "error of K",
    "riccati_residual": "Riccati residual",
    "largest_error": "largest error",
}


@dataclass(frozen=True, eq=False)
class ErrorTable(Result):
    """Errors of a critic at each time of its history.

    times: (N,), s.
    errors: column as in `COLUMNS` -> errors (N,); errors of P are nan if P is unknown.
    decides: name of the column that must settle.
    limit: limit of this column.
    predefined_time: T_w, s, or None.
    """

    times: Vector = field(metadata=stored_as("time"))
    errors: Mapping[str, np.ndarray] = field(metadata=UNSTORED)
    decides: str = field(metadata=UNSTORED)
    limit: float
    predefined_time: float | None = field(default=None, metadata=stored_as(optional=False))

    @property
    @stored()
    def settling_time(self) -> float:
        """First recorded time from which the error `decides` stays within its limit, s, or inf."""
        return settled_at(self.times, self.errors[self.decides], self.limit)

    @property
    @stored()
    def predefined_time_kept(self) -> bool | None:
        """True if the settling time is at most the predefined time; None without a predefined
        time."""
        if self.predefined_time is None:
            return None
        return self.settling_time <= self.predefined_time

    def as_data(self) -> dict[str, Any]:
        """Return the entries of the table for files, with an entry for each column of errors."""
        data = super().as_data()
        return {"time": data.pop("time"), **plain(self.errors), **data}

    @property
    def sentence(self) -> str:
        """Sentence on the settling time, or on the last error if the error does not settle."""
        what = f"the {COLUMNS[self.decides]}"
        if math.isfinite(self.settling_time):
            return f"{what} stays within {self.limit:g} from {self.settling_time:.4g} s on"
        last = self.errors[self.decides][-1]
        return f"{what} ends at {last:.3g} and does not settle within {self.limit:g}"


def run_table(game: Game, run: TrainingRun, exact: Solution) -> ErrorTable:
    """Return the errors of P over the time of a training run, computed from the run's weights.

    exact: solution of the game
    """
    psi = basis(run.basis, len(game.A))
    values = np.array([psi.matrix(weights) for weights in run.weights])
    form = NormalForm.of(game)
    residuals = form.relative_residual(form.of_value(values))
    errors = {
        "riccati_residual": residuals,
        "P_rel_error": np.array([relative_error(P, exact.P) for P in values]),
    }
    promised = run.settings.get("predefined_time")
    return ErrorTable(run.time, errors, "riccati_residual", SETTLED, promised)


def rank_check(run: TrainingRun) -> Check:
    """Return the check that the data of a training run have full rank.

    Data with a lower rank do not determine the weights.
    """
    rank = run.excitation
    poor = (
        f"the data have rank {rank.rank} of {rank.size} and do not determine the weights, "
        "however small the residual is"
    )
    return at_least("data_rank", rank.rank, rank.size, poor, kind="data")


def time_checks(table: ErrorTable) -> list[Check]:
    """Return a list with the check of the settling time, or [] without a predefined time."""
    promised = table.predefined_time
    if promised is None:
        return []
    reason = f"{table.sentence}; T_w is {promised:g} s"
    return [at_most("settling_time", table.settling_time, promised, reason, kind="data")]
