"""L2 gain of a closed loop by a frequency sweep, independent of `frequency_response`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.frequency_response import gains_at

GRID_PER_DECADE = 60
#: Points near a resonance: their spacing grows with the distance from the pole, up to a hundred of
#: its widths.
RESONANCE = np.linspace(-5.3, 5.3, 45)
#: Step of the first of these grids relative to the frequency, and of the second relative to the
#: distance from the pole.
LOGARITHMIC_STEP = 10.0 ** (1.0 / GRID_PER_DECADE) - 1.0
RESONANCE_STEP = float(RESONANCE[1] - RESONANCE[0])
#: Frequencies with a smaller relative difference count as equal.
_SAME = 1e-9
#: Number of finer grids, and points of each, over two steps of the grid before: ten times finer.
#: The error of a peak gain decreases with the square of the step.
REFINEMENTS = 6
POINTS = 20
#: A peak of the first grid is refined if its gain is below the largest by at most this fraction,
#: and further if the difference is at most a tenth of it after each refinement,
RIVAL = 0.2
#: and if it is among the largest of the first grid.
MOST_PEAKS = 8
#: Function of frequencies, (N,), and the fraction of `largest_gains` -> gains, (N,).
Gains = Callable[[np.ndarray, float], np.ndarray]


class SweptGain(NamedTuple):
    """Largest gain found in a frequency sweep.

    gain: the gain, or inf for an unstable loop
    frequency: its frequency, rad/s
    """

    gain: float
    frequency: float


def swept_gain(loop: np.ndarray, E: np.ndarray, C: np.ndarray) -> SweptGain:
    """Return the largest σ_max(C (jω I - loop)⁻¹ E) on a logarithmic grid, refined around peaks.

    If the loop is not Hurwitz, the gain is inf at the frequency of the pole with the largest real
    part.

    loop: (n, n), state matrix of the closed loop
    E: (n, k)
    C: (p, n)

    Raises NoSolutionError as `responses` does.
    """
    poles = spectrum(loop)
    if poles.abscissa >= 0.0:
        return SweptGain(math.inf, float(abs(poles.eigenvalues[-1].imag)))

    if len(C) > len(loop):
        C = np.linalg.qr(C).R  # the same gain by fewer outputs

    D = np.zeros((len(C), E.shape[1]))

    def gains(frequencies: np.ndarray, fraction: float) -> np.ndarray:
        return gains_at(loop, E, C, D, frequencies, fraction)

    rival = RIVAL
    peaks = _peaks(gains, _sweep_grid(poles.eigenvalues))
    for _ in range(REFINEMENTS):
        finer = [peak.finer(gains) for peak in peaks]
        rival /= 10.0
        highest = max(peak.gain for peak in finer)
        peaks = [peak for peak in finer if peak.gain >= (1.0 - rival) * highest]
    highest_peak = max(peaks, key=lambda peak: peak.gain)
    return SweptGain(highest_peak.gain, float(highest_peak.grid[highest_peak.place]))


class _Peak(NamedTuple):
    """Peak of the gain on a grid of frequencies."""

    grid: np.ndarray  # frequencies, (N,), rad/s
    gains: np.ndarray  # at these frequencies, (N,)
    place: int  # index of the peak

    @property
    def gain(self) -> float:
        """Gain at the peak."""
        return float(self.gains[self.place])

    def finer(self, gains_at: Gains) -> _Peak:
        """Return the largest gain on a finer grid around the peak."""
        low = self.grid[max(self.place - 1, 0)]
        high = self.grid[min(self.place + 1, len(self.grid) - 1)]
        grid = np.unique(np.append(np.linspace(low, high, POINTS), self.grid[self.place]))
        gains = gains_at(grid, 1.0)
        return _Peak(grid, gains, int(np.argmax(gains)))


def _peaks(gains_at: Gains, grid: np.ndarray) -> list[_Peak]:
    """Return the largest peaks of the gain on a grid, `MOST_PEAKS` at most."""
    gains = gains_at(grid, 1.0 - RIVAL)
    surrounded = np.concatenate([[-math.inf], gains, [-math.inf]])
    is_peak = (gains >= surrounded[:-2]) & (gains >= surrounded[2:])
    found = np.flatnonzero(is_peak & (gains >= (1.0 - RIVAL) * gains.max()))
    largest = found[np.argsort(gains[found])[-MOST_PEAKS:]]
    return [_Peak(grid, gains, int(index)) for index in largest]


def _sweep_grid(eigenvalues: np.ndarray) -> np.ndarray:
    """Return a grid that resolves every resonance as `frequency_grid`, with the fewest points."""
    # Where the points of `frequency_grid` around several resonances overlap, one of these sets is
    # enough. The step is the smallest that the logarithmic grid or a resonance needs. The
    # frequencies of the poles are on the grid.
    dense = frequency_grid(eigenvalues)
    widths = np.abs(eigenvalues.real)
    centers = np.abs(eigenvalues.imag)
    distances = np.hypot(widths, dense[:, None] - centers).min(axis=1)
    steps = np.minimum(LOGARITHMIC_STEP * dense, RESONANCE_STEP * distances)[1:]
    lengths = np.minimum(np.diff(dense[1:]) / np.minimum(steps[1:], steps[:-1]), 1.0)
    numbers = np.append(0.0, np.cumsum(lengths))
    even = np.interp(np.arange(numbers[-1]), numbers, dense[1:])
    return _distinct(np.concatenate([[0.0], even, centers, dense[-1:]]))


def frequency_grid(eigenvalues: np.ndarray, per_decade: int = GRID_PER_DECADE) -> np.ndarray:
    """Return frequencies that resolve every resonance, rad/s, ascending.

    The frequencies are 0, a logarithmic grid from 1 % of the smallest nonzero eigenvalue magnitude
    to 100 times the largest, and points around each resonance. The grid always includes the range
    from 0.01 to 100 rad/s. The points around a resonance begin within its width.

    eigenvalues: poles, (n,), 1/s
    per_decade: number of grid points per decade
    """
    moduli = np.abs(eigenvalues)
    slowest = float(moduli[moduli > 0.0].min(initial=1.0))
    fastest = float(moduli.max(initial=1.0))
    decades = math.log10(fastest / slowest) + 4.0
    grid = np.geomspace(1e-2 * slowest, 1e2 * fastest, math.ceil(decades * per_decade))
    around = np.abs(eigenvalues.real) * np.sinh(RESONANCE)[:, None]
    resonances = np.append(np.abs(eigenvalues.imag + around), np.abs(eigenvalues.imag))
    return _distinct(np.concatenate([[0.0], grid, resonances]))


def _distinct(frequencies: np.ndarray) -> np.ndarray:
    """Return the frequencies in ascending order, equal ones (up to rounding) only once."""
    found = np.unique(frequencies)
    return found[np.append(True, np.diff(found) > _SAME * found[1:])]
