"""A critic over time against the exact solution: how far off at each time, and from when on it is right."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.basis import basis
from controller.game.critic_file import History
from controller.game.learning_result import settled_at
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.certificate import relative_residual
from controller.riccati.gare import GameSolution
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, at_most
from hfa_support.reporting.report import Part
from hfa_support.reporting.text import Table
from verification.critic.candidate import from_stored
from verification.critic.critic_errors import Box, critic_errors

#: Rows of the table in a report; files have all.
_SHOWN = 9


@dataclass(frozen=True, eq=False)
class HistoryErrors:
    """times: (N,), s. P_errors, K_errors: (N,), relative, Frobenius norms in the units of the game. residuals: (N,), of
    the Riccati equation. largest: (N,), of all errors that the verdict on a critic has. P_errors and residuals are nan
    where only a gain is known. limit: of the errors. predefined_time: T_w, s, None when none is promised."""

    times: np.ndarray
    P_errors: np.ndarray
    K_errors: np.ndarray
    residuals: np.ndarray
    largest: np.ndarray
    limit: float
    predefined_time: float | None = None

    @property
    def settling_time(self) -> float:
        """First time from which the largest error stays within the limit, s; inf when the last one does not."""
        return settled_at(self.times, self.largest, self.limit)

    @property
    def left_again(self) -> tuple[tuple[float, float], ...]:
        """(from, until), s: each spell within the limit that did not last, up to the first time outside."""
        inside = self.largest <= self.limit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
        spells = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        return tuple((float(self.times[a]), float(self.times[b])) for a, b in spells if b < len(self.times))

    def checks(self) -> tuple[Check, ...]:
        """`settling_time` against the predefined time, where there is one."""
        if self.predefined_time is None:
            return ()
        late = f"{self.said}; T_w is {self.predefined_time:g} s"
        return (at_most("settling_time", self.settling_time, self.predefined_time, late),)

    def block(self) -> Part:
        """The errors at some of the times, evenly spread over the rows, and when they settle."""
        rows = np.unique(np.linspace(0, len(self.times) - 1, _SHOWN).round().astype(int))
        cells = [[f"{self.times[row]:.4g}", *(_shown(each[row]) for each in self._columns())] for row in rows]
        header = ("time, s", "error of P", "error of K", "Riccati residual", "largest error")
        return (Table(header, [tuple(row) for row in cells]), self.said)

    def records(self) -> Table:
        """One row a time, all digits."""
        names = ("time [s]", "P_rel_error", "K_rel_error", "riccati_residual", "largest_error")
        return Table(names, np.column_stack([self.times, *self._columns()]))  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        names = ("P_rel_error", "K_rel_error", "riccati_residual", "largest_error")
        kept = None if self.predefined_time is None else self.settling_time <= self.predefined_time
        return {
            "time": self.times,
            **dict(zip(names, self._columns(), strict=True)),
            "limit": self.limit,
            "settling_time": finite_or_none(self.settling_time),
            "left_again": np.array(self.left_again),
            "predefined_time": self.predefined_time,
            "predefined_time_kept": kept,
        }

    def _columns(self) -> tuple[np.ndarray, ...]:
        return self.P_errors, self.K_errors, self.residuals, self.largest

    @property
    def said(self) -> str:
        """When it settles, in words, and whether it had been within the limit before."""
        said = f"the largest error stays within {self.limit:g} from {self.settling_time:.4g} s on"
        if math.isinf(self.settling_time):
            said = f"the largest error ends at {_shown(self.largest[-1])} and does not settle within {self.limit:g}"
        if self.left_again:
            begin, end = self.left_again[-1]
            said += f"; it was within from {begin:.4g} s and left again at {end:.4g} s"
        return said


def history_errors(
    game: Game,
    exact: GameSolution,
    history: History,
    limit: float,
    predefined_time: float | None = None,
    progress: Progress | None = None,
    box: Box | None = None,
) -> HistoryErrors:
    """Every row of a history held against the exact solution, as the verdict holds one critic.

    progress: rows done, rows. box: default `ordinary_box`. BadInputError when a row does not fit the game.
    """
    functions, units = basis(history.basis, len(game.A)), balanced_units(game)
    balanced, squared = in_units(game, units), np.outer(units, units)
    rows = []
    for index in told(range(len(history.times)), progress):
        candidate = from_stored(game, history.row(index), functions)
        errors = {check.name: check.value for check in critic_errors(game, candidate, exact, limit, box)}
        residual = math.nan if candidate.P is None else relative_residual(balanced, candidate.P * squared)
        rows.append((errors.get("P_rel_error", math.nan), errors["K_rel_error"], residual, max(errors.values())))
    P_errors, K_errors, residuals, largest = np.array(rows).T
    return HistoryErrors(history.times, P_errors, K_errors, residuals, largest, limit, predefined_time)


def _shown(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"
