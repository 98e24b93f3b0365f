"""Comparison of both linear models printed in the paper with those computed from one aircraft."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_model.published import PublishedModel, published_models
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import (
    Check,
    Checked,
    Report,
    Reported,
    at_most,
    checks_block,
    verdict_text,
)
from hfa_support.reporting.results import ByValue, Result, Roots, storable
from hfa_support.reporting.text import Table, eigenvalue_text
from trim.hfa.printed import (
    EntryRow,
    compare,
    comparison_table,
    eigenvalue_errors,
    entries_records,
    entries_table,
)
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import level_model
from trim.reports.linear_report import matrices

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest error in half units of the last digit. Up to 1 the rounded entries are equal; up to 3
#: they differ by at most one in the last digit.
MOST_HALF_UNITS = 3.0
#: Largest error of eigenvalues: relative, or absolute for those slower than `SLOW`, 1/s.
MOST_EIGENVALUE_ERROR = 2e-3
MOST_SLOW_EIGENVALUE_ERROR = 5e-4
SLOW = 1.0
#: Number of entries of each pair in a summary.
_FARTHEST = 3


@dataclass(frozen=True, eq=False, repr=False)
class RegeneratedPair(ByValue, Checked, Result, Reported):
    """Computed and printed linear model (A, B) at one dihedral angle.

    published: printed values.
    model: computed values.
    entries: computed and printed values.
    printed_eigenvalues: eigenvalues of the printed A, 1/s.
    eigenvalues: eigenvalues of the computed A, 1/s.
    checks: checks of the entries and both spectra.
    """

    published: PublishedModel
    model: LinearModel
    entries: tuple[EntryRow, ...]
    printed_eigenvalues: Roots
    eigenvalues: Roots
    checks: tuple[Check, ...]

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "dihedral_deg": self.published.dihedral_deg,
            "dynamics": self.model.point.dynamics,
            "operating_point": self.model.point,
            "states": self.model.states,
            "inputs": self.model.inputs,
            "A": self.model.A,
            "B": self.model.B,
            "entries": self.entries,
            "printed_eigenvalues": self.printed_eigenvalues,
            "eigenvalues": self.eigenvalues,
            "checks": self.checks,
            "ok": self.ok,
        }

    def report(self) -> Report:
        """Return a report that compares the computed with the printed model: entries, spectra and
        checks.
        """
        model = self.model
        printed_deg = self.published.dihedral_deg
        spectra = [
            ("", eigenvalue_text(printed), eigenvalue_text(computed))
            for printed, computed in zip(self.printed_eigenvalues, self.eigenvalues, strict=True)
            if printed.imag >= 0  # one eigenvalue of each pair
        ]
        return Report(
            title=f"Dihedral {printed_deg:g} deg, {model.point.dynamics} dynamics",
            parts=(
                *matrices(model),
                comparison_table(model, self.published),
                Table(("eigenvalues 1/s", "printed A", "regenerated A"), spectra),
                checks_block(self.checks),
            ),
            data=storable(self),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Regeneration(ByValue, Result, Reported):
    """Both printed linear models, regenerated with one aircraft.

    pairs: for each printed angle: operating point, A, B, entries, eigenvalues, checks
    """

    schema = "hfa.regeneration/1"

    pairs: tuple[RegeneratedPair, ...]

    @property
    def ok(self) -> bool:
        """True if every check of both pairs passes."""
        return all(pair.ok for pair in self.pairs)

    def picture(self) -> Picture:
        """Return a picture with the difference of every computed entry from the printed entry."""
        text = "Difference of every entry from its printed value"
        return Picture("regeneration.png", text, lambda: _figure(self.pairs))

    def summary(self) -> Report:
        """Return a short report with the verdict, the checks, and the entries with the largest
        differences.

        The data of the report contain all entries.
        """
        angles = [f"{pair.published.dihedral_deg:g} deg" for pair in self.pairs]
        rows = []
        for checks in zip(*(pair.checks for pair in self.pairs), strict=True):
            values = [f"{check.value:.3g}" for check in checks]
            verdict = verdict_text(all(check.ok for check in checks))
            rows.append((checks[0].name, *values, f"{checks[0].limit:.3g}", verdict))
        farthest = {}
        for angle, pair in zip(angles, self.pairs, strict=True):
            ordered = sorted(pair.entries, key=lambda entry: -abs(entry.half_units))
            # The key is printed before the name of an entry: "10 deg, A(alpha, alpha)".
            farthest[f"{angle}, "] = ordered[:_FARTHEST]
        parts = (
            Table(("check", *angles, "limit", "verdict"), rows),
            entries_table("farthest from the print", farthest),
        )
        return replace(self.report(), title=self.verdict, parts=parts)

    @property
    def verdict(self) -> str:
        """Sentence that states whether both printed pairs were regenerated."""
        return f"Both printed pairs regenerated: {'yes' if self.ok else 'NO'}"

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"cases": self.pairs, "ok": self.ok}

    def report(self) -> Report:
        """Return a full report that compares both computed pairs with the printed pairs, and the
        verdict.
        """
        reports = [pair.report() for pair in self.pairs]
        return Report(
            title="",
            parts=(
                *reports,
                self.picture(),
                self.verdict,
            ),
            data=storable(self),
            records=entries_records(
                {pair.published.dihedral_deg: pair.entries for pair in self.pairs}
            ),
        )


def _figure(pairs: tuple[RegeneratedPair, ...]) -> Figure:
    """Return a figure of computed minus printed entries, in half units of the last digit."""
    figure = new_figure(10.0, 7.0)
    columns = list(zip(*(pair.entries for pair in pairs), strict=True))
    # Entries that both pairs print as 0, nearly all of which are 0 in any model, are left out.
    shown = [column for column in columns if any(entry.printed for entry in column)]
    tallest = max(abs(entry.half_units) for column in shown for entry in column)
    places = range(len(shown))
    panels = figure.subplots(1, len(pairs), sharey=True, squeeze=False)[0]
    for axes, pair, entries in zip(panels, pairs, zip(*shown, strict=True), strict=True):
        axes.axvspan(-1, 1, color="0.88", label="rounds to the printed digits")
        axes.barh(places, [entry.half_units for entry in entries], color="C0", height=0.7)
        axes.margins(y=0.01)
        axes.set_xlim(-max(2.0, 1.1 * tallest), max(2.0, 1.1 * tallest))
        axes.set_xlabel("regenerated minus printed, half units of the last digit", fontsize=8)
        axes.set_title(f"dihedral {pair.published.dihedral_deg:g} deg", fontsize=10)
        axes.set_yticks(places, [entry.name for entry in entries], fontsize=7)
    panels[0].invert_yaxis()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", fontsize=8, frameon=False)
    return figure


def regenerate_all(aircraft: Model) -> Regeneration:
    """Return the comparison of both printed linear models with those of an aircraft at the printed
    trims.
    """
    return Regeneration(
        tuple(
            check_pair(level_model(aircraft, printed.dihedral), printed)
            for printed in published_models()
        )
    )


def check_pair(model: LinearModel, published: PublishedModel) -> RegeneratedPair:
    """Return the comparison of a linear model with a printed pair: entries, spectra and checks.

    The checks concern the largest error of an entry, the fast and the slow eigenvalues, and the
    number of unstable eigenvalues.

    model: computed linear model
    published: the printed pair (A, B)
    """
    entries = compare(model, published)
    printed = _spectrum(published.A)
    computed = _spectrum(model.A)
    errors = eigenvalue_errors(computed, printed)
    is_slow = np.abs(printed) < SLOW
    worst = max(entries, key=lambda entry: abs(entry.half_units))
    off = f"{worst.name} is {worst.computed:.6g}, printed {worst.printed:.6g}"
    fast_error = float((errors / np.abs(printed))[~is_slow].max())
    slow_error = float(errors[is_slow].max(initial=0.0))
    modes = "modes differ from those of the printed A"
    unstable = [int(np.count_nonzero(poles.real > 0)) for poles in (printed, computed)]
    count = (
        f"the printed A has {unstable[0]} unstable eigenvalues, the regenerated one {unstable[1]}"
    )
    checks = (
        at_most("largest entry error, half units", abs(worst.half_units), MOST_HALF_UNITS, off),
        at_most(
            "fast eigenvalues, relative error",
            fast_error,
            MOST_EIGENVALUE_ERROR,
            f"the fast {modes}",
        ),
        at_most(
            "slow eigenvalues, absolute error, 1/s",
            slow_error,
            MOST_SLOW_EIGENVALUE_ERROR,
            f"the slow {modes}",
        ),
        at_most(
            "unstable eigenvalues, difference in number", abs(unstable[0] - unstable[1]), 0, count
        ),
    )
    return RegeneratedPair(published, model, entries, printed, computed, checks)


def _spectrum(A: np.ndarray) -> np.ndarray:
    """Return the eigenvalues by magnitude, the upper one of a pair first, (n,)."""
    values = np.linalg.eigvals(A)
    return values[np.lexsort((-values.imag, -np.round(np.abs(values), 6)))]
