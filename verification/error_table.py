"""Errors of a critic over time, and checks of the data and settling time of a training run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.critic import Critic
from controller.critic.training_run import settled_at
from controller.game.basis import basis
from hfa_support.reporting.checks import Check, at_least
from hfa_support.reporting.results import Result, Vector
from hfa_support.reporting.text import Table
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


#: Number of rows in the table of a report. Files contain all rows.
_TIMES = 9


def shown_number(value: float) -> str:
    """Return a number as text with three digits, or "" for nan."""
    return "" if math.isnan(value) else f"{value:.3g}"


@dataclass(frozen=True, eq=False)
class ErrorTable(Result):
    """Errors of a critic at each time of its history.

    times: (N,), s.
    errors: column as in `COLUMNS` -> errors (N,); errors of P are nan if P is unknown.
    decides: name of the column that must settle.
    limit: limit of this column.
    """

    times: Vector
    errors: Mapping[str, np.ndarray]
    decides: str
    limit: float

    @property
    def settling_time(self) -> float:
        """First recorded time from which the error `decides` stays within its limit, s, or inf."""
        return settled_at(self.times, self.errors[self.decides], self.limit)

    @property
    def records(self) -> Table:
        """Table with the errors at all times, for a data file."""
        columns = np.column_stack([self.times, *self.errors.values()])
        return Table(("time [s]", *self.errors), columns)  # type: ignore[arg-type]

    @property
    def shown(self) -> Table:
        """Table with the errors at `_TIMES` times, for a report."""
        columns = np.column_stack([self.times, *self.errors.values()])
        some = np.unique(np.linspace(0, len(columns) - 1, _TIMES).round().astype(int))
        rows = [
            (f"{time:.4g}", *map(shown_number, errors)) for time, *errors in columns[some].tolist()
        ]
        return Table(("time, s", *(COLUMNS[name] for name in self.errors)), rows)

    @property
    def sentence(self) -> str:
        """Sentence on the settling time, or on the last error if the error does not settle."""
        what = f"the {COLUMNS[self.decides]}"
        if math.isfinite(self.settling_time):
            return f"{what} stays within {self.limit:g} from {self.settling_time:.4g} s on"
        last = self.errors[self.decides][-1]
        return f"{what} ends at {last:.3g} and does not settle within {self.limit:g}"

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value, with one for each column of errors."""
        return {
            "time": self.times,
            **self.errors,
            "limit": self.limit,
            "settling_time": self.settling_time,
        }


def run_table(
    run: TrainingRun, exact: np.ndarray, residuals: Callable[[np.ndarray], np.ndarray]
) -> ErrorTable:
    """Return the errors of P over the time of a training run, computed from the run's weights.

    exact: P of the exact solution, (n, n)
    residuals: function of N matrices P -> their residuals of the Riccati equation
    """
    psi = basis(run.basis, len(exact))
    values = np.array([psi.matrix(weights) for weights in run.weights])
    errors = {
        "riccati_residual": residuals(values),
        "P_rel_error": np.array([relative_error(P, exact) for P in values]),
    }
    return ErrorTable(run.time, errors, "riccati_residual", SETTLED)


def history_table(
    critics: Sequence[Critic],
    errors_of: Callable[[Critic], Sequence[Check]],
    residuals: Callable[[np.ndarray], np.ndarray],
    limit: float,
) -> ErrorTable:
    """Return the errors of each critic of a history.

    errors_of: function of a critic -> checks of its errors, without one of P if it has no P
    residuals: function of N matrices P -> their residuals of the Riccati equation
    limit: limit of the largest error
    """
    rows = []
    for critic in critics:
        errors = {check.name: check.value for check in errors_of(critic)}
        residual = math.nan if critic.P is None else float(residuals(critic.P[None])[0])
        row = {
            "P_rel_error": errors.get("P_rel_error", math.nan),
            "K_rel_error": errors["K_rel_error"],
            "riccati_residual": residual,
            "largest_error": max(errors.values()),
        }
        rows.append(row)
    times = np.array([critic.time for critic in critics], dtype=float)
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return ErrorTable(times, columns, "largest_error", limit)


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
