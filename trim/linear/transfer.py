"""Transfer functions and transmission zeros of a system A, B, C, D."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hfa_aircraft.signals import Signal
from hfa_support.reporting.results import Result, Roots
from trim.linear.modes import Spectrum, fastest_first, order_fastest_first, spectrum

if TYPE_CHECKING:
    import control

#: Fraction of the system's norm below which singular values count as 0 in a rank.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Transfer(Result):
    """Transfer function gain Π(s - zero) / Π(s - pole), after pole-zero cancellation.

    output: name of the output.
    input: name of the input.
    unit: unit of the output per unit of the input.
    gain: leading coefficient; 0 if the input does not affect the output.
    static: value at s = 0; null if there is a pole.
    zeros: (zeros,), 1/s.
    poles: (poles,), 1/s.
    """

    output: str
    input: str
    unit: str
    gain: float
    static: float
    zeros: Roots
    poles: Roots


class StateSpace(NamedTuple):
    """System x' = A x + B u, y = C x + D u, with A (n, n), B (n, m), C (k, n), D (k, m)."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    def transposed(self) -> StateSpace:
        """Return the dual system, whose transfer matrix is transposed."""
        return StateSpace(self.A.T, self.C.T, self.B.T, self.D.T)


@dataclass(frozen=True, eq=False)
class System:
    """System x' = A x + B u, y = C x + D u with named signals.

    matrices: A, B, C and D
    states, inputs, outputs: name -> signal, in the order of the vectors
    time_unit: unit of time
    """

    matrices: StateSpace
    states: Mapping[str, Signal]
    inputs: Mapping[str, Signal]
    outputs: Mapping[str, Signal]
    time_unit: str

    def scaled(self) -> StateSpace:
        """Return the matrices with each signal in units of its nominal value.

        The rows of the matrices then have similar size.
        """
        A, B, C, D = self.matrices
        x, u, y = (
            np.array([signal.nominal for signal in signals.values()])
            for signals in (self.states, self.inputs, self.outputs)
        )
        return StateSpace(
            A * x / x[:, None], B * u / x[:, None], C * x / y[:, None], D * u / y[:, None]
        )

    def zeros(self) -> np.ndarray:
        """Return the transmission zeros from all inputs to all outputs, 1/s, fastest first."""
        zeros, _ = _zeros_with_errors(self.scaled())
        return fastest_first(zeros.values)

    def to_control(self) -> control.StateSpace:
        """Return the system as a python-control `StateSpace`, with the names of its signals."""
        import control

        return control.ss(
            *self.matrices,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(self.outputs),
        )


def gain_and_roots(
    system: StateSpace, modes: Spectrum, size: float
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Return gain, static gain, zeros and poles of a system with one input and one output.

    Common zeros and poles are canceled. The static gain is 0 for a zero at 0 and inf for a pole at
    0. If the input does not affect the output, both gains are 0, and there are no zeros and poles.

    modes: spectrum of A
    size: factor on both gains, from the units of the system to those of the result
    """
    of_zeros, rank = _zeros_with_errors(system)
    if rank == 0:
        nothing = np.zeros(0, dtype=complex)
        return 0.0, 0.0, nothing, nothing
    zeros, poles = _without_common(of_zeros, modes)
    # The gain is the first nonzero number in D, C B, C A B, C A² B, ...
    order = len(poles) - len(zeros)
    first = system.D
    if order > 0:
        first = system.C @ np.linalg.matrix_power(system.A, order - 1) @ system.B
    gain = first.item() * size
    if np.any(zeros == 0.0):
        static = 0.0
    elif np.any(poles == 0.0):
        static = math.inf
    else:
        static = float(np.real(gain * np.prod(-zeros) / np.prod(-poles)))
    return gain, static, zeros, poles


def _zeros_with_errors(system: StateSpace) -> tuple[Spectrum, int]:
    """Return the invariant zeros with bounds of their errors, and the normal rank, the rank of the
    transfer matrix at almost all s.
    """
    # The system is reduced to a system with the same zeros and a square, invertible D (A.
    # Emami-Naeini, P. Van Dooren, Automatica 18, 1982). The zeros are the eigenvalues of A - B D⁻¹
    # C.
    size = float(np.linalg.norm(np.block([[system.A, system.B], [system.C, system.D]])))
    small = ROUNDING * size
    rows_reduced = _with_full_rows(system, small)
    reduced = _with_full_rows(rows_reduced.transposed(), small).transposed()
    rank = len(reduced.D)
    A_of_zeros = reduced.A
    if rank:
        A_of_zeros = reduced.A - reduced.B @ np.linalg.solve(reduced.D, reduced.C)
    return spectrum(A_of_zeros, size), rank


def _with_full_rows(system: StateSpace, small: float) -> StateSpace:
    """Return a system with the same zeros, whose D has linearly independent rows."""
    # Combinations of states that the outputs measure directly are removed.
    A, B, C, D = system
    while len(D):
        turned, sizes, _ = np.linalg.svd(D) if D.size else (np.eye(len(D)), np.zeros(0), None)
        rank = int((sizes > small).sum())
        C = turned.T @ C
        D = turned.T @ D
        direct = C[:rank]
        without_input = C[rank:]
        D = D[:rank]
        if not without_input.size:
            return StateSpace(A, B, direct, D)
        _, sizes, basis = np.linalg.svd(without_input)
        count = int((sizes > small).sum())
        if not count:
            return StateSpace(A, B, direct, D)
        shown = basis[:count]
        hidden = basis[count:]
        C = np.vstack([direct, shown @ A]) @ hidden.T
        D = np.vstack([D, shown @ B])
        A = hidden @ A @ hidden.T
        B = hidden @ B
    return StateSpace(A, B, C, D)


def _without_common(zeros: Spectrum, poles: Spectrum) -> tuple[np.ndarray, np.ndarray]:
    """Return the zeros and poles that remain after cancellation, each fastest first."""
    # A zero and a pole cancel if they agree within their error bounds.
    kept_zeros = []
    kept_poles = order_fastest_first(poles.values).tolist()
    for zero in order_fastest_first(zeros.values):
        distances = np.abs(poles.values[kept_poles] - zeros.values[zero])
        excess = distances - poles.errors[kept_poles] - zeros.errors[zero]
        if excess.min(initial=np.inf) <= 0.0:
            del kept_poles[int(np.argmin(distances))]
        else:
            kept_zeros.append(zero)
    return zeros.values[kept_zeros], poles.values[kept_poles]
