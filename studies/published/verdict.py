"""Verdict on a printed answer, and its report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controller.critic.critic import from_gain, from_q_function, from_value, from_weights
from controller.game.weights import weights_line
from hfa_support.errors import prefix_errors
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table
from studies.published.classes import Classified, classify
from studies.published.comparison import Comparison
from studies.published.printed_file import PrintedFile, load_printed
from verification.critic.critic_check import verify

#: Number of entries in a report. A file contains all entries.
_ENTRIES = 12


@dataclass(frozen=True, eq=False, repr=False)
class PrintedVerdict(Result, Reported):
    """Verdict on a printed answer.

    file: the printed answer
    classified: class of the answer, with the comparison and the result of the search
    cost_lost: upper bound on the cost above the optimum, percent, for an answer of the class
        "close", or nan for other classes
    """

    schema = "hfa.printed-check/1"

    file: PrintedFile
    classified: Classified
    cost_lost: float

    @property
    def ok(self) -> bool:
        """True if the answer is as printed or cut off."""
        return self.classified.name in ("as printed", "cut off")

    @property
    def weights_from(self) -> Mapping[str, str]:
        """Q, R, delta or a printed N -> "printed", or "default" for a missing gamma."""
        delta = "printed" if "gamma" in self.file.typed else "default"
        cross = {"N": "printed"} if "N" in self.file.typed else {}
        return {"Q": "printed", "R": "printed", "delta": delta, **cross}

    @property
    def entries(self) -> list[dict[str, Any]]:
        """Printed entries with their positions, exact values and errors.

        The keys are block, row, column, printed, exact, half_unit and half_units_off. Rows and
        columns are counted from 1. half_units_off is the error in units of the tolerance.
        """
        rows = _rows(self.classified.comparison)
        return [dict(zip(_COLUMNS, row, strict=True)) for row in rows]

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "title": self.file.title,
            "verdict": self.classified.name,
            "reason": self.classified.reason,
            "relative_error": self.classified.comparison.relative_error,
            "other_plants": self.classified.changed,
            "not_searched": self.classified.not_searched,
            "cost_lost_percent": self.cost_lost,
            "ok": self.ok,
            "weights_from": self.weights_from,
            "entries": self.entries,
        }

    def report(self) -> Report:
        """Return the report on the printed answer.

        The report contains the class, the reason, the changed entries of the plant, and the printed
        entries with the largest errors.
        """
        comparison = self.classified.comparison
        line = f"{self.classified.name}: {self.classified.reason}"
        if not math.isnan(self.cost_lost):
            line += f", cost {self.cost_lost:.2g} % above the optimum"
        rows = _rows(comparison)
        nearest = np.argsort(-comparison.errors, kind="stable")[:_ENTRIES]
        shown = []
        for index in sorted(nearest):
            _, _, _, printed, exact, _, off = rows[index]
            position = str(comparison.positions[index])
            shown.append((position, f"{printed:.12g}", f"{exact:.12g}", f"{off:.3g}"))
        parts: list[Any] = [f"{self.file.title}: consistent with its digits is at most 1 half unit"]
        plant = self.file.plant
        parts.append(weights_line(plant.game(), self.weights_from))
        if self.file.assumption:
            parts.append(self.file.assumption)
        if self.classified.not_searched:
            parts.append(self.classified.not_searched)
        for entry in self.classified.changed:
            interval = f"{entry.lowest:.8g} to {entry.highest:.8g}"
            parts.append(f"{entry.position} in {interval} makes every printed digit right")
        parts.append(Table(("entry", "printed", "exact", "half units off"), shown))
        if len(rows) > _ENTRIES:
            parts.append(f"the {_ENTRIES} of {len(rows)} entries with the largest errors")
        return Report(
            line,
            parts,
            data=self.as_data(),
            records=Table(_COLUMNS, rows),
        )


_COLUMNS = ("block", "row", "column", "printed", "exact", "half_unit", "half_units_off")


def check_printed(path: Path, progress: Progress | None = None) -> PrintedVerdict:
    """Return the verdict on the printed answer in a TOML file.

    progress: called with the number of entries of the plant searched so far and the total number,
        or None

    Raises BadInputError for a file that is not a printed answer or does not state the time. Raises
    NoSolutionError if the plant in the file has no certified answer.
    """
    file = load_printed(path)
    with prefix_errors(path):
        classified = classify(file, progress)
    cost_lost = math.nan
    if classified.name == "close":
        cost_lost = _cost_above_optimum(file)
    return PrintedVerdict(file, classified, cost_lost)


def _cost_above_optimum(file: PrintedFile) -> float:
    """Return an upper bound on the cost above the optimum of the printed policy, percent."""
    game = file.plant.game()
    printed = {name: block.values for name, block in file.answer.items()}
    if "K" in printed:
        critic = from_gain(game, file.signs["K"] * printed["K"])
    elif game.is_discrete and "H" in printed:
        critic = from_q_function(game, (printed["H"] + printed["H"].T) / 2.0)
    elif "P" in printed:
        critic = from_value(game, printed["P"])
    else:
        critic = from_weights(game, printed["W"].ravel())
    return verify(game, critic).cost_lost


def _rows(comparison: Comparison) -> list[tuple[Any, ...]]:
    """Return block, row, column, printed value, exact value, half unit and error of each entry."""
    rows = []
    for index, position in enumerate(comparison.positions):
        rows.append(
            (
                position.block,
                position.row + 1,
                position.column + 1,
                float(comparison.printed[index]),
                float(comparison.exact[index]),
                float(comparison.half_units[index]),
                float(comparison.errors[index]),
            )
        )
    return rows
