"""Transfer functions, transmission zeros and Bode plot of a linear model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import Table, eigenvalue_text
from trim.linear.modes import spectrum
from trim.linear.transfer import ROUNDING, StateSpace, System, Transfer, gain_and_roots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest number of outputs in a Bode plot; more would be illegible.
_MOST_PANELS = 6
#: Eigenvalues below this fraction of the largest count as zero, and are not modes to draw.
_STILL = 1e-6


def transfers(system: System) -> list[Transfer]:
    """Return the transfer functions of a system from each input to each output.

    All inputs of the first output come first, then those of the second output, and so on.
    """
    A, B, C, D = system.scaled()
    poles = spectrum(A)
    functions = []
    for i, (output, to) in enumerate(system.outputs.items()):
        for j, (name, given) in enumerate(system.inputs.items()):
            channel = StateSpace(A, B[:, [j]], C[[i]], D[[i]][:, [j]])
            unit = f"({to.unit})/({given.unit})"
            size = to.nominal / given.nominal
            functions.append(Transfer(output, name, unit, *gain_and_roots(channel, poles, size)))
    return functions


def bode_figure(system: System) -> Figure:
    """Return a new figure with the Bode plots of a system (`draw_bode`)."""
    return draw_bode(system, new_figure(6.0, 5.2))


def draw_bode(system: System, figure: Figure) -> Figure:
    """Draw the Bode plots of a system, and return the figure.

    Each output has a panel for the magnitude (dB) and one for the phase (deg), with a line for each
    input. At most `_MOST_PANELS` outputs that an input affects are drawn. The names of all other
    outputs are printed below. The frequencies are `bode_frequencies`.

    figure: an empty figure, which is resized

    Raises BadInputError if the system has no inputs, or no input affects an output.
    """
    from matplotlib.ticker import MaxNLocator

    if not system.inputs:
        raise BadInputError(
            "the model has no inputs, so no Bode plot exists; choose at least one input"
        )
    frequencies = bode_frequencies(system.matrices.A)
    response = system.to_control().frequency_response(frequencies)
    values = np.moveaxis(response.frdata, 2, 0)
    size = np.abs(values)
    if not size.any():
        raise BadInputError(
            "no chosen input affects any chosen output; choose other inputs or outputs"
        )
    phase = np.degrees(np.unwrap(np.angle(values), axis=0))
    reaches = size.max(axis=0) > ROUNDING * size.max()  # (outputs, inputs)
    reached = np.flatnonzero(reaches.any(axis=1)).tolist()
    drawn = reached[:_MOST_PANELS]
    columns = min(len(drawn), 3)
    lines = -(-len(drawn) // columns)
    figure.set_size_inches(max(6.0, 3.6 * columns), 4.6 * lines + 0.6)
    axes = figure.subplots(
        2 * lines, columns, sharex=True, squeeze=False, height_ratios=[3, 2] * lines
    )
    labels = [
        name if signal.unit == "1" else f"{name}, {signal.unit}"
        for name, signal in system.inputs.items()
    ]
    outputs = list(system.outputs)
    handles = {}
    for panel, i in enumerate(drawn):
        line, column = divmod(panel, columns)
        above = axes[2 * line, column]
        below = axes[2 * line + 1, column]
        for j in np.flatnonzero(reaches[i]).tolist():
            decibels = 20 * np.log10(size[:, i, j])
            (handles[labels[j]],) = above.semilogx(response.omega, decibels, color=f"C{j}")
            below.semilogx(response.omega, phase[:, i, j], color=f"C{j}")
        above.set_title(f"{outputs[i]}, {system.outputs[outputs[i]].unit}", fontsize=9)
        above.grid(alpha=0.3)
        below.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 1.8, 3.6, 9, 10]))
        below.tick_params(labelbottom=True)
        below.set_xlabel(f"frequency, rad/{system.time_unit}")
        below.grid(alpha=0.3)
        if column == 0:
            above.set_ylabel("magnitude, dB")
            below.set_ylabel("phase, deg")
    for panel in range(len(drawn), lines * columns):
        line, column = divmod(panel, columns)
        axes[2 * line, column].set_axis_off()
        axes[2 * line + 1, column].set_axis_off()
    figure.legend([*handles.values()], [*handles], loc="outside upper center", ncols=5, fontsize=8)
    others = [output for i, output in enumerate(outputs) if i not in drawn]
    if others:
        figure.supxlabel(f"not drawn: {', '.join(others)}", fontsize=8)
    return figure


def bode_frequencies(A: np.ndarray) -> np.ndarray:
    """Return frequencies for the Bode plot of a system, rad per unit of time.

    The frequencies extend from a tenth of the smallest to ten times the largest magnitude of the
    nonzero eigenvalues of A, or from 0.01 to 100 if all eigenvalues are 0. The frequencies are
    dense near the magnitude of each eigenvalue, where the phase of lightly damped modes changes
    fast.

    A: (n, n)
    """
    frequencies = np.abs(np.linalg.eigvals(A))
    moving = frequencies[frequencies > _STILL * frequencies.max(initial=0.0)]
    if not moving.size:
        return np.geomspace(0.01, 100.0, 401)
    even = np.geomspace(moving.min() / 10, moving.max() * 10, 401)
    offsets = np.geomspace(1e-4, 0.2, 40)
    around = np.concatenate([1.0 - offsets, [1.0], 1.0 + offsets])
    return np.unique(np.concatenate([even, np.outer(moving, around).ravel()]))


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


def zeros_in_words(system: System, zeros: np.ndarray) -> str:
    """Return a sentence on the transmission zeros of a system."""
    return (
        f"Transmission zeros from {', '.join(system.inputs)} to {', '.join(system.outputs)}, "
        f"1/{system.time_unit}: {_pairs_text(zeros)}"
    )


def _pairs_text(roots: np.ndarray) -> str:
    """Return poles or zeros as text, or "none". A conjugate pair is printed once."""
    words = []
    for root in roots:
        if root.imag >= 0:
            real = root.real if abs(root.real) > 5e-5 else 0.0
            words.append(eigenvalue_text(complex(real, root.imag)))
    return ", ".join(words) or "none"
