"""What an identification says: as numbers for JSON, as a table, and as text for a person."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_model.parameters import FIELDS, Parameters
from hfa_model.support.text import Table, columns
from trim.identification.evidence import Identification
from trim.identification.identify import IDENTIFIED

SCHEMA = "hfa.identification/1"


def identification_data(result: Identification) -> dict[str, Any]:
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
        "rival": {"structure": result.rival.parameters.structure, "sum_of_squares": result.rival.sum_of_squares},
        "trim_inputs": {
            str(angle): inputs._asdict() for angle, inputs in zip(result.tables, result.fit.inputs, strict=True)
        },
        "entries": [
            {
                "dihedral_deg": angle,
                "name": entry.name,
                "printed": entry.printed,
                "computed": entry.computed,
                "half_units": entry.half_units,
                "percent": entry.percent,
            }
            for angle, table in result.tables.items()
            for entry in table
        ],
        "structures": [structure.__dict__ for structure in result.structures],
        "left_out": [row.__dict__ for row in result.left_out],
    }


def identification_table(result: Identification) -> Table:
    """One row a printed entry."""
    rows = [
        (angle, entry.name, entry.printed, entry.computed, entry.half_units, entry.percent)
        for angle, table in result.tables.items()
        for entry in table
    ]
    return Table(("dihedral_deg", "entry", "printed", "computed", "half_units", "percent"), rows)


def identification_text(result: Identification) -> str:
    """The whole evidence on a terminal."""
    fit = result.fit
    agreeing = sum(value < min(result.starts) * (1 + 1e-6) + 1e-9 for value in result.starts)
    summary = (
        f"{len(IDENTIFIED)} parameters identified from {fit.entries} printed entries; {agreeing} of "
        f"{len(result.starts)} starts agree\nSum of squares {fit.sum_of_squares:.2f} half units² (rounding alone gives "
        f"{fit.expected_sum:.1f} on average), largest difference {fit.largest:.2f} half units"
    )
    return "\n\n".join(
        [
            summary,
            _parameters_text(result),
            _entries_text(result),
            _determination_text(result),
            _structures_text(result),
            _left_out_text(result),
        ]
    )


def _parameters_text(result: Identification) -> str:
    parameters = result.fit.parameters
    rows = []
    for name in Parameters._fields:
        value, error = getattr(parameters.values, name), parameters.standard_errors.get(name)
        shown = "-" if error is None else f"{error:.2g}"
        rows.append((name, f"{value:.7g}", shown, getattr(FIELDS, name).unit, parameters.sources[name]))
    return columns(("parameter", "value", "standard error", "unit", "source"), rows)


def _entries_text(result: Identification) -> str:
    rows = [
        (
            f"{angle:g} deg {entry.name}",
            f"{entry.printed:.4f}",
            f"{entry.computed:.6f}",
            f"{entry.half_units:+.2f}",
            f"{entry.percent:+.4f}" if entry.printed else "-",
        )
        for angle, table in result.tables.items()
        for entry in table
        if not entry.is_zero
    ]
    return columns(("entry", "printed", "computed", "half units", "percent"), rows)


def _determination_text(result: Identification) -> str:
    """Singular values: a combination of relative parameters known to 1/(s sqrt 3)."""
    fit = result.fit
    rows = []
    for value, direction in zip(fit.singular_values, fit.directions, strict=True):
        largest = np.argsort(-np.abs(direction))[:4]
        combination = "  ".join(f"{direction[i]:+.2f} {IDENTIFIED[i]}" for i in largest if abs(direction[i]) > 0.1)
        rows.append((f"{value:.3g}", f"{100 / (value * np.sqrt(3)):.2g} %", combination))
    table = columns(("singular value", "known to", "combination of relative parameters"), rows)
    return (
        f"{table}\nNot determined by the print, in combination only: all masses, inertias, hinge constants and force "
        "coefficients together\n(fixed by thrust_per_throttle), and chord times the coefficients (fixed by chord)."
    )


def _structures_text(result: Identification) -> str:
    rows = [
        (row.description, str(row.extra_constants), f"{row.sum_of_squares:.4g}", f"{row.largest:.4g}")
        for row in result.structures
    ]
    return columns(("structure", "extra constants", "sum of squares", "largest, half units"), rows)


def _left_out_text(result: Identification) -> str:
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
        columns(header, rows)
        + "\nOne angle alone does not split the pitch inertia into its constant and its sin² η part:"
        + "\nit leaves one factor on the whole pitch-rate row open, and nothing else."
    )
