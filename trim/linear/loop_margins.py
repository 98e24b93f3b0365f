"""Stability margins of one loop with all other loops closed.

The margins are computed from M = S - I/2 (`margins`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trim.linear.frequency_grid import frequency_grid
from trim.linear.margins import ClosedLoop, disk_of, disk_sizes

#: Where |M - 1/2| is below this fraction of its largest value, half of its digits may be lost: the
#: loop gain is 0 there, up to rounding.
ROUNDING = math.sqrt(np.finfo(float).eps)
#: Where |M + 1/2| is below this, three of its digits may be left: the loop gain is infinite there.
INFINITE = 1e3 * np.finfo(float).eps
#: Largest number of alternating secant and bisection steps for a crossover.
_ROUNDS = 17
#: A crossover has converged if two secants agree to this relative accuracy.
_SETTLED = 1e-15
#: Frequencies per decade of a grid, in addition to those at which Re M or Im M is 0.
_PER_DECADE = 20
#: Number of refinements around the largest value of a grid, and points of each.
_REFINEMENTS = 5
_POINTS = 17

#: Function ω (N,) -> M of one loop, (N,).
Locus = Callable[[np.ndarray], np.ndarray]


class LoopMargin(NamedTuple):
    """Margins of one loop, with the other loops closed.

    gain_low, gain_high: the loop remains stable if its gain is multiplied by a factor between these
        limits
    phase: largest tolerated phase shift, deg; inf if every phase shift is tolerated
    crossover: frequency at which this phase shift makes the loop unstable, rad/s; the loop gain is
        1 there, |l| = 1; nan if |l| is never 1
    delay: largest tolerated delay of the signal, s; inf if every delay is tolerated
    disk: α of `DiskMargin`, for simultaneous changes of gain and phase
    """

    gain_low: float
    gain_high: float
    phase: float
    crossover: float
    delay: float
    disk: float

    @property
    def gain(self) -> float:
        """Gain margin, dB: the smaller of the gain increase and decrease that make the loop
        unstable.
        """
        with np.errstate(divide="ignore"):
            return float(20.0 * np.abs(np.log10([self.gain_low, self.gain_high])).min())


def named_margins(
    inputs: Sequence[str], loops: Sequence[LoopMargin]
) -> dict[str, dict[str, float]]:
    """Return the stability margins by name, input -> name of the margin -> value.

    The names are the fields of `LoopMargin`, `disk_gain` (a factor) and `disk_phase` (deg).

    inputs: names of the inputs
    loops: margins at each input, in the same order
    """
    found = {}
    for name, loop in zip(inputs, loops, strict=True):
        gain, phase = disk_sizes(loop.disk)
        found[name] = {**loop._asdict(), "disk_gain": gain, "disk_phase": phase}
    return found


def single_margin(loop: ClosedLoop, i: int) -> LoopMargin:
    """Return the stability margins of loop i, with all other loops closed.

    The gain margins follow from the frequencies at which M is real, the phase and delay margins
    from those at which it is imaginary. They are searched for wherever Im M or Re M changes its
    sign on a grid that resolves every resonance and every zero of Re M and Im M.

    loop: the closed loop, M at all inputs

    Source: Blight, Dailey and Gangsaas, Int. J. Control 59 (1994).
    """
    only = loop.only(i)
    zeros = np.unique(np.concatenate([_zeros(only, sign) for sign in (-1.0, 1.0)]))
    between = (zeros[1:] + zeros[:-1]) / 2.0
    resonances = frequency_grid(loop.poles, _PER_DECADE)
    grid = np.unique(np.concatenate([zeros, between, resonances]))

    below = replace(only, D=only.D - 0.5)  # M - 1/2, which is small without rounding

    def locus(frequencies: np.ndarray) -> np.ndarray:
        return below.at(frequencies)[:, 0, 0]

    seen = locus(grid)
    real = _crossings(np.imag, locus, grid, seen)
    imaginary = _crossings(lambda values: np.real(values) + 0.5, locus, grid, seen)
    at_zero, at_infinity = seen[grid == 0.0].real, below.D.ravel()
    real_values = np.concatenate([at_zero, real.values.real, at_infinity])
    real_values = real_values[~_is_lost(real_values, seen)]
    frequencies = only.rate(imaginary.frequencies)
    # With M = S - I/2, a factor f on the loop reaches -1 where f = (M + 1/2) / (M - 1/2).
    gains = (real_values + 1.0) / real_values
    gains = gains[gains > 0.0]
    angles = np.angle(imaginary.values / (imaginary.values + 1.0))
    phases = np.degrees(np.abs(angles))
    return LoopMargin(
        gain_low=float(gains[gains < 1.0].max(initial=0.0)),
        gain_high=float(gains[gains > 1.0].min(initial=math.inf)),
        phase=float(phases.min(initial=math.inf)),
        crossover=float(frequencies[phases.argmin()]) if phases.size else math.nan,
        delay=float((np.mod(angles, 2.0 * np.pi) / frequencies).min(initial=math.inf)),
        disk=disk_of(only, _peak_of(lambda at: locus(at) + 0.5, grid)).disk,
    )


def _peak_of(locus: Locus, grid: np.ndarray) -> float:
    """Return the frequency at which |M| of one loop is largest, rad/s."""
    for _ in range(_REFINEMENTS):
        peak = int(np.abs(locus(grid)).argmax())
        frequency = float(grid[peak])
        grid = np.linspace(grid[max(peak - 1, 0)], grid[min(peak + 1, len(grid) - 1)], _POINTS)
    return frequency


def _zeros(loop: ClosedLoop, sign: float) -> np.ndarray:
    """Return all frequencies at which Re M of one loop may be 0, or Im M, rad/s.

    They are |Im λ| of the zeros λ of M(s) + M(-s), or of M(s) - M(-s), the eigenvalues of a pencil.

    sign: 1 for Re M, -1 for Im M
    """
    from scipy.linalg import eig

    n = len(loop.A)
    unit = float(np.linalg.norm(loop.A)) or 1.0  # of frequencies
    size_of_B = float(np.linalg.norm(loop.B)) or 1.0
    B, C = loop.B / size_of_B, loop.C * (size_of_B / unit)
    zero = np.zeros((n, n))
    A = loop.A / unit
    system = np.block([[A, zero, B], [zero, -A, -sign * B], [C, C, loop.D * (1.0 + sign)]])
    mass = np.diag(np.repeat([1.0, 0.0], [2 * n, 1]))
    zeros = eig(system, mass, right=False)
    return unit * np.abs(zeros[np.isfinite(zeros)].imag)


def _is_lost(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return whether the loop gain is 0 or infinite up to rounding at values of M - 1/2.

    seen: M - 1/2 at the grid
    """
    sizes = np.abs(values)
    is_zero = sizes <= ROUNDING * np.abs(seen).max()
    return np.asarray(is_zero | (np.abs(values + 1.0) < INFINITE))


class _Crossings(NamedTuple):
    """Frequencies at which Re M or Im M changes its sign, rad/s, (J,), and M - 1/2 there."""

    frequencies: np.ndarray
    values: np.ndarray


def _crossings(
    part: Callable[[np.ndarray], np.ndarray], locus: Locus, grid: np.ndarray, seen: np.ndarray
) -> _Crossings:
    """Return the frequencies between points of a grid at which Re M or Im M changes its sign.

    By secants and bisections in turn.

    part: function M - 1/2 -> Re M or Im M
    locus: M - 1/2
    seen: M - 1/2 at the grid, (N,)
    """
    # If l is 0 or infinite up to rounding, rounding changes the sign of Im M.
    is_lost = _is_lost(seen, seen)
    is_positive = part(seen) > 0.0
    changes = is_positive[1:] != is_positive[:-1]
    (where,) = np.nonzero(changes & ~(is_lost[1:] & is_lost[:-1]))
    low, high = grid[where], grid[where + 1]
    M_low, M_high = seen[where], seen[where + 1]
    last_secant = low
    for number in range(_ROUNDS):
        is_secant = number % 2 == 0
        share = part(M_low) / (part(M_low) - part(M_high)) if is_secant else 0.5
        point = low + share * (high - low)
        M = locus(point)
        is_low = (part(M) > 0.0) == is_positive[where]
        low, M_low = np.where(is_low, point, low), np.where(is_low, M, M_low)
        high, M_high = np.where(is_low, high, point), np.where(is_low, M_high, M)
        if is_secant:
            if np.all(np.abs(point - last_secant) <= _SETTLED * point):
                break
            last_secant = point
    return _Crossings(point, M)
