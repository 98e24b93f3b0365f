"""Grid of frequencies that resolves every resonance of a loop."""

from __future__ import annotations

import math

import numpy as np

GRID_PER_DECADE = 60
#: Points near a resonance: their spacing grows with the distance from the pole, up to a hundred of
#: its widths.
RESONANCE = np.linspace(-5.3, 5.3, 45)
#: Frequencies with a smaller relative difference count as equal.
_SAME = 1e-9


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
