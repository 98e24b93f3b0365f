"""Transfer functions, transmission zeros and frequency responses of a linear model, and their Bode
plot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result, Roots, plain
from hfa_support.reporting.text import Table, eigenvalue_text
from hfa_support.reporting.unit_system import entries_in_force, in_force, unit_in_force
from trim.linear.modes import fastest_first

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trim.linear.linear_model import LinearModel

#: Of the largest entry of the scaled system: what is smaller is rounding where a rank is decided.
_ROUNDING = 1e-12
#: A zero and a pole that are as close, relative to 0.01 + |zero|, cancel; what is slower than
#: `_SLOW`, 1/s, is at 0.
_CANCELS, _SLOW = 1e-7, 1e-9


@dataclass(frozen=True, eq=False)
class Transfer(Result):
    """output / input = gain Π(s - zero) / Π(s - pole), without what cancels.

    output: its name.
    input: its name.
    unit: of the output over that of the input.
    gain: 0 where the input does not reach the output.
    static: the value at s = 0, null where a pole is there.
    zeros: (zeros,), 1/s.
    poles: (poles,), 1/s."""

    output: str
    input: str
    unit: str
    gain: float
    static: float
    zeros: Roots
    poles: Roots


def transfers(model: LinearModel) -> list[Transfer]:
    """The transfer function of each output and input, outputs first."""
    (A, B, C, D), found, signals = scaled(model), [], model.point.model.signals
    for (i, output), (j, name) in product(enumerate(model.outputs), enumerate(model.inputs)):
        b, c = B[:, [j]], C[[i]]
        zeros, rank = transmission_zeros(A, b, c, D[[i]][:, [j]])
        zeros, poles = (
            _without_common(zeros, np.linalg.eigvals(A)) if rank else (np.zeros(0), np.zeros(0))
        )
        gain = static = 0.0
        if rank:
            # The first number of d, c b, c A b, c A² b, ... that is not 0.
            order = len(poles) - len(zeros)
            first = (
                (c @ np.linalg.matrix_power(A, order - 1) @ b).item() if order else float(D[i, j])
            )
            gain = first * signals[output].nominal / signals[name].nominal
            slowest_zero, slowest_pole = (
                np.abs(roots).min(initial=np.inf) for roots in (zeros, poles)
            )
            if slowest_zero > _SLOW:
                static = (
                    float(np.real(gain * np.prod(-zeros) / np.prod(-poles)))
                    if slowest_pole > _SLOW
                    else np.inf
                )
        unit = f"({signals[output].unit})/({signals[name].unit})"
        found.append(Transfer(output, name, unit, gain, static, zeros + 0j, poles + 0j))
    return found


def transmission_zeros(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray
) -> tuple[np.ndarray, int]:
    """The invariant zeros of x' = A x + B u, y = C x + D u, 1/s, and the normal rank of its
    transfer matrix.

    The system is reduced to one of the same zeros whose D is square and invertible (A.
    Emami-Naeini, P. Van Dooren, Automatica 18, 1982); they are the eigenvalues of A - B D⁻¹ C."""
    small = _ROUNDING * float(np.linalg.norm(np.block([[A, B], [C, D]])))
    for _ in range(2):  # the second time the transposed system
        A, B, C, D = _with_full_rows(A, B, C, D, small)
        A, B, C, D = A.T, C.T, B.T, D.T
    zeros = np.linalg.eigvals(A - B @ np.linalg.solve(D, C)) if len(D) else np.linalg.eigvals(A)
    return fastest_first(zeros), len(D)


def _with_full_rows(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, small: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A smaller system of the same zeros whose D has independent rows: what y shows without u is no
    state."""
    while len(D):
        turn, sizes, _ = np.linalg.svd(D) if D.size else (np.eye(len(D)), np.zeros(0), None)
        rank = int((sizes > small).sum())
        C, D = turn.T @ C, turn.T @ D
        direct, D, rest = C[:rank], D[:rank], C[rank:]
        if not rest.size:
            return A, B, direct, D
        _, sizes, basis = np.linalg.svd(rest)
        count = int((sizes > small).sum())
        if not count:
            return A, B, direct, D
        shown, hidden = basis[:count], basis[count:]
        C, D = np.vstack([direct, shown @ A]) @ hidden.T, np.vstack([D, shown @ B])
        A, B = hidden @ A @ hidden.T, hidden @ B
    return A, B, C, D


def bode_figure(model: LinearModel) -> Figure:
    """Magnitude in dB and phase in degrees, a column an output and a line an input."""
    if not model.inputs:
        raise BadInputError("the model has no inputs: there is no Bode plot to draw")
    found = model.frequency_response()
    output_units = model.point.model.units(model.outputs)
    units = (output_units, 1), (model.input_units, -1)
    size = entries_in_force(np.moveaxis(np.abs(found.frdata), 2, 0), *units)
    phase = np.degrees(np.unwrap(np.moveaxis(np.angle(found.frdata), 2, 0), axis=0))
    if not size.any():
        raise BadInputError(
            "no chosen input reaches a chosen output: there is no Bode plot to draw"
        )
    figure = new_figure(max(5.0, 3.4 * len(model.outputs)), 5.6)
    axes = figure.subplots(2, len(model.outputs), sharex=True, squeeze=False)
    for i, (output, unit) in enumerate(zip(model.outputs, output_units, strict=True)):
        above, below = axes[:, i]
        for j, name in enumerate(model.inputs):
            if size[:, i, j].max() > _ROUNDING * size.max():
                above.semilogx(found.omega, 20 * np.log10(size[:, i, j]), color=f"C{j}", label=name)
                below.semilogx(found.omega, phase[:, i, j], color=f"C{j}")
        above.set_title(f"{output}, {unit_in_force(unit)}", fontsize=9)
        below.set_xlabel("rad/s")
        for each in (above, below):
            each.grid(alpha=0.3)
    axes[0, 0].set_ylabel("magnitude, dB")
    axes[1, 0].set_ylabel("phase, deg")
    lines = {line.get_label(): line for each in axes[0] for line in each.lines}
    units_of_inputs = dict(zip(model.inputs, model.input_units, strict=True))
    labels = [f"{name}, {unit_in_force(units_of_inputs[str(name)])}" for name in lines]
    figure.legend([*lines.values()], labels, loc="outside upper center", ncols=5, fontsize=8)
    return figure


def with_transfers(report: Report, model: LinearModel) -> Report:
    """The report of a model with its transmission zeros and a row for each transfer function that
    is not zero."""
    found, zeros = model.transfers(), model.zeros()
    rows = [
        (
            f"{each.output} / {each.input}",
            *(f"{in_force(value, each.unit):.6g}" for value in (each.gain, each.static)),
            *(_pairs_text(roots) for roots in (each.zeros, each.poles)),
        )
        for each in found
        if each.gain
    ]
    said = f"Transmission zeros from {', '.join(model.inputs)} to {', '.join(model.outputs)}, 1/s: {_pairs_text(zeros)}"
    table = Table(("transfer function", "gain", "at s = 0", "zeros 1/s", "poles 1/s"), rows)
    report = replace(report, parts=(*report.parts, said, table))
    return report.with_data(zeros=plain(zeros + 0j), transfers=plain(found))


def scaled(model: LinearModel) -> tuple[np.ndarray, ...]:
    """A, B, C, D in nominal values, in which one rank decision suits all rows."""
    signals = model.point.model.signals
    names = model.states, model.inputs, model.outputs
    x, u, y = (np.array([signals[name].nominal for name in part]) for part in names)
    return (
        model.A * x / x[:, None],
        model.B * u / x[:, None],
        model.C * x / y[:, None],
        model.D * u / y[:, None],
    )


def _without_common(zeros: np.ndarray, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both without the pairs that cancel."""
    kept, left = [], [*fastest_first(poles)]
    for zero in zeros:
        near = min(left, key=lambda pole: abs(pole - zero), default=np.inf)
        if abs(near - zero) <= _CANCELS * (0.01 + abs(zero)):
            left.remove(near)
        else:
            kept.append(zero)
    return np.array(kept, dtype=complex), np.array(left, dtype=complex)


def _pairs_text(roots: np.ndarray) -> str:
    shown = (complex(root.real if abs(root.real) > 5e-5 else 0.0, root.imag) for root in roots)
    return ", ".join(eigenvalue_text(root) for root in shown if root.imag >= 0) or "none"
