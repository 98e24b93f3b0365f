"""Margins of a closed loop for simultaneous changes at all inputs, within disks.

The margins are computed from M = S - I/2, with the sensitivity S = (I + L)⁻¹ of the loop L. The
loop stays stable for all factors in a disk of size α if σ_max(D M D⁻¹) < 1/α at each frequency,
with any diagonal D there. A scalar loop l = (1/2 - M) / (1/2 + M) is real where M is real, and
|l| = 1 where M is imaginary. Gain margins are factors (not dB), phases are in degrees and
frequencies in rad/s. All is computed in doubles, and not proved, for a loop that is proved stable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hfa_support.matrices import balanced
from trim.linear.bilinear import System, in_continuous_time
from trim.linear.frequency_grid import frequency_grid
from trim.linear.frequency_response import level_crossings, responses

#: Relative distance of the level above the largest bound found, the relative error of the margin,
ABOVE = 1e-8
#: which is multiplied by 10 after each such number of frequencies, divided by the square of the
#: number of inputs, as the time of one frequency grows; twenty frequencies are usual. The search
#: ends: after at most 9 times as many, no gain is above the level.
MANY = 120
#: Rounds of balancing for the initial scaling, which the search at each frequency improves.
SWEEPS = 20
#: The search ends where the relative slope of σ_max(D M D⁻¹) over log D is below this: then so is
#: its relative distance from the least one nearby.
SETTLED = 1e-10
#: Frequencies per decade of the grid where the search begins.
PER_DECADE = 20
#: The response at up to this number of frequencies is computed without the Schur form.
FEW = 4
#: Number of states that are solved for with one product of matrices.
BLOCK = 16
#: Interval of frequencies, rad/s.
Piece = tuple[float, float]


class DiskMargin(NamedTuple):
    """Disk margin: stability for simultaneous changes of all inputs by independent complex factors.

    The loop remains stable if each input is multiplied by a factor f = (2 + αε)/(2 - αε), with any
    complex |ε| < 1.

    disk: α, a lower bound of the margin, within .1 % for up to three inputs; for more inputs the
        true margin may be slightly larger
    gain: (2 + α)/(2 - α); real factors f are between 1/gain and gain
    phase: 2 arctan(α/2), deg, the phase of factors f with |f| = 1
    frequency: rad/s, at which the margin is smallest; possibly inf
    """

    disk: float
    gain: float
    phase: float
    frequency: float


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Stable closed loop M(s) = D + C (s I - A)⁻¹ B, (m, m).

    A: (n, n), stable
    B: (n, m)
    C: (m, n)
    D: (m, m), M at infinite frequency
    dt: sampling time, s, of a sampled loop with s = (z - 1) / (z + 1); 0 in continuous time
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float = 0.0

    def only(self, i: int) -> ClosedLoop:
        """Return M of loop i alone, with the other loops closed."""
        one = slice(i, i + 1)
        loop = replace(self, B=self.B[:, one], C=self.C[one], D=self.D[one, one])
        vars(loop)["schur_form"] = self.schur_form  # of the same A
        return loop

    @cached_property
    def schur_form(self) -> tuple[np.ndarray, np.ndarray]:
        """Complex Schur form T and U of A = U T U*, (n, n)."""
        from scipy.linalg import schur

        return schur(self.A, output="complex")

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A, (n,)."""
        return np.diag(self.schur_form[0])

    def at(self, frequencies: np.ndarray) -> np.ndarray:
        """Return M(jω), (N, m, m), at finite frequencies ω, (N,).

        With the Schur form of A, each of many frequencies takes n² operations instead of n³.
        """
        if len(frequencies) <= FEW:
            return self.D + self.C @ responses(self.A, self.B, frequencies)
        T, U = self.schur_form
        n, m = self.B.shape
        s = 1j * frequencies
        driven = U.conj().T @ self.B
        # (s - T) x = driven from the last row up, for all s; blocks of rows are one product.
        x = np.empty((n, m, len(s)), dtype=complex)
        rows_of_x = x.reshape(n, -1)
        for high in range(n, 0, -BLOCK):
            low = max(high - BLOCK, 0)
            of_later_blocks = T[low:high, high:] @ rows_of_x[high:]
            for row in reversed(range(low, high)):
                of_this_block = T[row, row + 1 : high] @ rows_of_x[row + 1 : high]
                of_later_rows = (of_later_blocks[row - low] + of_this_block).reshape(m, len(s))
                x[row] = (driven[row, :, None] + of_later_rows) / (s - T[row, row])
        outputs = (self.C @ U @ rows_of_x).reshape(*self.D.shape, len(s))
        return self.D + np.moveaxis(outputs, -1, 0)

    def rate(self, frequencies: np.ndarray) -> np.ndarray:
        """Return the physical frequencies, rad/s, that belong to frequencies ω of s = jω.

        - continuous time: the same frequencies
        - sampled loop: the angle of z, divided by dt
        """
        return 2.0 * np.arctan(frequencies) / self.dt if self.dt else frequencies


def loop_of(
    closed: np.ndarray, enters: np.ndarray, leaves: np.ndarray, dt: float | bool | None
) -> ClosedLoop:
    """Return M = I/2 + leaves (s I - closed)⁻¹ enters of a stable loop.

    closed: (n, n), state matrix of the closed loop
    enters: (n, m)
    leaves: (m, n)
    dt: None in continuous time; in discrete time the sample time, s, or True if it is not known:
        frequencies are then in rad per step
    """
    A, units = balanced(closed)
    loop = System(A, enters / units[:, None], leaves * units, 0.5 * np.eye(len(leaves)))
    if dt is None:
        return ClosedLoop(*loop)
    return ClosedLoop(*in_continuous_time(loop), dt=float(dt))


def disk_of(loop: ClosedLoop, near: float = 0.0) -> DiskMargin:
    """Return the disk margin of a stable closed loop M.

    Intervals of frequencies are divided until the bound min_D σ_max(D M D⁻¹) is shown to be below
    a common level on all intervals. The margin is the inverse of this level. The interval with the
    largest bound is divided first, so that most intervals are below the level soon.

    loop: M
    near: estimate of the critical frequency, rad/s, which shortens the search; 0 if unknown

    Source: Lawrence, Tits and Van Dooren, Automatica 36 (2000), 449-456.
    """
    ends = np.unique(np.concatenate([[0.0], np.abs(loop.poles), np.abs(loop.poles.imag)]))
    pieces = list(pairwise([*ends.tolist(), math.inf]))
    # The search begins at the largest bound of a grid: at a level next to σ_max(D), rounding hides
    # the crossings.
    grid = np.append(frequency_grid(loop.poles, PER_DECADE), near)
    M_at_grid = loop.at(grid)
    scalings = _osborne_scaling(M_at_grid)
    largest = scaled_norm(M_at_grid, scalings).argmax()
    scaling = scalings[largest]
    point = float(grid[largest])
    frequency = math.inf
    highest = float(scaled_norm(loop.D, best_scaling(loop.D)))
    per_widening = max(MANY // len(loop.D) ** 2, 1)
    count = 0
    while pieces:
        count += 1
        M = loop.at(np.array([point]))[0]
        slack = ABOVE * 10.0 ** (count // per_widening)
        scaling = best_scaling(M, scaling)
        bound = float(scaled_norm(M, scaling))
        if bound > highest * (1.0 + ABOVE):
            frequency = point
        highest = max(highest, bound)
        level = highest * (1.0 + slack)
        pieces = _pieces_above(loop, scaling, level, pieces, point)
        if pieces:
            point = _between(*pieces[-1])
    alpha = 1.0 / level
    return DiskMargin(alpha, *disk_sizes(alpha), float(loop.rate(np.array(frequency))))


def _between(low: float, high: float) -> float:
    """Return a frequency inside an interval of frequencies, rad/s."""
    if math.isinf(high):
        return 4.0 * low or 1.0
    return math.sqrt(low * high) if 0.0 < 4.0 * low < high else 0.5 * (low + high)


def _pieces_above(
    loop: ClosedLoop,
    scaling: np.ndarray,
    level: float,
    pieces: list[Piece],
    cut: float,
) -> list[Piece]:
    """Return those parts of frequency intervals in which σ_max(D M D⁻¹) is above a level.

    Between neighboring crossings of the level, it is everywhere above or everywhere below. The part
    with the largest value comes last. A part that no number divides is left out.

    scaling: log D, (m,)
    cut: frequency at which the intervals are divided too
    """
    D = np.exp(scaling)
    C, through = D[:, None] * loop.C, D[:, None] * loop.D / D
    crossings = np.append(level_crossings(loop.A, loop.B / D, C, through, level), cut)
    crossings.sort()
    parts: list[Piece] = []
    for low, high in pieces:
        inside = crossings[(crossings > low) & (crossings < high)].tolist()
        parts += pairwise([low, *inside, high])
    insides = np.array([_between(*part) for part in parts])
    norms = scaled_norm(loop.at(insides), scaling)
    lows, highs = np.transpose(parts)
    is_kept = (norms > level) & (lows < insides) & (insides < highs)
    ascending = np.argsort(norms, stable=True)
    return [parts[number] for number in ascending[is_kept[ascending]]]


def best_scaling(M: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Return the scaling D > 0, as log D, (m,), that minimizes σ_max(D M D⁻¹).

    D is diagonal. The minimum is an upper bound of μ(M), exact for m <= 3. For m > 2 it is found by
    BFGS: at the minimum the two largest singular values are often equal, where BFGS still descends.

    M: (m, m), complex
    start: initial log D, (m,); by default `_osborne_scaling`

    Sources: Packard and Doyle, Automatica 29 (1993), 71-109; Lewis and Overton, Mathematical
    Programming 141 (2013), 135-163.
    """
    if len(M) == 1:
        return np.zeros(1)
    if len(M) == 2:
        # σ_max grows with the Frobenius norm, as |det M| is the product of both singular values.
        # The norm is least where |M12| D1/D2 = |M21| D2/D1; an entry counts at least as rounding.
        rounding = np.finfo(float).eps * float(np.abs(M).max()) or 1.0
        above, below = (max(abs(M[place]), rounding) for place in ((0, 1), (1, 0)))
        return np.array([0.5 * math.log(below / above), 0.0])
    from scipy.optimize import minimize  # here: loops with one or two inputs do without it

    start = _osborne_scaling(M) if start is None else start
    unit = float(scaled_norm(M, start)) or 1.0

    def relative_norm(others: np.ndarray) -> tuple[float, np.ndarray]:
        size, slope = _norm_and_slope(np.append(others, 0.0), M)  # D_m is fixed
        return size / unit, slope[:-1] / unit

    found = minimize(
        relative_norm, (start - start[-1])[:-1], jac=True, method="BFGS", options={"gtol": SETTLED}
    )
    return np.append(found.x, 0.0)


def _norm_and_slope(log_D: np.ndarray, M: np.ndarray) -> tuple[float, np.ndarray]:
    """Return σ = σ_max(D M D⁻¹) and ∂σ/∂log D_i = σ (|u_i|² - |v_i|²) at log D, (m,)."""
    # u and v are the singular vectors of σ.
    scaled = np.exp(log_D[:, None] - log_D) * M
    squares, vectors = np.linalg.eigh(scaled @ scaled.conj().T)
    squared = max(float(squares[-1]), 0.0)
    size = math.sqrt(squared)
    u = vectors[:, -1]
    of_rows = squared * np.abs(u) ** 2  # σ² |u_i|²
    of_columns = np.abs(u.conj() @ scaled) ** 2  # σ² |v_i|²
    return size, (of_rows - of_columns) / (size or 1.0)


def scaled_norm(M: np.ndarray, log_D: np.ndarray) -> np.ndarray:
    """Return σ_max(D M D⁻¹) of one matrix (m, m), or of each matrix of a stack (..., m, m).

    log_D: (m,) or (..., m)
    """
    scaled = np.exp(log_D[..., :, None] - log_D[..., None, :]) * M
    return np.linalg.norm(scaled, 2, axis=(-2, -1))


def _osborne_scaling(M: np.ndarray) -> np.ndarray:
    """Return log D, (..., m), for which row i and column i of D M D⁻¹ have about equal norms."""
    off = np.abs(M) ** 2 * (1.0 - np.eye(M.shape[-1]))
    log_D = np.zeros(M.shape[:-1])
    for _ in range(SWEEPS):
        scaled = off * np.exp(2.0 * (log_D[..., :, None] - log_D[..., None, :]))
        row = scaled.sum(axis=-1)
        column = scaled.sum(axis=-2)
        ratio = np.divide(column, row, out=np.ones_like(row), where=(row > 0.0) & (column > 0.0))
        log_D += 0.125 * np.log(np.where(ratio > 0.0, ratio, 1.0))
    return log_D


def disk_sizes(alpha: float) -> tuple[float, float]:
    """Return the gain (a factor) and the phase (deg) that belong to the disk margin α.

    The gain is inf for α >= 2.
    """
    gain = (2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf
    return gain, math.degrees(2.0 * math.atan(alpha / 2.0))
