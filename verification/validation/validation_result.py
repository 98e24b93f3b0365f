"""The comparison with the outside, and what it says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from hfa_model.reporting.checks import Check, checks_block
from hfa_model.reporting.report import Report, Reported
from hfa_model.reporting.text import Table, shown_unit, shown_value
from verification.validation.outside import PrintedEntry, ReleasedTrim, outside_data

SCHEMA = "hfa.validation/1"


@dataclass(frozen=True)
class TrimDifference:
    """Ours minus theirs at one trim. deflection: largest of the four, rad. thrust: relative. eigenvalue: 1/s."""

    released: ReleasedTrim
    deflection: float
    thrust: float
    eigenvalue: float


@dataclass(frozen=True)
class EntryDifference:
    """A printed entry, ours, and the difference in half units of the last digit (0 where both are exact)."""

    printed: PrintedEntry
    computed: float
    half_units: float


@dataclass(frozen=True, repr=False)
class Validation(Reported):
    """Every comparison with the outside. fast_roots: (dihedral deg, read from the figure, computed), 1/s."""

    dynamics: str
    trims: tuple[TrimDifference, ...]
    entries: tuple[EntryDifference, ...]
    fast_roots: tuple[tuple[float, float, float], ...]
    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether every check passed."""
        return all(check.ok for check in self.checks)

    def report(self) -> Report:
        """The released simulation trim by trim, the third printed model entry by entry, and the verdicts."""
        sources = outside_data()
        return Report(
            title=f"Comparison with the outside, {self.dynamics} dynamics: {'PASS' if self.ok else 'FAIL'}",
            parts=(
                f"Trims and eigenvalues of the released simulation\n{sources['released_simulation']['source']}",
                _trims(self),
                f"The third printed model, 10 deg at 30 ft/s\n{sources['qu_2018']['source']}",
                _entries(self),
                f"Fast dihedral root at 30 ft/s\n{sources['gibson_2011']['source']}",
                Table(
                    ("dihedral deg", "read from the figure 1/s", "computed 1/s"),
                    [(f"{degrees:g}", f"{read:.2f}", f"{computed:.4f}") for degrees, read, computed in self.fast_roots],
                ),
                checks_block(self.checks),
            ),
            data=_data(self),
            records=Table(
                ("entry", "printed", "computed", "half_units", "unit"),
                [
                    (each.printed.name, each.printed.value, each.computed, each.half_units, each.printed.unit)
                    for each in self.entries
                ],
            ),
        )


def _trims(found: Validation) -> Table:
    rows = [
        (
            shown_value(each.released.speed, "ft/s"),
            f"{math.degrees(each.released.dihedral):g}",
            f"{math.degrees(each.released.alpha):.3f}",
            f"{each.deflection:.1e}",
            f"{each.thrust:.1e}",
            f"{each.eigenvalue:.1e}",
        )
        for each in found.trims
    ]
    header = (
        f"speed {shown_unit('ft/s')}",
        "dihedral deg",
        "alpha deg",
        "deflection, rad",
        "thrust, relative",
        "eigenvalue, 1/s",
    )
    return Table(header, rows)


def _entries(found: Validation) -> Table:
    rows = [
        (each.printed.name, each.printed.digits, f"{each.computed:.6f}", f"{each.half_units:+.2f}")
        for each in found.entries
        if each.printed.half_unit
    ]
    return Table(("entry", "printed", "computed", "half units"), rows)


def _data(found: Validation) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "dynamics": found.dynamics,
        "ok": found.ok,
        "checks": [check.to_dict() for check in found.checks],
        "trim_units": {"speed": "ft/s", "dihedral": "rad", "alpha": "rad", "deflection_difference": "rad"}
        | {"thrust_difference": "1", "eigenvalue_difference": "1/s"},
        "trims": [
            {
                "speed": each.released.speed,
                "dihedral": each.released.dihedral,
                "alpha": each.released.alpha,
                "deflection_difference": each.deflection,
                "thrust_difference": each.thrust,
                "eigenvalue_difference": each.eigenvalue,
            }
            for each in found.trims
        ],
        "entries": [
            {"entry": each.printed.name, "printed": each.printed.value, "computed": each.computed}
            | {"half_units": each.half_units}
            for each in found.entries
        ],
        "misprints": outside_data()["qu_2018"]["misprints"],
    }
