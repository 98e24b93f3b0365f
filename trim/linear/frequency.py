"""Transfer functions of a linear model, and its Bode plot by python-control."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.text import Table, eigenvalue_text
from trim.linear.modes import spectrum
from trim.linear.transfer import StateSpace, Transfer, gain_and_roots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trim.linear.linear_model import LinearModel


def draw_bode(linear: LinearModel, figure: Figure) -> Figure:
    """Draw the Bode plots of a linear model, and return the figure.

    python-control draws a panel for the magnitude (dB) and one for the phase (deg) of each output
    that an input affects, with a line for each input, at `bode_frequencies`. The names of all
    other outputs are printed below.

    figure: an empty figure, which is resized

    Raises BadInputError if the model has no inputs, or no input affects an output.
    """
    import control

    if not linear.inputs:
        raise BadInputError(
            "the model has no inputs, so no Bode plot exists; choose at least one input"
        )
    gains = np.array([each.gain for each in transfers(linear)])
    reaches = gains.reshape(len(linear.outputs), len(linear.inputs)) != 0.0
    drawn = np.flatnonzero(reaches.any(axis=1)).tolist()
    if not drawn:
        raise BadInputError(
            "no chosen input affects any chosen output; choose other inputs or outputs"
        )
    frequencies = bode_frequencies(linear.A)
    values = linear.to_control(balance=True).frequency_response(frequencies).frdata
    labels = [
        name if unit == "1" else f"{name}, {unit}"
        for name, unit in zip(linear.inputs, linear.input_units, strict=True)
    ]
    response = control.frd(
        np.where(reaches[..., None], values, np.nan)[drawn], frequencies, inputs=labels
    )
    figure.set_size_inches(8.0, 3.0 * len(drawn) + 1.0)
    axes = figure.subplots(2 * len(drawn), 1, sharex=True, squeeze=False)
    control.bode_plot(response, ax=axes, overlay_inputs=True, dB=True, deg=True, show_legend=False)
    for text in [*figure.texts]:
        text.remove()  # titles name the outputs instead
    for panel, i in zip(axes[::2, 0], drawn, strict=True):
        panel.set_title(f"{linear.outputs[i]}, {linear.output_units[i]}", fontsize=9)
    axes[-1, 0].set_xlabel(f"frequency, rad/{linear.model.time_unit}")
    lines = axes[0, 0].get_lines()[: len(labels)]
    figure.legend(lines, labels, loc="outside upper center", ncols=5, fontsize=8)
    others = [output for i, output in enumerate(linear.outputs) if i not in drawn]
    if others:
        figure.supxlabel(f"not drawn: {', '.join(others)}", fontsize=8)
    return figure


def bode_frequencies(A: np.ndarray) -> np.ndarray:
    """Return frequencies for the Bode plot of a linear model, rad per unit of time.

    The frequencies extend from a tenth of the smallest to ten times the largest magnitude of the
    nonzero eigenvalues of A, or from 0.01 to 100 if all eigenvalues are 0. The frequencies are
    dense near the magnitude of each eigenvalue, where the phase of lightly damped modes changes
    fast.

    A: (n, n)
    """
    magnitudes = np.abs(spectrum(A).values)
    moving = magnitudes[magnitudes > 0.0]
    if not moving.size:
        return np.geomspace(0.01, 100.0, 401)
    even = np.geomspace(moving.min() / 10, moving.max() * 10, 401)
    offsets = np.geomspace(1e-4, 0.2, 40)  # down to the width of a peak with damping 1e-4
    around = np.concatenate([1.0 - offsets, [1.0], 1.0 + offsets])
    return np.unique(np.concatenate([even, np.outer(moving, around).ravel()]))


def transfers(linear: LinearModel) -> list[Transfer]:
    """Return the transfer functions of a linear model from each input to each output.

    All inputs of the first output come first, then those of the second output, and so on.
    """
    system = StateSpace(*linear)
    functions = []
    for i, output in enumerate(linear.outputs):
        for j, name in enumerate(linear.inputs):
            unit = f"({linear.output_units[i]})/({linear.input_units[j]})"
            functions.append(Transfer(output, name, unit, *gain_and_roots(system.channel(i, j))))
    return functions


def transfers_table(functions: Iterable[Transfer], time: str) -> Table:
    """Return a table of transfer functions without those that are 0.

    time: unit of time
    """
    rows = [
        (
            f"{transfer.output} / {transfer.input}",
            f"{transfer.gain:.6g}",
            f"{transfer.static:.6g}",
            _pairs_text(transfer.zeros),
            _pairs_text(transfer.poles),
        )
        for transfer in functions
        if transfer.gain
    ]
    header = ("transfer function", "gain", "at s = 0", f"zeros 1/{time}", f"poles 1/{time}")
    return Table(header, rows)


def zeros_in_words(linear: LinearModel, zeros: np.ndarray) -> str:
    """Return a sentence on the transmission zeros of a linear model."""
    return (
        f"Transmission zeros from {', '.join(linear.inputs)} to {', '.join(linear.outputs)}, "
        f"1/{linear.model.time_unit}: {_pairs_text(zeros)}"
    )


def _pairs_text(roots: np.ndarray) -> str:
    """Return poles or zeros as text, or "none". A conjugate pair is printed once."""
    words = [eigenvalue_text(root) for root in roots.tolist() if root.imag >= 0]
    return ", ".join(words) or "none"
