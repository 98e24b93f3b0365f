"""How uncertain each entry of a linear model is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.by_value import ByValue
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table
from hfa_support.reporting.unit_system import entries_in_force

#: Why a model comes without bands.
NO_BANDS = "No uncertainty bands: they are known for the six printed states of the identified aircraft only"


@dataclass(frozen=True, eq=False, repr=False)
class Bands(ByValue, Reported):
    """Uncertainty of a linear model's entries, same shapes and units as A (6, 6) and B (6, 5).

    rounding: standard error propagated from the rounding of the print through the parameters and the trim. The
    equations are taken as they are: `docs/validation.md` says where they were tested.
    """

    A_rounding: np.ndarray
    B_rounding: np.ndarray

    @property
    def A(self) -> np.ndarray:
        """Half width of the band on A: two standard errors."""
        return 2 * self.A_rounding

    @property
    def B(self) -> np.ndarray:
        """Half width of the band on B: two standard errors."""
        return 2 * self.B_rounding

    def report(self) -> Report:
        """Half width of the band of every entry of A and B."""
        tables = [
            Table(
                (name, *across), [(row, *(f"{value:.1e}" for value in band[i])) for i, row in enumerate(LINEAR_STATES)]
            )
            for name, across, band in (("A ±", LINEAR_STATES, self.A), ("B ±", INPUTS, self.B))
        ]
        return Report(
            "Uncertainty of the entries, in rad, ft, s: two standard errors of rounding and the spread", tables
        )


def trust_in(bands: Bands | None) -> str:
    """The sentence on the bands."""
    if bands is None:
        return NO_BANDS
    A, B = ((LINEAR_UNITS, 1), (LINEAR_UNITS, -1)), ((LINEAR_UNITS, 1), (tuple(INPUT_UNITS), -1))
    size = max(float(entries_in_force(band, *axes).max()) for band, axes in ((bands.A, A), (bands.B, B)))
    return f"Largest uncertainty band of an entry: {size:.2g} (every band: --json or -o)"
