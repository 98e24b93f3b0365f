"""The main job, judged: both printed pairs regenerated from one aircraft and compared entry by entry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.published import PublishedModel, published_models
from hfa_model.support.checks import Check, at_most, checks_text
from hfa_model.support.text import Table, columns, eigenvalue_text
from trim.linear.compare import EntryRow, compare, comparison_table, eigenvalue_errors, regenerate
from trim.linear.linearize import LinearModel
from trim.linear.model_report import matrices

SCHEMA = "hfa.regeneration/1"

#: Within 1 half unit an entry prints the same; within 3 it prints the same or one off in the last digit.
MOST_HALF_UNITS = 3.0
#: Eigenvalues: relative, or absolute for those slower than `SLOW`, 1/s.
MOST_EIGENVALUE_ERROR = 2e-3
MOST_SLOW_EIGENVALUE_ERROR = 5e-4
SLOW = 1.0


@dataclass(frozen=True)
class RegeneratedPair:
    """One printed angle: the model computed, its entries beside the print, both spectra, and the checks."""

    published: PublishedModel
    model: LinearModel
    entries: tuple[EntryRow, ...]
    printed_eigenvalues: np.ndarray
    eigenvalues: np.ndarray
    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether every check holds."""
        return all(check.ok for check in self.checks)


def regenerate_all(aircraft: Aircraft) -> tuple[RegeneratedPair, ...]:
    """Trim and linearize at both printed angles and judge the result against the print."""
    return tuple(judge(regenerate(aircraft, published), published) for published in published_models())


def judge(model: LinearModel, published: PublishedModel) -> RegeneratedPair:
    """Every entry of A and B against its print; the spectrum and its stability against those of the printed A."""
    entries = compare(model, published)
    printed, computed = _spectrum(published.A), _spectrum(model.A)
    errors = eigenvalue_errors(computed, printed)
    slow = np.abs(printed) < SLOW
    worst = max(entries, key=lambda entry: abs(entry.half_units))
    unstable = int(np.count_nonzero(printed.real > 0)), int(np.count_nonzero(computed.real > 0))
    checks = (
        at_most(
            "largest entry error, half units",
            abs(worst.half_units),
            MOST_HALF_UNITS,
            f"{worst.name} is {worst.computed:.6g}, printed {worst.printed:.6g}",
        ),
        at_most(
            "fast eigenvalues, relative error",
            float((errors / np.abs(printed))[~slow].max()),
            MOST_EIGENVALUE_ERROR,
            "the fast modes differ from those of the printed A",
        ),
        at_most(
            "slow eigenvalues, absolute error, 1/s",
            float(errors[slow].max(initial=0.0)),
            MOST_SLOW_EIGENVALUE_ERROR,
            "the slow modes differ from those of the printed A",
        ),
        at_most(
            "unstable eigenvalues, difference in number",
            abs(unstable[0] - unstable[1]),
            0,
            f"the printed A has {unstable[0]} unstable eigenvalues, the regenerated one {unstable[1]}",
        ),
    )
    return RegeneratedPair(published, model, entries, printed, computed, checks)


def regeneration_data(pairs: tuple[RegeneratedPair, ...]) -> dict[str, Any]:
    """Both pairs, ready for JSON."""
    return {
        "schema": SCHEMA,
        "ok": all(pair.ok for pair in pairs),
        "cases": [
            {
                "dihedral_deg": pair.published.dihedral_deg,
                "dynamics": pair.model.point.dynamics,
                "operating_point": pair.model.point.to_dict(),
                "states": list(pair.model.states),
                "inputs": list(pair.model.inputs),
                "A": pair.model.A.tolist(),
                "B": pair.model.B.tolist(),
                "entries": [
                    {
                        "name": entry.name,
                        "printed": entry.printed,
                        "computed": entry.computed,
                        "half_units": entry.half_units,
                        "percent": entry.percent,
                    }
                    for entry in pair.entries
                ],
                "printed_eigenvalues": [[value.real, value.imag] for value in pair.printed_eigenvalues.tolist()],
                "eigenvalues": [[value.real, value.imag] for value in pair.eigenvalues.tolist()],
                "checks": [check.to_dict() for check in pair.checks],
            }
            for pair in pairs
        ],
    }


def regeneration_table(pairs: tuple[RegeneratedPair, ...]) -> Table:
    """One row an entry."""
    header = ("dihedral_deg", "entry", "printed", "computed", "half_units", "percent")
    rows = [
        (pair.published.dihedral_deg, entry.name, entry.printed, entry.computed, entry.half_units, entry.percent)
        for pair in pairs
        for entry in pair.entries
    ]
    return Table(header, rows)


def regeneration_text(pairs: tuple[RegeneratedPair, ...]) -> str:
    """Both pairs beside the print, entry by entry, the spectra and the verdict."""
    parts = []
    for pair in pairs:
        parts += [
            f"Dihedral {pair.published.dihedral_deg:g} deg, {pair.model.point.dynamics} dynamics",
            *(columns(*table) for table in matrices(pair.model)),
            columns(*comparison_table(pair.model, pair.published)),
            columns(
                ("eigenvalues 1/s", "printed A", "regenerated A"),
                [
                    ("", eigenvalue_text(printed), eigenvalue_text(computed))
                    for printed, computed in zip(pair.printed_eigenvalues, pair.eigenvalues, strict=True)
                    if printed.imag >= 0
                ],
            ),
            checks_text(pair.checks),
        ]
    ok = all(pair.ok for pair in pairs)
    return "\n\n".join([*parts, f"Both pairs regenerated: {'yes' if ok else 'NO'}"])


def _spectrum(A: np.ndarray) -> np.ndarray:
    values = np.linalg.eigvals(A)
    return values[np.lexsort((-values.imag, -np.round(np.abs(values), 6)))]
