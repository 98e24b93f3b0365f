"""What the report of a linear model of the flexible aircraft has besides: error bands, other
dynamics and the printed matrices.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_model.declaration import parameters_of
from hfa_model.parameters import INPUTS, LINEAR_STATES, default_parameters
from hfa_model.variants import VARIANTS
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table
from trim.hfa.other_dynamics import differences_group, mode_differences, with_other_dynamics
from trim.hfa.printed import Bands, comparison_table, entry_bands, has_bands, printed_at
from trim.linear.linear_model import LinearModel
from trim.reports.linear_report import Beside


def beside(model: LinearModel) -> Beside:
    """Return what is known of a linear model of the flexible aircraft from elsewhere."""
    aircraft = model.model
    has_printed_signals = model.states == LINEAR_STATES and model.inputs == INPUTS
    if aircraft.name not in VARIANTS or not has_printed_signals:
        return Beside(_accuracy(None, model, None), [], [], {}, {})
    problem = model.point.found_by
    bands = None
    if problem is not None and has_bands(parameters_of(aircraft.native)):
        bands = entry_bands(default_parameters(), problem.asked, model)
    by_matrix = {} if bands is None else {"A": bands.A, "B": bands.B}
    data: dict[str, Any] = {f"{name}_band": band for name, band in by_matrix.items()}
    other = with_other_dynamics(model.point)
    others: list[Group] = []
    if other is not None:
        name = other.point.dynamics
        differences = mode_differences(model.modes, other.modes)
        others.append(differences_group(name, differences))
        data |= {
            "other_dynamics": name,
            "A_difference": other.A - model.A,
            "B_difference": other.B - model.B,
            "mode_differences": differences,
        }
    published = printed_at(model.point)
    printed: list[Table] = []
    if published is not None and aircraft.source.native is None:  # printed in feet
        printed.append(comparison_table(model, published))
        data["printed"] = {"A": published.A, "B": published.B}
    return Beside(_accuracy(bands, model, other), others, printed, by_matrix, data)


def _accuracy(bands: Bands | None, model: LinearModel, other: LinearModel | None) -> str:
    """Return sentences on the largest error band and the largest difference from other dynamics."""
    sentences = []
    if bands is not None:
        largest = _largest(bands.A, bands.B)
        sentences.append(f"Largest band of an entry from the printed rounding: {largest}")
    else:
        sentences.append(
            "No error bands: only the six printed states of the identified aircraft have them"
        )
    if other is not None:
        differences = np.abs(other.A - model.A), np.abs(other.B - model.B)
        all_differences = np.hstack(differences).ravel()
        place = int(all_differences.argmax())
        size = float(np.abs(np.hstack([model.A, model.B])).ravel()[place])
        sentence = (
            f"Largest difference of an entry to {other.point.dynamics} dynamics: "
            f"{_largest(*differences)}"
        )
        if size:
            sentence += f" ({100.0 * all_differences[place] / size:.3g} %)"
        sentences.append(sentence)
    return "\n".join(sentences)


def _largest(A: np.ndarray, B: np.ndarray) -> str:
    """Return the largest entry of A and B with its name, as text: "0.1 in A(speed, alpha)"."""
    name, columns, largest = ("A", LINEAR_STATES, A) if A.max() >= B.max() else ("B", INPUTS, B)
    row, column = np.unravel_index(largest.argmax(), largest.shape)
    return f"{largest[row, column]:.2g} in {name}({LINEAR_STATES[row]}, {columns[column]})"
