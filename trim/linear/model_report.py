"""What a linear model says."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table, angle_text, degrees, eigenvalue_text, in_degrees, matrix_table
from hfa_model.reporting.unit_system import entries_in_force, unit_in_force
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, RATE_UNITS, UNITS
from hfa_model.winds import DISTURBANCE_UNIT
from trim.linear.bands import Bands
from trim.linear.linearize import LinearModel
from trim.linear.modes import Mode, modes_of
from trim.point.trim_report import warnings

#: Why a model comes without bands.
NO_BANDS = "No uncertainty bands: they are known for the six printed states of the identified aircraft only"
#: Matrix -> names of its rows, names of its columns, values.
_Shown = dict[str, tuple[tuple[str, ...], tuple[str, ...], np.ndarray]]
_UNITS = tuple(UNITS[name] for name in LINEAR_STATES)
LINEAR_MODEL_SCHEMA = "hfa.linear-model/1"


def linear_model_report(
    model: LinearModel, bands: Bands | None = None, trust: str = "", *, windy: bool = False
) -> Report:
    """A, B, offsets and modes; the bands of the entries, and a sentence on them, where they are asked for.

    windy: E, and F where the outputs are not the states, stand in the text and in the records too.
    """
    point, shown = model.point, _shown(model, windy)
    rate, output = (" + E w", " + F w") if windy else ("", "")
    return Report(
        title=f"Linear model at dihedral {angle_text(point.states.dihedral)}, {point.dynamics} dynamics "
        f"(x' = A x + B u{rate},{f' y = C x + D u{output},' * ('C' in shown)} x = X - X0, u = U - U0)\n"
        f"{', '.join([*shown][:-1])} and {[*shown][-1]} in rad, {unit_in_force('ft')}, s; "
        "the offsets X0 and U0 in the units beside them",
        parts=(
            *matrices(model, windy=windy),
            *filter(None, [trust]),
            _offsets(model),
            modes_table(modes_of(model.A, model.states)),
        ),
        notes=warnings(point),
        data=_data(model, bands),
        records=_records(model, bands, shown),
    )


def trust_in(bands: Bands | None) -> str:
    """The sentence on the bands."""
    if bands is None:
        return NO_BANDS
    A, B = ((_UNITS, 1), (_UNITS, -1)), ((_UNITS, 1), (tuple(INPUT_UNITS), -1))
    size = max(float(entries_in_force(band, *axes).max()) for band, axes in ((bands.A, A), (bands.B, B)))
    return f"Largest uncertainty band of an entry: {size:.2g} (every band: --json or -o)"


def bands_report(bands: Bands) -> Report:
    """Half width of the band of every entry of A and B."""
    tables = [
        Table((name, *across), [(row, *(f"{value:.1e}" for value in band[i])) for i, row in enumerate(LINEAR_STATES)])
        for name, across, band in (("A ±", LINEAR_STATES, bands.A), ("B ±", INPUTS, bands.B))
    ]
    return Report("Uncertainty of the entries, in rad, ft, s: two standard errors of rounding and the spread", tables)


def matrices(model: LinearModel, *, windy: bool = False) -> tuple[Table, ...]:
    """A and B with their names, C and D where the outputs are not the states; with winds E and F."""
    columns = dict.fromkeys("AC", model.state_units) | dict.fromkeys("BD", model.input_units)
    columns |= dict.fromkeys("EF", model.disturbance_units)
    rows = dict.fromkeys("ABE", model.state_units) | dict.fromkeys("CDF", model.output_units)
    return tuple(
        matrix_table(name, row_names, column_names, values, (rows[name], 1), (columns[name], -1))
        for name, (row_names, column_names, values) in _shown(model, windy).items()
    )


def _shown(model: LinearModel, windy: bool) -> _Shown:
    """The matrices of the text and of the records."""
    columns = (("A", "C", model.states), ("B", "D", model.inputs), ("E", "F", model.disturbances))[: 3 if windy else 2]
    found = {of_rates: (model.states, names, getattr(model, of_rates)) for of_rates, _, names in columns}
    if model.outputs != model.states:
        found |= {of_outputs: (model.outputs, names, getattr(model, of_outputs)) for _, of_outputs, names in columns}
    return found


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
        "outputs": list(model.outputs),
        "output_units": list(model.output_units),
        "C": model.C.tolist(),
        "D": model.D.tolist(),
        "modes": [mode.to_dict() for mode in modes_of(model.A, model.states)],
        "warnings": warnings(point),
    }
    if (part := model.output_part) is not None:
        data |= {"disturbances": list(part.disturbances), "disturbance_units": list(part.disturbance_units)}
        data |= {"E": part.E.tolist(), "F": part.F.tolist(), "output_offsets": part.offsets.tolist()}
    if bands is not None:
        data["A_band"], data["B_band"] = bands.A.tolist(), bands.B.tolist()
    return data


def _records(
    model: LinearModel,
    bands: Bands | None,
    shown: _Shown,
) -> Table:
    """Header and rows (matrix, row, column, value, unit, band) of the matrices in the text, then the offsets."""
    widths = {} if bands is None else {"A": bands.A, "B": bands.B}
    of_outputs = dict(zip(model.outputs, model.output_units, strict=True))
    rows: list[tuple[Any, ...]] = []
    for name, (row_names, column_names, values) in shown.items():
        band, of_rates = widths.get(name), name in "ABE"
        for i, row in enumerate(row_names):
            unit = getattr(RATE_UNITS, row) if of_rates else of_outputs[row]
            for j, column in enumerate(column_names):
                per = f"({unit})/({UNITS.get(column, DISTURBANCE_UNIT)})"
                rows.append((name, row, column, values[i, j], per, "" if band is None else band[i, j]))
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
