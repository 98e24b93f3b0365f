"""A fit of the parameters to the printed matrices, an identification with its evidence, and what both say."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hfa_model.parameters import FIELDS, Parameters, ParameterSet
from hfa_model.vectors import Input
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table
from trim.linear.compare import EntryRow, entries_records, entries_table

#: Not determined by the print: held, each with its reason.
ASSUMED: dict[str, tuple[float, str, str]] = {
    "chord": (
        8.0,
        "assumed",
        "the printed matrices determine area times coefficient only; Gibson et al. 2011, Table 1, has a chord of 8 ft",
    ),
    "thrust_per_throttle": (
        1.0,
        "assumed",
        "the printed matrices determine forces per mass; counting throttle in lbf of total thrust fixes the mass scale",
    ),
    "gravity": (32.2, "print", "A(speed, pitch) is printed as -32.2"),
}
IDENTIFIED: tuple[str, ...] = tuple(name for name in Parameters._fields if name not in ASSUMED)
SCHEMA = "hfa.identification/1"


@dataclass(frozen=True, eq=False)
class Fit(ByValue):
    """One least-squares fit.

    parameters: with sources and covariance. inputs: fitted trim inputs, one `Input` a printed angle.
    sum_of_squares: Σ (difference / half unit)² over the printed entries; `entries`: how many of them some
    parameter moves. largest: the largest |difference| / half unit.
    expected_sum: the sum of squares that rounding alone gives on average, trace((I - H) C): C the covariance of
    the rounding errors, H the projection onto what the parameters can fit (no prior).
    singular_values: of the weighted Jacobian in relative parameters.
    directions: rows are their parameter combinations.
    """

    parameters: ParameterSet
    inputs: tuple[Input, ...]
    sum_of_squares: float
    expected_sum: float
    entries: int
    largest: float
    singular_values: np.ndarray
    directions: np.ndarray

    def quality(self) -> str:
        """The sum of squares and the largest difference."""
        return (
            f"Sum of squares {self.sum_of_squares:.2f} half units² (rounding alone gives "
            f"{self.expected_sum:.1f} on average), largest difference {self.largest:.2f} half units"
        )

    def determination(self) -> Part:
        """Singular values: a combination of relative parameters known to 1/(s sqrt 3)."""
        rows = []
        for value, direction in zip(self.singular_values, self.directions, strict=True):
            largest = np.argsort(-np.abs(direction))[:4]
            combination = "  ".join(f"{direction[i]:+.2f} {IDENTIFIED[i]}" for i in largest if abs(direction[i]) > 0.1)
            rows.append((f"{value:.3g}", f"{100 / (value * np.sqrt(3)):.2g} %", combination))
        return (
            Table(("singular value", "known to", "combination of relative parameters"), rows),
            "Not determined by the print, in combination only: all masses, inertias, hinge constants and force "
            "coefficients together\n(fixed by thrust_per_throttle), and chord times the coefficients "
            "(fixed by chord).",
        )


@dataclass(frozen=True)
class Structure:
    """A structure tried, and the best that it reaches on the print."""

    description: str
    sum_of_squares: float
    largest: float


@dataclass(frozen=True)
class LeftOut:
    """One printed angle predicted from the other: combinations determined, and the worst entry of each row.

    errors: row of the linear model -> largest |predicted - printed| relative to the row's largest entry.
    pitch_shape_error: the same for the pitch-rate row after the best common factor on that row.
    """

    fitted_deg: float
    predicted_deg: float
    determined: int
    errors: dict[str, float]
    pitch_shape_error: float


@dataclass(frozen=True, repr=False)
class Identification(Reported):
    """The published structure's fit, and the evidence.

    starts: sum of squares that each seeded start reached. tables: printed angle (deg) -> entries.
    """

    fit: Fit
    starts: list[float]
    tables: dict[float, tuple[EntryRow, ...]]
    structures: tuple[Structure, ...]
    left_out: tuple[LeftOut, ...]

    def report(self) -> Report:
        """The whole evidence."""
        fit = self.fit
        agreeing = sum(value < min(self.starts) * (1 + 1e-6) + 1e-9 for value in self.starts)
        return Report(
            title=f"{len(IDENTIFIED)} parameters identified from {fit.entries} printed entries; {agreeing} of "
            f"{len(self.starts)} starts agree\n{fit.quality()}",
            parts=(
                fit.parameters.table(),
                entries_table(
                    "entry, as printed", {f"{angle:g} deg ": entries for angle, entries in self.tables.items()}
                ),
                fit.determination(),
                _structures(self),
                _left_out(self),
            ),
            data=_data(self),
            records=entries_records(self.tables),
        )


def _data(result: Identification) -> dict[str, Any]:
    """Parameters, entries, singular values, structures tried and cross-prediction, ready for JSON."""
    parameters = result.fit.parameters
    return {
        "schema": SCHEMA,
        "parameters": {
            name: {
                "value": getattr(parameters.values, name),
                "unit": getattr(FIELDS, name).unit,
                "source": parameters.sources[name],
                "standard_error": parameters.standard_errors.get(name),
            }
            for name in Parameters._fields
        },
        "sum_of_squares": result.fit.sum_of_squares,
        "expected_sum": result.fit.expected_sum,
        "largest_half_units": result.fit.largest,
        "starts": result.starts,
        "singular_values": result.fit.singular_values.tolist(),
        "trim_inputs": {
            str(angle): inputs._asdict() for angle, inputs in zip(result.tables, result.fit.inputs, strict=True)
        },
        "entries": [
            {"dihedral_deg": angle, **entry.to_dict()} for angle, table in result.tables.items() for entry in table
        ],
        "structures": [asdict(structure) for structure in result.structures],
        "left_out": [asdict(row) for row in result.left_out],
    }


def _structures(result: Identification) -> Table:
    rows = [(row.description, f"{row.sum_of_squares:.4g}", f"{row.largest:.4g}") for row in result.structures]
    return Table(("structure", "sum of squares", "largest, half units"), rows)


def _left_out(result: Identification) -> Part:
    rows = [
        (
            f"{row.predicted_deg:g} from {row.fitted_deg:g} deg",
            f"{row.determined} of {len(IDENTIFIED)}",
            *(f"{100 * row.errors[name]:.2g} %" for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")),
            f"{100 * row.pitch_shape_error:.2g} %",
        )
        for row in result.left_out
    ]
    header = ("predicted", "determined", "speed", "alpha", "pitch_rate", "dihedral_rate", "pitch_rate, up to a factor")
    return (
        Table(header, rows),
        "One angle alone does not split the pitch inertia into its constant and its sin² η part:\n"
        "it leaves one factor on the whole pitch-rate row open, and nothing else.",
    )
