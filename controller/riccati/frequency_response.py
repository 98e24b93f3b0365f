"""The L2 gain of a closed loop, by two methods.

Closed loop z' = (A - B K) z + E d, output y = (Q^½ z, R^½ u) with u = -K z; the gain is sup
‖y‖₂/‖d‖₂ = max_ω σ_max(C (jω I - A + B K)⁻¹ E), C'C = Q + K'R K. The game promises a gain below δ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import is_hurwitz, spectrum
from hfa_support.arguments import checks_arguments
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_most, below

TOLERANCE = 1e-9
#: A gain below this fraction of ‖C‖ ‖E‖ / ‖A - B K‖ is rounding: the disturbance does not reach the
#: output.
ZERO = 1e-12
#: The sweep can only miss a peak, never exceed it; this is how much it may miss.
SWEEP_TOLERANCE = 1e-6
GRID_PER_DECADE = 60
#: About a resonance the steps grow with the distance from its pole, up to a hundred of its widths.
RESONANCE = np.linspace(-5.3, 5.3, 45)
#: Frequencies that differ by a smaller part are one.
_SAME = 1e-9
#: Finer grids, each of so many points over two steps of the last: ten times finer, the last a
#: billionth of the peak.
REFINEMENTS = 8
POINTS = 20
#: A, E, Q.
Triple = tuple[np.ndarray, np.ndarray, np.ndarray]


class SweptGain(NamedTuple):
    """The largest gain met on the imaginary axis and the frequency (rad/s) where it is."""

    gain: float
    frequency: float


def level_crossings(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, level: float
) -> np.ndarray:
    """The only frequencies, rad/s, ascending, at which a singular value of C (jω I - A)⁻¹ B + D may
    pass the level, which is none of D.

    |Im λ| of every eigenvalue λ of the bounded-real Hamiltonian: how far rounding moves one off the
    axis is not asked. Source: Zhou, Doyle and Glover, Section 4.7."""
    free = level**2 * np.eye(D.shape[1]) - D.T @ D
    by_output = np.linalg.solve(free, D.T @ C)
    into = B @ np.linalg.solve(free, B.T)
    out = C.T @ (C + D @ by_output)
    # The same eigenvalues for every `ratio`; with this one neither block dwarfs the loop when B is
    # of another unit.
    ratio = math.sqrt((np.linalg.norm(into) or 1.0) / (np.linalg.norm(out) or 1.0))
    loop = A + B @ by_output
    H = np.block([[loop, into / ratio], [-out * ratio, -loop.T]])
    return np.unique(np.abs(spectrum(H).eigenvalues.imag))


def peak_gain(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, level: float) -> float:
    """A gain that T = C (sI - A)⁻¹ B + D, A Hurwitz, has at some frequency; above the level if any
    is.

    T is evaluated at each of `level_crossings`, between each two, below and above. Source: Bruinsma
    and Steinbuch, Systems and Control Letters 14 (1990), 287-293."""
    through = float(np.linalg.norm(D, 2)) if D.size else 0.0
    if not through < level:
        return through
    near = level_crossings(A, B, C, D, level)
    poles = np.linalg.eigvals(A)
    points = [
        [0.0],
        near,
        np.abs(poles),
        np.abs(poles.imag),
        [2.0 * max(np.abs(poles).max(), near.max(initial=0.0))],
    ]
    frequencies = np.unique(np.concatenate(points))
    frequencies = np.concatenate([frequencies, (frequencies[1:] + frequencies[:-1]) / 2.0])
    return float(np.linalg.norm(C @ responses(A, B, frequencies) + D, 2, axis=(1, 2)).max())


@checks_arguments
def bounded_real_gain(game: Game, K: np.ndarray) -> float:
    """L2 gain of the loop of u = -K z, as `system_gain`. K: (m, n)."""
    loop, E, C = closed_loop(game, K)
    return system_gain(loop, E, C, np.zeros((len(C), E.shape[1])))


def closed_loop(game: Game, K: np.ndarray) -> Triple:
    """A - B K, E, and C with C'C = Q + K'R K, of u = -K z. K: (m, n)."""
    K = game.checked_gain(K)
    C = np.vstack([square_root(game.Q), square_root(game.R) @ K])
    return game.A - game.B @ K, game.E, C


def system_gain(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> float:
    """Largest gain of C (sI - A)⁻¹ B + D to 1e-9 relative, from above by `peak_gain`; inf when A is
    not Hurwitz."""
    if not is_hurwitz(A):
        return math.inf
    typical = float(np.linalg.norm(C) * np.linalg.norm(B) / np.linalg.norm(A))
    level = ZERO * typical
    while level > 0.0:
        peak = peak_gain(A, B, C, D, level)
        if not peak >= level:
            break
        level = peak * (1.0 + TOLERANCE)
    return level if level > 10.0 * ZERO * typical else 0.0


def swept_gain(loop: np.ndarray, E: np.ndarray, C: np.ndarray) -> SweptGain:
    """Largest σ_max(C (jω I - loop)⁻¹ E) on a logarithmic grid, then on finer ones.

    inf when the loop is not Hurwitz.
    """
    poles = spectrum(loop)
    if poles.abscissa >= 0.0:
        return SweptGain(math.inf, float(abs(poles.eigenvalues[-1].imag)))
    grid = frequency_grid(poles.eigenvalues)
    for refinement in range(REFINEMENTS + 1):
        gains = np.linalg.norm(C @ responses(loop, E, grid), ord=2, axis=(1, 2))
        peak = int(np.argmax(gains))
        if refinement < REFINEMENTS:
            below_peak = grid[max(peak - 1, 0)]
            above_peak = grid[min(peak + 1, len(grid) - 1)]
            around = np.linspace(below_peak, above_peak, POINTS)
            grid = np.unique(np.append(around, grid[peak]))
    return SweptGain(float(gains[peak]), float(grid[peak]))


def gain_checks(game: Game, K: np.ndarray) -> tuple[Check, ...]:
    """The gain of the closed loop is below delta, and the two methods agree on it."""
    gain = bounded_real_gain(game, K)
    if math.isinf(gain):
        reason = "A - B K is not Hurwitz: the closed loop has no finite L2 gain"
        return (below("l2_gain", gain, game.delta, reason),)
    swept = swept_gain(*closed_loop(game, K))
    difference = abs(swept.gain - gain)
    if gain > 0.0:
        difference /= gain
    too_large = f"the L2 gain {gain:.6g} of the closed loop is not below delta = {game.delta:.6g}"
    apart = (
        f"the sweep gives {swept.gain:.9g} at {swept.frequency:.4g} rad/s,"
        f" the bounded-real lemma {gain:.9g}"
    )
    return (
        below("l2_gain", gain, game.delta, too_large),
        at_most("l2_gain_methods_agree", difference, SWEEP_TOLERANCE, apart),
    )


def frequency_grid(eigenvalues: np.ndarray, per_decade: int = GRID_PER_DECADE) -> np.ndarray:
    """0, a logarithmic grid over the moduli of the eigenvalues (two decades beyond), and finer ones
    about each resonance, from its width on."""
    moduli = np.abs(eigenvalues)
    slowest = float(moduli[moduli > 0.0].min(initial=1.0))
    fastest = float(moduli.max(initial=1.0))
    decades = math.log10(fastest / slowest) + 4.0
    grid = np.geomspace(1e-2 * slowest, 1e2 * fastest, math.ceil(decades * per_decade))
    around = np.abs(eigenvalues.real) * np.sinh(RESONANCE)[:, None]
    resonances = np.append(np.abs(eigenvalues.imag + around), np.abs(eigenvalues.imag))
    found = np.unique(np.concatenate([[0.0], grid, resonances]))
    # Of frequencies that are equal but for rounding one stays: a peak lies between neighbours.
    return found[np.append(True, np.diff(found) > _SAME * found[1:])]


def responses(loop: np.ndarray, B: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """(jω I - loop)⁻¹ B, (N, n, m); NoSolutionError where rounding leaves a pole of the loop on the
    axis."""
    resolvent = 1j * frequencies[:, None, None] * np.eye(len(loop)) - loop
    try:
        return np.linalg.solve(resolvent, np.broadcast_to(B, (len(frequencies), *B.shape)))
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(
            "rounding leaves a pole of A - B K on the imaginary axis; check the scaling"
        ) from error


def square_root(matrix: np.ndarray) -> np.ndarray:
    """M^½ of a symmetric positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
