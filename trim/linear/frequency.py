"""Transfer functions and transmission zeros of a linear model, and their Bode plot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import plain
from hfa_support.reporting.text import Table, eigenvalue_text
from trim.linear.linear_model import LinearModel
from trim.linear.transfer import (
    ROUNDING,
    StateSpace,
    Transfer,
    gain_and_roots,
    transmission_zeros,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def transfers(model: LinearModel) -> list[Transfer]:
    """The transfer function of each output and input, outputs first."""
    system = scaled(model)
    poles = np.linalg.eigvals(system.A)
    signals = model.point.model.signals
    functions = []
    for i, output in enumerate(model.outputs):
        for j, name in enumerate(model.inputs):
            part = StateSpace(system.A, system.B[:, [j]], system.C[[i]], system.D[[i]][:, [j]])
            unit = f"({signals[output].unit})/({signals[name].unit})"
            size = signals[output].nominal / signals[name].nominal
            functions.append(Transfer(output, name, unit, *gain_and_roots(part, poles, size)))
    return functions


def zeros_of(model: LinearModel) -> np.ndarray:
    """Transmission zeros from all inputs to all outputs, 1/s."""
    return transmission_zeros(*scaled(model))[0]


def bode_figure(model: LinearModel) -> Figure:
    """Magnitude in dB and phase in degrees, a column an output and a line an input."""
    if not model.inputs:
        raise BadInputError("the model has no inputs: there is no Bode plot to draw")
    response = model.frequency_response()
    values = np.moveaxis(response.frdata, 2, 0)
    output_units = model.point.model.units(model.outputs)
    size = np.abs(values)
    phase = np.degrees(np.unwrap(np.angle(values), axis=0))
    if not size.any():
        raise BadInputError(
            "no chosen input reaches a chosen output: there is no Bode plot to draw"
        )
    figure = new_figure(max(5.0, 3.4 * len(model.outputs)), 5.6)
    axes = figure.subplots(2, len(model.outputs), sharex=True, squeeze=False)
    lines = {}
    for i, (output, unit) in enumerate(zip(model.outputs, output_units, strict=True)):
        above, below = axes[:, i]
        for j, (name, input_unit) in enumerate(zip(model.inputs, model.input_units, strict=True)):
            if size[:, i, j].max() <= ROUNDING * size.max():
                continue
            decibels = 20 * np.log10(size[:, i, j])
            (line,) = above.semilogx(response.omega, decibels, color=f"C{j}")
            below.semilogx(response.omega, phase[:, i, j], color=f"C{j}")
            lines[f"{name}, {input_unit}"] = line
        above.set_title(f"{output}, {unit}", fontsize=9)
        above.grid(alpha=0.3)
        below.set_xlabel("rad/s")
        below.grid(alpha=0.3)
    axes[0, 0].set_ylabel("magnitude, dB")
    axes[1, 0].set_ylabel("phase, deg")
    figure.legend([*lines.values()], [*lines], loc="outside upper center", ncols=5, fontsize=8)
    return figure


def with_transfers(report: Report, model: LinearModel) -> Report:
    """The report of a model with its transmission zeros and a row for each transfer function that
    is not zero."""
    functions = transfers(model)
    zeros = zeros_of(model)
    rows = []
    for transfer in functions:
        if transfer.gain:
            rows.append(
                (
                    f"{transfer.output} / {transfer.input}",
                    f"{transfer.gain:.6g}",
                    f"{transfer.static:.6g}",
                    _pairs_text(transfer.zeros),
                    _pairs_text(transfer.poles),
                )
            )
    sentence = (
        f"Transmission zeros from {', '.join(model.inputs)} to {', '.join(model.outputs)}, 1/s: "
        f"{_pairs_text(zeros)}"
    )
    table = Table(("transfer function", "gain", "at s = 0", "zeros 1/s", "poles 1/s"), rows)
    report = replace(report, parts=(*report.parts, sentence, table))
    return report.with_data(zeros=plain(zeros), transfers=plain(functions))


def scaled(model: LinearModel) -> StateSpace:
    """The model in nominal values, in which one rank decision suits all rows."""
    signals = model.point.model.signals

    def nominal(names: Iterable[str]) -> np.ndarray:
        return np.array([signals[name].nominal for name in names])

    x = nominal(model.states)
    u = nominal(model.inputs)
    y = nominal(model.outputs)
    return StateSpace(
        model.A * x / x[:, None],
        model.B * u / x[:, None],
        model.C * x / y[:, None],
        model.D * u / y[:, None],
    )


def _pairs_text(roots: np.ndarray) -> str:
    """The roots, a conjugate pair once; "none" without any."""
    words = []
    for root in roots:
        if root.imag >= 0:
            real = root.real if abs(root.real) > 5e-5 else 0.0
            words.append(eigenvalue_text(complex(real, root.imag)))
    return ", ".join(words) or "none"
