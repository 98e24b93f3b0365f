"""Computed beside printed, entry by entry."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hfa_model.aircraft import HFA, Aircraft
from hfa_model.printed_matrices import PublishedModel, published_models
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import TONES, Cell, Table, four_decimals
from trim.linear.linear_model import LinearModel, level_model
from trim.point.condition import level_flight
from trim.point.operating_point import OperatingPoint

#: Half units up to which an entry has each tone but the last: it prints the same, one off, at most two off.
MOST_HALF_UNITS = (1.0, 2.0, 3.0)


@dataclass(frozen=True)
class EntryRow:
    """One entry of A or B: what the paper prints, what was computed, half a unit of the last printed digit."""

    matrix: str
    row: str
    column: str
    printed: float
    computed: float
    half_unit: float

    @property
    def half_units(self) -> float:
        """(computed - printed) / half unit: within ±1 the entry prints the same."""
        return (self.computed - self.printed) / self.half_unit

    @property
    def percent(self) -> float:
        """Difference in percent of the print; nan where the print is zero."""
        return 100 * (self.computed - self.printed) / abs(self.printed) if self.printed else float("nan")

    @property
    def is_zero(self) -> bool:
        """Whether the entry is printed 0 and is 0 but for rounding: nothing to compare."""
        return self.printed == 0.0 and abs(self.half_units) < 1e-6

    @property
    def name(self) -> str:
        """For example A(alpha, pitch_rate)."""
        return f"{self.matrix}({self.row}, {self.column})"

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {name: getattr(self, name) for name in ("name", "printed", "computed", "half_units", "percent")}


def compare(model: LinearModel, published: PublishedModel) -> tuple[EntryRow, ...]:
    """All 66 entries of A (6 x 6) and B (6 x 5), row by row."""
    parts = (
        ("A", LINEAR_STATES, model.A, published.A, published.half_unit_A),
        ("B", INPUTS, model.B, published.B, published.half_unit_B),
    )
    return tuple(
        EntryRow(matrix, row, column, float(printed[i, j]), float(computed[i, j]), float(half_unit[i, j]))
        for matrix, columns, computed, printed, half_unit in parts
        for i, row in enumerate(LINEAR_STATES)
        for j, column in enumerate(columns)
    )


def regenerate(aircraft: Aircraft, published: PublishedModel) -> LinearModel:
    """The linear model of an aircraft in the paper's trim at a printed dihedral angle."""
    return level_model(aircraft, published.dihedral)


def eigenvalue_errors(computed: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """|λ_computed - λ_reference| of the best pairing of two spectra, in the order of the reference."""
    from scipy.optimize import linear_sum_assignment

    distance = np.abs(reference[:, None] - computed[None, :])
    _, columns = linear_sum_assignment(distance)
    return distance[np.arange(len(reference)), columns]


def printed_at(point: OperatingPoint) -> PublishedModel | None:
    """The printed pair of exactly this flight condition, if the paper prints one."""
    for published in published_models():
        paper = level_flight(published.dihedral).imposed
        if all(abs(point.values[name] - value) <= 1e-9 * (1 + abs(value)) for name, value in paper.items()):
            return published
    return None


def beside_the_print(report: Report, model: LinearModel, published: PublishedModel) -> Report:
    """The report of a model with the printed pair of its condition."""
    printed = {"A": published.A.tolist(), "B": published.B.tolist()}
    beside = replace(report, title="", parts=(report, comparison_table(model, published)), notes=report.notes)
    return beside.with_data(printed=printed)


def matrices_beside_the_print(model: LinearModel, published: PublishedModel) -> tuple[Table, ...]:
    """A and B, the printed row below each computed one; an entry's tone says how many half units it is off."""
    entries, tables = iter(compare(model, published)), []
    for name, columns in (("A", LINEAR_STATES), ("B", INPUTS)):
        lines: list[tuple[str, ...]] = []
        for row in LINEAR_STATES:
            found = [next(entries) for _ in columns]
            lines += [(row, *map(_toned, found)), ("printed", *(four_decimals(each.printed) for each in found))]
        tables.append(Table((name, *columns), lines))
    return tuple(tables)


def _toned(entry: EntryRow) -> str:
    """The computed entry; an entry that is 0 and printed 0 has no tone."""
    shown = four_decimals(entry.computed)
    if entry.is_zero:
        return shown
    tones = zip(TONES, (*MOST_HALF_UNITS, math.inf), strict=True)
    return Cell(shown, next(tone for tone, most in tones if abs(entry.half_units) <= most))


def comparison_table(model: LinearModel, published: PublishedModel) -> Table:
    """The table of entries of a model beside its print."""
    return entries_table(f"at {published.dihedral_deg:g} deg", {"": compare(model, published)})


def entries_table(title: str, entries: Mapping[str, Iterable[EntryRow]]) -> Table:
    """Printed, computed, difference in half units of the last digit and in percent; what begins each row -> entries."""
    rows = [
        (
            *(f"{begin}{entry.name}", f"{entry.printed:.4f}", f"{entry.computed:.6f}", f"{entry.half_units:+.2f}"),
            f"{entry.percent:+.4f}" if entry.printed else "-",
        )
        for begin, group in entries.items()
        for entry in group
        if not entry.is_zero
    ]
    return Table((title, "printed", "computed", "half units", "percent"), rows)


def entries_records(entries: Mapping[float, Iterable[EntryRow]]) -> Table:
    """The same with all digits; printed angle (deg) -> entries."""
    rows = [
        (angle, *entry.to_dict().values(), HFA.entry_unit(entry.row, entry.column))
        for angle, group in entries.items()
        for entry in group
    ]
    return Table(("dihedral_deg", "entry", "printed", "computed", "half_units", "percent", "unit"), rows)
