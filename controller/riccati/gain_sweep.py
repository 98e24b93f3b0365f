"""L2 gain of a closed loop by a frequency sweep, independent of `frequency_response`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.frequency_response import responses

GRID_PER_DECADE = 60
#: Points near a resonance: their spacing grows with the distance from the pole, up to a hundred of
#: its widths.
RESONANCE = np.linspace(-5.3, 5.3, 45)
#: Frequencies with a smaller relative difference count as equal.
_SAME = 1e-9
#: Number of finer grids, and points of each, over two steps of the grid before: ten times finer,
#: until the step is a billionth of the peak frequency.
REFINEMENTS = 8
#: A peak of the first grid is refined if it has at least this fraction of the largest gain there,
RIVAL = 0.8
#: and if it is among the largest.
MOST_PEAKS = 8
POINTS = 20


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

    def gains_at(frequencies: np.ndarray) -> np.ndarray:
        return np.linalg.norm(C @ responses(loop, E, frequencies), ord=2, axis=(1, 2))

    grid = frequency_grid(poles.eigenvalues)
    gains = gains_at(grid)
    surrounded = np.concatenate([[-math.inf], gains, [-math.inf]])
    is_peak = (gains >= surrounded[:-2]) & (gains >= surrounded[2:])
    peaks = np.flatnonzero(is_peak & (gains >= RIVAL * gains.max()))
    peaks = peaks[np.argsort(gains[peaks])[-MOST_PEAKS:]]
    refined = [_refined(gains_at, grid, gains, int(peak)) for peak in peaks]
    return max(refined, key=lambda each: each.gain)


def _refined(
    gains_at: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, gains: np.ndarray, peak: int
) -> SweptGain:
    """Return the largest gain found on ever finer grids around one peak of a grid.

    gains_at: function of frequencies, (N,)
    grid: frequencies, (N,), rad/s
    gains: at these frequencies, (N,)
    peak: index of the peak
    """
    for _ in range(REFINEMENTS):
        below_peak = grid[max(peak - 1, 0)]
        above_peak = grid[min(peak + 1, len(grid) - 1)]
        around = np.linspace(below_peak, above_peak, POINTS)
        grid = np.unique(np.append(around, grid[peak]))
        gains = gains_at(grid)
        peak = int(np.argmax(gains))
    return SweptGain(float(gains[peak]), float(grid[peak]))


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
    found = np.unique(np.concatenate([[0.0], grid, resonances]))
    # One of several frequencies that are equal up to rounding is kept, so that the peak is between
    # distinct neighbors.
    return found[np.append(True, np.diff(found) > _SAME * found[1:])]
