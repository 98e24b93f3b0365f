"""L2 gain from the disturbance to the weighted state and input, by two methods that share nothing.

Closed loop z' = (A - B K) z + E d, output y = (Q^½ z, R^½ u) with u = -K z; the gain is
sup ‖y‖₂/‖d‖₂ = max_ω σ_max(C (jω I - A + B K)⁻¹ E), C'C = Q + K'R K. The game promises a gain below δ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.reporting.checks import Check, at_most, below
from verification.riccati.spectrum import is_hurwitz, spectrum

TOLERANCE = 1e-9
#: A gain below this fraction of ‖C‖ ‖E‖ / ‖A - B K‖ is rounding: the disturbance does not reach the output.
ZERO = 1e-12
#: Closer to the axis than this, an eigenvalue of the bounded-real Hamiltonian counts as lying on it.
AXIS_DISTANCE = 1e-14
#: The sweep can only miss a peak, never exceed it; this is how much it may miss.
SWEEP_TOLERANCE = 1e-6
GRID_PER_DECADE = 60


class SweptGain(NamedTuple):
    """The largest gain met on the imaginary axis and the frequency (rad/s) where it is."""

    gain: float
    frequency: float


def gain_is_below(game: Game, K: np.ndarray, level: float) -> bool:
    """Bounded-real lemma: gain < γ exactly when A - B K is Hurwitz and no eigenvalue of

        [[A - B K, E E'/γ], [-(Q + K'R K)/γ, -(A - B K)']]

    lies on the imaginary axis. K: (m, n). Source: Zhou, Doyle and Glover, Theorem 4.7.
    """
    loop = game.A - game.B @ K
    cost = game.Q + K.T @ game.R @ K
    # The same eigenvalues for every `ratio`; with this one neither block dwarfs the loop when E is of another unit.
    ratio = math.sqrt((np.linalg.norm(game.S_disturbance) or 1.0) / (np.linalg.norm(cost) or 1.0))
    H = np.block([[loop, game.S_disturbance / (level * ratio)], [-cost * (ratio / level), -loop.T]])
    return is_hurwitz(loop) and spectrum(H).axis_distance() > AXIS_DISTANCE


def bounded_real_gain(game: Game, K: np.ndarray) -> float:
    """L2 gain to 1e-9 relative by bisection on `gain_is_below`; inf when A - B K is not Hurwitz, or so stiff that
    rounding hides every bound.

    The number returned is the upper end: it was seen to be above the gain.
    Source: Boyd, Balakrishnan and Kabamba, Math. Control Signals Systems 2 (1989), 207-219.
    """
    loop = game.A - game.B @ K
    if not is_hurwitz(loop):
        return math.inf
    cost = game.Q + K.T @ game.R @ K
    typical = math.sqrt(np.linalg.norm(game.S_disturbance) * np.linalg.norm(cost)) / float(np.linalg.norm(loop))
    if typical == 0.0:
        return 0.0
    lower = upper = typical
    while not gain_is_below(game, K, upper):
        lower, upper = upper, 4.0 * upper
        if math.isinf(upper):
            return math.inf
    while gain_is_below(game, K, lower):
        lower, upper = lower / 4.0, lower
        if upper < ZERO * typical:
            return 0.0
    while upper > lower * (1.0 + TOLERANCE):
        middle = math.sqrt(lower * upper)
        lower, upper = (lower, middle) if gain_is_below(game, K, middle) else (middle, upper)
    return upper


def swept_gain(game: Game, K: np.ndarray) -> SweptGain:
    """Largest σ_max(C (jω I - A + B K)⁻¹ E) on a logarithmic grid, its peak refined; inf when not Hurwitz."""
    from scipy.optimize import minimize_scalar

    loop = game.A - game.B @ K
    found = spectrum(loop)
    if found.abscissa >= 0.0:
        return SweptGain(math.inf, float(abs(found.eigenvalues[-1].imag)))
    C = np.vstack([square_root(game.Q), square_root(game.R) @ K])
    grid = frequency_grid(found.eigenvalues)
    gains = _gains(loop, game.E, C, grid)
    peak = int(np.argmax(gains))
    left, right = grid[max(peak - 1, 0)], grid[min(peak + 1, len(grid) - 1)]
    refined = minimize_scalar(
        lambda omega: -_gains(loop, game.E, C, np.array([omega]))[0],
        bounds=(left, right),
        method="bounded",
        options={"xatol": 1e-9 * right},
    )
    if -refined.fun > gains[peak]:
        return SweptGain(float(-refined.fun), float(refined.x))
    return SweptGain(float(gains[peak]), float(grid[peak]))


def gain_checks(game: Game, K: np.ndarray) -> tuple[Check, ...]:
    """The gain of the closed loop is below delta, and the two methods agree on it."""
    gain, swept = bounded_real_gain(game, K), swept_gain(game, K)
    if math.isinf(gain):
        stiff = "A - B K is so stiff that rounding hides every bound of the L2 gain; check the scaling"
        unstable = "A - B K is not Hurwitz: the closed loop has no finite L2 gain"
        reason = stiff if is_hurwitz(game.A - game.B @ K) else unstable
        return (below("l2_gain", gain, game.delta, reason),)
    difference = abs(swept.gain - gain) / gain if gain > 0.0 else swept.gain
    return (
        below(
            "l2_gain",
            gain,
            game.delta,
            f"the L2 gain {gain:.6g} of the closed loop is not below delta = {game.delta:.6g}",
        ),
        at_most(
            "l2_gain_methods_agree",
            difference,
            SWEEP_TOLERANCE,
            f"the sweep gives {swept.gain:.9g} at {swept.frequency:.4g} rad/s, the bounded-real lemma {gain:.9g}",
        ),
    )


def frequency_grid(eigenvalues: np.ndarray) -> np.ndarray:
    """0, a logarithmic grid over the moduli of the eigenvalues (two decades beyond), and their resonances."""
    moduli = np.abs(eigenvalues)
    slowest = float(moduli[moduli > 0.0].min(initial=1.0))
    fastest = float(moduli.max(initial=1.0))
    decades = math.log10(fastest / slowest) + 4.0
    grid = np.geomspace(1e-2 * slowest, 1e2 * fastest, math.ceil(decades * GRID_PER_DECADE))
    return np.unique(np.concatenate([[0.0], grid, np.abs(eigenvalues.imag)]))


def _gains(loop: np.ndarray, E: np.ndarray, C: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    resolvent = 1j * frequencies[:, None, None] * np.eye(len(loop)) - loop
    response = C @ np.linalg.solve(resolvent, np.broadcast_to(E, (len(frequencies), *E.shape)))
    return np.linalg.norm(response, ord=2, axis=(1, 2))


def square_root(matrix: np.ndarray) -> np.ndarray:
    """M^½ of a symmetric positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
