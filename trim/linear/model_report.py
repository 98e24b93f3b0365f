"""What a linear model says."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from hfa_model.support.report import Report
from hfa_model.support.text import Table, degrees, eigenvalue_text, in_degrees, matrix_table
from hfa_model.vectors import entry_unit
from trim.linear.bands import Bands
from trim.linear.linearize import LinearModel
from trim.linear.modes import Mode, modes_of
from trim.point.trim_report import warnings

LINEAR_MODEL_SCHEMA = "hfa.linear-model/1"


def linear_model_report(model: LinearModel, bands: Bands | None) -> Report:
    """A, B, offsets and modes; the bands of the entries where they are known."""
    point = model.point
    if bands is not None:
        size = max(float(bands.A.max()), float(bands.B.max()))
        trust = f"Largest uncertainty band of an entry: {size:.2g} (every band: --json or -o)"
    else:
        trust = "No uncertainty bands: they are known for the six printed states of the identified aircraft only"
    return Report(
        title=f"Linear model at dihedral {math.degrees(point.states.dihedral):.6g} deg, {point.dynamics} dynamics "
        f"(x' = A x + B u, x = X - X0, u = U - U0)\n"
        "A and B in rad, ft, s; the offsets X0 and U0 in the units beside them",
        parts=(*matrices(model), trust, _offsets(model), modes_table(modes_of(model.A, model.states))),
        notes=warnings(point),
        data=_data(model, bands),
        records=_records(model, bands),
    )


def matrices(model: LinearModel) -> tuple[Table, Table]:
    """A and B with their names."""
    return (
        matrix_table("A", model.states, model.states, model.A),
        matrix_table("B", model.states, model.inputs, model.B),
    )


def modes_table(modes: Iterable[Mode]) -> Table:
    """The mode table."""
    rows = []
    for mode in modes:
        shares = sorted(mode.participation.items(), key=lambda item: -item[1])[:2]
        rows.append(
            (
                mode.name,
                eigenvalue_text(mode.eigenvalue),
                f"{mode.damping:.4f}",
                f"{mode.frequency:.4f}",
                f"{mode.period:.3f}" if math.isfinite(mode.period) else "-",
                _time_to(mode),
                ", ".join(f"{name} {share:.0%}" for name, share in shares),
            )
        )
    header = (
        "mode",
        "eigenvalue 1/s",
        "damping",
        "frequency rad/s",
        "period s",
        "time to, s",
        "participation",
    )
    return Table(header, rows)


def _time_to(mode: Mode) -> str:
    time, word = (mode.time_to_half, "half") if mode.stable else (mode.time_to_double, "double")
    return f"{time:.3f} ({word})" if math.isfinite(time) else "-"


def _data(model: LinearModel, bands: Bands | None) -> dict[str, Any]:
    """A linear model with names, units, offsets, modes and, where known, the bands of its entries."""
    point = model.point
    data: dict[str, Any] = {
        "schema": LINEAR_MODEL_SCHEMA,
        "dihedral_deg": in_degrees(point.states.dihedral),
        "dynamics": point.dynamics,
        "operating_point": point.to_dict(),
        "states": list(model.states),
        "inputs": list(model.inputs),
        "state_units": list(model.state_units),
        "input_units": list(model.input_units),
        "state_offsets": model.state_offsets.tolist(),
        "input_offsets": model.input_offsets.tolist(),
        "A": model.A.tolist(),
        "B": model.B.tolist(),
        "modes": [mode.to_dict() for mode in modes_of(model.A, model.states)],
        "warnings": warnings(point),
    }
    if bands is not None:
        data["A_band"], data["B_band"] = bands.A.tolist(), bands.B.tolist()
    return data


def _records(model: LinearModel, bands: Bands | None) -> Table:
    """Header and rows (matrix, row, column, value, unit, band) of A and B, then the offsets."""
    rows: list[tuple[Any, ...]] = []
    for name, column_names, values, band in (
        ("A", model.states, model.A, None if bands is None else bands.A),
        ("B", model.inputs, model.B, None if bands is None else bands.B),
    ):
        for i, row in enumerate(model.states):
            for j, column in enumerate(column_names):
                unit = entry_unit(row, column)
                rows.append((name, row, column, values[i, j], unit, "" if band is None else band[i, j]))
    offsets = zip(model.states, model.state_offsets.tolist(), model.state_units, strict=True)
    rows += [("X0", name, "", value, unit, "") for name, value, unit in offsets]
    controls = zip(model.inputs, model.input_offsets.tolist(), model.input_units, strict=True)
    rows += [("U0", name, "", value, unit, "") for name, value, unit in controls]
    return Table(("matrix", "row", "column", "value", "unit", "band"), rows)


def _offsets(model: LinearModel) -> Table:
    states = zip(model.states, model.state_offsets.tolist(), model.state_units, strict=True)
    inputs = zip(model.inputs, model.input_offsets.tolist(), model.input_units, strict=True)
    rows = [(name, *degrees(value, unit)) for name, value, unit in (*states, *inputs)]
    return Table(("offset", "value", "unit"), rows)
