"""An identification with its evidence, and what it says."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from hfa_model.parameters import FIELDS, Parameters
from hfa_model.reporting.report import Block, Report, Reported
from hfa_model.reporting.text import Table
from trim.identification.fit_result import IDENTIFIED, Fit
from trim.linear.compare import EntryRow, entries_records, entries_table

SCHEMA = "hfa.identification/1"


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


def _left_out(result: Identification) -> Block:
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
    return Block(
        (
            Table(header, rows),
            "One angle alone does not split the pitch inertia into its constant and its sin² η part:\n"
            "it leaves one factor on the whole pitch-rate row open, and nothing else.",
        )
    )
