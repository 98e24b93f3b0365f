"""Frequency responses of a linear model at its modes, and their Bode plots."""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.text import Table
from trim.linear.modes import spectrum

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
    affected = affected_outputs(linear)
    drawn = np.flatnonzero(affected.any(axis=1)).tolist()
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
        np.where(affected[..., None], values, np.nan)[drawn], frequencies, inputs=labels
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
    nonzero = magnitudes[magnitudes > 0.0]
    if not nonzero.size:
        return np.geomspace(0.01, 100.0, 401)
    even = np.geomspace(nonzero.min() / 10, nonzero.max() * 10, 401)
    offsets = np.geomspace(1e-4, 0.2, 40)  # down to the width of a peak with damping 1e-4
    around = np.concatenate([1.0 - offsets, [1.0], 1.0 + offsets])
    return np.unique(np.concatenate([even, np.outer(nonzero, around).ravel()]))


def affected_outputs(linear: LinearModel) -> np.ndarray:
    """Return whether each input affects each output, (outputs, inputs), by the nonzero entries of
    the matrices: directly, or through a chain of states.
    """
    A, B, C, D = (matrix != 0.0 for matrix in linear)
    n = len(A)
    chains = np.linalg.matrix_power(A | np.eye(n, dtype=bool), n)  # of at most n states
    return np.asarray(D | (C @ chains @ B))


class ModeResponses(NamedTuple):
    """Frequency responses of a linear model.

    frequencies: ω, (N,), rad per unit of time
    by_channel: "output / input" -> C (jω - A)⁻¹ B + D of this channel, (N,) complex, without the
        channels in which the input does not affect the output
    """

    frequencies: np.ndarray
    by_channel: dict[str, np.ndarray]


def responses_at_modes(linear: LinearModel) -> ModeResponses:
    """Return the frequency responses at the natural frequencies of the damped and the unstable
    modes, slowest first. At an undamped mode, they are infinite.
    """
    frequencies = np.unique([mode.frequency for mode in linear.modes if mode.damping])
    values = linear.to_control(balance=True).frequency_response(frequencies).frdata
    by_channel = {
        f"{linear.outputs[i]} / {linear.inputs[j]}": values[i, j]
        for i, j in np.argwhere(affected_outputs(linear)).tolist()
    }
    return ModeResponses(frequencies, by_channel)


def responses_table(responses: ModeResponses, time: str) -> Table:
    """Return a table of the magnitude (dB) and the phase (deg) of each frequency response.

    time: unit of time
    """
    header = ("response", *(f"{frequency:.4g} rad/{time}" for frequency in responses.frequencies))
    rows = [
        (channel, *map(_response_text, values.tolist()))
        for channel, values in responses.by_channel.items()
    ]
    return Table(header, rows)


def _response_text(value: complex) -> str:
    """Return a response as text: "-12.3 dB, 45 deg"."""
    if not value:
        return "0"
    return f"{20.0 * math.log10(abs(value)):.1f} dB, {math.degrees(cmath.phase(value)):.0f} deg"
