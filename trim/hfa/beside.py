"""What the report of a linear model of the flexible aircraft shows beside the model: error bands,
other dynamics and the printed matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.choice import aircraft
from hfa_model.declaration import parameters_of
from hfa_model.parameters import INPUTS, LINEAR_STATES, default_parameters
from hfa_model.variants import VARIANTS
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.results import Result
from hfa_support.reporting.rows import Group, Row
from hfa_support.reporting.text import Table
from trim.hfa.printed import Bands, comparison_table, entry_bands, has_bands, printed_at
from trim.linear.linear_model import LinearModel
from trim.linear.modes import Mode
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim
from trim.reports.linear_report import Beside


@dataclass(frozen=True)
class ModeDifference(Result):
    """Mode of two dynamics at the same condition.

    mode: name of the mode
    eigenvalue: eigenvalue of the reported dynamics, 1/s
    other: eigenvalue of the other dynamics, 1/s
    percent: 100 |other - eigenvalue| / |eigenvalue|
    """

    mode: str
    eigenvalue: complex
    other: complex
    percent: float


def with_other_dynamics(point: OperatingPoint) -> LinearModel | None:
    """Return the linear model of `newton` dynamics at the condition of a trim of `published`
    dynamics, and the reverse.

    The result is None for further dynamics, for a model in SI units, which was converted from its
    `native` one, and if the other dynamics have no trim there.
    """
    model = point.model
    if model.name not in VARIANTS or model.native is not model or point.found_by is None:
        return None
    name = next(variant for variant in VARIANTS if variant != model.name)
    other = aircraft(name, parameters_of(model))
    condition = point.found_by.asked.at()  # with numbers in place of tables
    with suppress(BadInputError, NoSolutionError):
        return trim(other, condition, point).linearize()
    return None


def mode_differences(modes: Sequence[Mode], others: Sequence[Mode]) -> tuple[ModeDifference, ...]:
    """Return the differences of the modes that both dynamics have, by name."""
    by_name = {mode.name: mode.eigenvalue for mode in others}
    differences = []
    for mode in modes:
        other = by_name.get(mode.name)
        if other is not None and mode.eigenvalue:
            percent = 100.0 * abs(other - mode.eigenvalue) / abs(mode.eigenvalue)
            differences.append(ModeDifference(mode.name, mode.eigenvalue, other, percent))
    return tuple(differences)


#: Which of the two dynamics to use.
_WHICH = (
    "newton dynamics are exact mechanics, published ones those of the printed matrices: where they "
    "are apart, trust newton (--dynamics newton)"
)


def differences_group(other: str, differences: Sequence[ModeDifference]) -> Group:
    """Return the eigenvalues of the other dynamics, and how far they are from the reported ones.

    other: name of the other dynamics
    """
    rows = [
        Row(difference.mode, difference.other, "1/s", f"{difference.percent:.3g} % apart")
        for difference in differences
    ]
    return Group(f"modes of {other} dynamics", tuple(rows), (_WHICH,))


def beside(model: LinearModel) -> Beside:
    """Return what the report of a linear model of the flexible aircraft shows beside the model.

    For states and inputs other than those printed in the paper, and for further dynamics, it only
    says that no error bands are known.
    """
    aircraft = model.model
    has_printed_signals = model.states == LINEAR_STATES and model.inputs == INPUTS
    if aircraft.name not in VARIANTS or not has_printed_signals:
        return Beside(_accuracy(None, model, None), [], [], {})
    problem = model.point.found_by
    bands = None
    if problem is not None and has_bands(parameters_of(aircraft.native)):
        bands = entry_bands(default_parameters(), problem.asked, model)
    data: dict[str, Any] = {} if bands is None else {"A_band": bands.A, "B_band": bands.B}
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
    # The paper prints feet; a model in SI units has a native one in feet.
    if published is not None and aircraft.source.native is None:
        printed.append(comparison_table(model, published))
        data["printed"] = {"A": published.A, "B": published.B}
    return Beside(_accuracy(bands, model, other), others, printed, data)


def _accuracy(bands: Bands | None, model: LinearModel, other: LinearModel | None) -> str:
    """Return sentences on the largest error band and the largest difference from other dynamics.

    bands: error bands, or None if they are unknown
    other: linear model of the other dynamics, or None
    """
    sentences = []
    if bands is not None:
        largest = _largest(bands.A, bands.B)
        sentences.append(f"Largest error of an entry from the printed digits: {largest}")
    else:
        sentences.append(
            "No error bands: only the six printed states of the identified aircraft have them"
        )
    if other is not None:
        differences = np.abs(other.A - model.A), np.abs(other.B - model.B)
        all_differences = np.hstack(differences).ravel()
        place = int(all_differences.argmax())
        entry = float(np.abs(np.hstack([model.A, model.B])).ravel()[place])
        sentence = (
            f"Largest difference of an entry to {other.point.dynamics} dynamics: "
            f"{_largest(*differences)}"
        )
        if entry:
            sentence += f" ({100.0 * all_differences[place] / entry:.3g} %)"
        sentences.append(sentence)
    return "\n".join(sentences)


def _largest(A: np.ndarray, B: np.ndarray) -> str:
    """Return the largest entry of A and B, none of them below 0, with its name, as text: "0.1 in
    A(speed, alpha)".
    """
    name, columns, largest = ("A", LINEAR_STATES, A) if A.max() >= B.max() else ("B", INPUTS, B)
    row, column = np.unravel_index(largest.argmax(), largest.shape)
    return f"{largest[row, column]:.2g} in {name}({LINEAR_STATES[row]}, {columns[column]})"
