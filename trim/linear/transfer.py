"""Transfer functions and transmission zeros of linear models, in balanced units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hfa_support.matrices import balanced, power_of_two
from hfa_support.reporting.results import Result, Roots
from trim.linear.modes import (
    errors_of_roots,
    fastest_first,
    order_fastest_first,
    spectrum,
    without_roundings,
)

#: Number of times that inputs, outputs and states are balanced in turn; the third changes nothing.
_TURNS = 3


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


class GainAndRoots(NamedTuple):
    """Gain, static gain, zeros and poles of a `Transfer`."""

    gain: float
    static: float
    zeros: np.ndarray
    poles: np.ndarray


class StateSpace(NamedTuple):
    """System x' = A x + B u, y = C x + D u, with A (n, n), B (n, m), C (k, n), D (k, m)."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    def transposed(self) -> StateSpace:
        """Return the dual system, whose transfer matrix is transposed."""
        return StateSpace(self.A.T, self.C.T, self.B.T, self.D.T)

    def channel(self, output: int, given: int) -> StateSpace:
        """Return the system from one input to one output, with the states between the two."""
        links = self.A != 0
        after = _reached(links, self.B[:, given] != 0)
        before = _reached(links.T, self.C[output] != 0)
        kept = np.flatnonzero(after & before)
        A = self.A[np.ix_(kept, kept)]
        return StateSpace(
            A, self.B[kept][:, [given]], self.C[[output]][:, kept], self.D[[output]][:, [given]]
        )

    def pencil(self, s: complex) -> np.ndarray:
        """Return [[A - sI, B], [C, D]], which is singular at the zeros s."""
        return np.block([[self.A - s * np.eye(len(self.A)), self.B], [self.C, self.D]])


class _Roots(NamedTuple):
    """Zeros or poles (k,), with bounds (k,) of their errors."""

    values: np.ndarray
    errors: np.ndarray


def transmission_zeros(system: StateSpace) -> np.ndarray:
    """Return the transmission zeros from all inputs to all outputs, 1/s, fastest first."""
    levelled, _ = _levelled(system)
    zeros, _ = _zeros(levelled)
    return fastest_first(zeros.values)


def _reached(links: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return which states are reached from those of `begin`, (n,).

    links: (n, n), whether a state (row) depends on another (column)
    """
    reached = begin
    while (further := reached | links[:, reached].any(axis=1)).sum() > reached.sum():
        reached = further
    return reached


def _levelled(system: StateSpace) -> tuple[StateSpace, float]:
    """Return a system with states, inputs and outputs in units of powers of two, and the gain of
    the system per gain of the result, for one input and one output.

    Numbers of similar size then stand in A, and B and C are as large as A, whatever the units of
    the given system are.
    """
    # A' = T⁻¹ A T, B' = T⁻¹ B, C' = C T, D' = D follow from the balanced form of a loop in which
    # each input is the sum of all outputs.
    A, B, C, D = system
    n, m, k = len(A), B.shape[1], len(C)
    gain = 1.0
    for _ in range(_TURNS):
        size = np.linalg.norm(A) or 1.0
        of_inputs = power_of_two(np.linalg.norm(B, axis=0) / size)
        of_outputs = power_of_two(np.linalg.norm(C, axis=1) / size)
        loop = np.zeros((n + m + k, n + m + k))
        loop[:n, :n] = A
        loop[:n, n : n + m] = B / of_inputs
        loop[n : n + m, n + m :] = size
        loop[n + m :, :n] = C / of_outputs[:, None]
        loop[n + m :, n : n + m] = D / of_inputs / of_outputs[:, None]
        loop, units = balanced(loop)
        A, B = loop[:n, :n], loop[:n, n : n + m]
        C, D = loop[n + m :, :n], loop[n + m :, n : n + m]
        gain *= float(np.prod(of_inputs / units[n : n + m]) * np.prod(of_outputs * units[n + m :]))
    return StateSpace(A, B, C, D), gain


def gain_and_roots(channel: StateSpace) -> GainAndRoots:
    """Return the transfer function of a system with one input and one output.

    Common zeros and poles are canceled. The static gain is 0 for a zero at 0 and inf for a pole at
    0. If the input does not affect the output, both gains are 0, and there are no zeros and poles.
    """
    system, size = _levelled(channel)
    of_zeros, rank = _zeros(system)
    if rank == 0:
        nothing = np.zeros(0, dtype=complex)
        return GainAndRoots(0.0, 0.0, nothing, nothing)
    zeros, poles = _without_common(of_zeros, _Roots(*spectrum(channel.A)[:2]))
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
    return GainAndRoots(gain, static, zeros, poles)


def _zeros(system: StateSpace) -> tuple[_Roots, int]:
    """Return the invariant zeros with bounds of their errors, and the normal rank, the rank of the
    transfer matrix at almost all s.
    """
    # The system is reduced to a system with the same zeros and a square, invertible D (A.
    # Emami-Naeini, P. Van Dooren, Automatica 18, 1982). The zeros are the eigenvalues of A - B D⁻¹
    # C. python-control refuses systems that are not square unless Slycot is installed. With Slycot
    # it finds zeros in chains of lags that have none, also in balanced units.
    n, m, k = len(system.A), system.B.shape[1], len(system.C)
    size = float(np.linalg.norm(system.pencil(0.0)))
    small = (n + max(m, k)) * np.finfo(float).eps * size  # as in numpy.linalg.matrix_rank
    rows_reduced = _with_full_rows(system, small)
    reduced = _with_full_rows(rows_reduced.transposed(), small).transposed()
    rank = len(reduced.D)
    A_of_zeros = reduced.A
    if rank:
        A_of_zeros = reduced.A - reduced.B @ np.linalg.solve(reduced.D, reduced.C)
    values = np.linalg.eigvals(A_of_zeros)
    if rank < min(m, k):
        return _Roots(values, np.zeros(len(values))), rank  # the pencil is singular at every s
    left, right = np.zeros((2, n, len(values)), dtype=complex)
    for i, zero in enumerate(values):
        columns, _, rows = np.linalg.svd(system.pencil(zero), full_matrices=False)
        left[:, i], right[:, i] = columns[:n, -1], rows[-1, :n].conj()
    errors = errors_of_roots(system.pencil(0.0), values, left, right)
    return _Roots(without_roundings(values, errors), errors), rank


def _with_full_rows(system: StateSpace, small: float) -> StateSpace:
    """Return a system with the same zeros, whose D has linearly independent rows.

    small: singular values up to this number are 0
    """
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


def _without_common(zeros: _Roots, poles: _Roots) -> tuple[np.ndarray, np.ndarray]:
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
