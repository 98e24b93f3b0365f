"""What an identification says."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from hfa_model.parameter_report import parameters_table
from hfa_model.parameters import FIELDS, Parameters
from hfa_model.reporting.report import Block, Report
from hfa_model.reporting.text import Table
from trim.identification.evidence import Identification
from trim.identification.identify import IDENTIFIED, Fit
from trim.linear.compare import entries_records, entries_table

SCHEMA = "hfa.identification/1"


def identification_report(result: Identification) -> Report:
    """The whole evidence."""
    fit = result.fit
    agreeing = sum(value < min(result.starts) * (1 + 1e-6) + 1e-9 for value in result.starts)
    return Report(
        title=f"{len(IDENTIFIED)} parameters identified from {fit.entries} printed entries; {agreeing} of "
        f"{len(result.starts)} starts agree\n{_quality(fit)}",
        parts=(
            parameters_table(fit.parameters),
            entries_table("entry", {f"{angle:g} deg ": entries for angle, entries in result.tables.items()}),
            _determination(fit),
            _structures(result),
            _left_out(result),
        ),
        data=_data(result),
        records=entries_records(result.tables),
    )


def fit_report(fit: Fit) -> Report:
    """One fit: how well, which parameters, what the print determines."""
    return Report(
        title=f"Fit to {fit.entries} printed entries\n{_quality(fit)}",
        parts=(parameters_table(fit.parameters), _determination(fit)),
    )


def _quality(fit: Fit) -> str:
    return (
        f"Sum of squares {fit.sum_of_squares:.2f} half units² (rounding alone gives "
        f"{fit.expected_sum:.1f} on average), largest difference {fit.largest:.2f} half units"
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


def _determination(fit: Fit) -> Block:
    """Singular values: a combination of relative parameters known to 1/(s sqrt 3)."""
    rows = []
    for value, direction in zip(fit.singular_values, fit.directions, strict=True):
        largest = np.argsort(-np.abs(direction))[:4]
        combination = "  ".join(f"{direction[i]:+.2f} {IDENTIFIED[i]}" for i in largest if abs(direction[i]) > 0.1)
        rows.append((f"{value:.3g}", f"{100 / (value * np.sqrt(3)):.2g} %", combination))
    return Block(
        (
            Table(("singular value", "known to", "combination of relative parameters"), rows),
            "Not determined by the print, in combination only: all masses, inertias, hinge constants and force "
            "coefficients together\n(fixed by thrust_per_throttle), and chord times the coefficients (fixed by chord).",
        )
    )


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
