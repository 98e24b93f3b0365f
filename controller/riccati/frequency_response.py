"""What a closed loop does at its worst frequency: the L2 gain, by two methods, and the disk margin.

Closed loop z' = (A - B K) z + E d, output y = (Q^½ z, R^½ u) with u = -K z; the gain is
sup ‖y‖₂/‖d‖₂ = max_ω σ_max(C (jω I - A + B K)⁻¹ E), C'C = Q + K'R K. The game promises a gain below δ.
L(s) = K (sI - A)⁻¹ B is the loop broken at the input, S = (I + L)⁻¹. Margins are factors (not dB), phases degrees,
frequencies rad/s; they concern the gain K alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import is_hurwitz, spectrum
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_most, below

TOLERANCE = 1e-9
#: A gain below this fraction of ‖C‖ ‖E‖ / ‖A - B K‖ is rounding: the disturbance does not reach the output.
ZERO = 1e-12
#: An eigenvalue of the bounded-real Hamiltonian with |Re λ| up to this part of |λ| may lie on the imaginary axis.
MAYBE_ON_AXIS = 1e-3
#: The sweep can only miss a peak, never exceed it; this is how much it may miss.
SWEEP_TOLERANCE = 1e-6
GRID_PER_DECADE = 60
#: Finer grids, each of so many points over two steps of the last: ten times finer, the last a billionth of the peak.
REFINEMENTS, POINTS = 8, 20
#: Peaks whose scaling is optimised one after another until none is left above; a loop has far fewer.
MAX_PEAKS = 200
#: L vanishes at infinite frequency, where S - I/2 = I/2; no grid reaches that far.
DISK_AT_INFINITY = 2.0
#: Rounds of balancing all rows and columns: a start, which the search at each peak betters.
SWEEPS = 20
#: Most steps of that search, and most trials of the length of one: at a kink no length is left in the end.
MAX_STEPS, MAX_TRIALS = 1000, 40
#: Longest step of log D, which is best at infinity for a triangular M: there exp(log D) must not overflow on the way.
FARTHEST = 5.0
#: Condition of the modes up to which responses keep ten digits when summed over them.
WELL_CONDITIONED = 1e6

#: A, E, Q.
Triple = tuple[np.ndarray, np.ndarray, np.ndarray]


class SweptGain(NamedTuple):
    """The largest gain met on the imaginary axis and the frequency (rad/s) where it is."""

    gain: float
    frequency: float


class DiskMargin(NamedTuple):
    """All inputs at once: each may be multiplied by its own factor f = (2 + αε)/(2 - αε), |ε| < 1 complex.

    disk: α.  Real f lies in (1/gain, gain), gain = (2 + α)/(2 - α); pure phase within `phase` = 2 arctan(α/2).
    frequency: where the margin is smallest.  A lower bound: the true margin may be a little larger.
    """

    disk: float
    gain: float
    phase: float
    frequency: float


def without_feedthrough(A: np.ndarray, E: np.ndarray, C: np.ndarray, D: np.ndarray, delta: float) -> Triple:
    """A, E and Q = C'C of the system without D that has gain below δ exactly when x' = A x + E w, z = C x + D w has."""
    if not D.any() or math.isinf(delta):
        return A, E, C.T @ C
    free = np.eye(D.shape[1]) - D.T @ D / delta**2
    root = np.linalg.cholesky(free)
    Q = C.T @ np.linalg.solve(np.eye(len(D)) - D @ D.T / delta**2, C)
    return A + E @ np.linalg.solve(free, D.T @ C) / delta**2, np.linalg.solve(root, E.T).T, Q


def peak_gain(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, level: float) -> float:
    """A gain that T = C (sI - A)⁻¹ B + D, A Hurwitz, has at some frequency; above the level if any is.

    |T(jω)| passes the level only where jω is an eigenvalue of the bounded-real Hamiltonian. So T is evaluated at
    each eigenvalue that rounding may have moved off the axis, between each two, below and above. (How far the
    Hamiltonian is from an eigenvalue on the axis says little here: near δ_min |T| is nearly δ at every frequency.)
    Source: Bruinsma and Steinbuch, Systems and Control Letters 14 (1990), 287-293.
    """
    through = float(np.linalg.norm(D, 2)) if D.size else 0.0
    if not through < level:
        return through
    loop, into, Q = without_feedthrough(A, B, C, D, level)
    # The same eigenvalues for every `ratio`; with this one neither block dwarfs the loop when B is of another unit.
    ratio = math.sqrt((np.linalg.norm(into @ into.T) or 1.0) / (np.linalg.norm(Q) or 1.0))
    H = np.block([[loop, into @ into.T / (level * ratio)], [-Q * (ratio / level), -loop.T]])
    found = spectrum(H).eigenvalues
    near = np.unique(np.abs(found.imag[np.abs(found.real) <= MAYBE_ON_AXIS * np.abs(found)]))
    poles = np.linalg.eigvals(A)
    points = [[0.0], near, np.abs(poles), np.abs(poles.imag), [2.0 * max(np.abs(poles).max(), near.max(initial=0.0))]]
    frequencies = np.unique(np.concatenate(points))
    frequencies = np.concatenate([frequencies, (frequencies[1:] + frequencies[:-1]) / 2.0])
    return float(np.linalg.norm(C @ _responses(A, B, frequencies) + D, 2, axis=(1, 2)).max())


def bounded_real_gain(game: Game, K: np.ndarray) -> float:
    """L2 gain to 1e-9 relative, from above by `peak_gain`; inf when A - B K is not Hurwitz. K: (m, n)."""
    loop = game.A - game.B @ game.checked_gain(K)
    if not is_hurwitz(loop):
        return math.inf
    C = np.vstack([square_root(game.Q), square_root(game.R) @ K])
    D, typical = np.zeros((len(C), game.E.shape[1])), np.linalg.norm(C) * np.linalg.norm(game.E) / np.linalg.norm(loop)
    level = ZERO * float(typical)
    while level > 0.0 and (found := peak_gain(loop, game.E, C, D, level)) >= level:
        level = found * (1.0 + TOLERANCE)
    return level if level > 10.0 * ZERO * typical else 0.0


def swept_gain(game: Game, K: np.ndarray) -> SweptGain:
    """Largest σ_max(C (jω I - A + B K)⁻¹ E) on a logarithmic grid, then on finer ones; inf when not Hurwitz."""
    loop = game.A - game.B @ K
    found = spectrum(loop)
    if found.abscissa >= 0.0:
        return SweptGain(math.inf, float(abs(found.eigenvalues[-1].imag)))
    C = np.vstack([square_root(game.Q), square_root(game.R) @ K])
    grid = frequency_grid(found.eigenvalues)
    for refinement in range(REFINEMENTS + 1):
        gains = np.linalg.norm(C @ _responses(loop, game.E, grid), ord=2, axis=(1, 2))
        peak = int(np.argmax(gains))
        if refinement < REFINEMENTS:
            around = np.linspace(grid[max(peak - 1, 0)], grid[min(peak + 1, len(grid) - 1)], POINTS)
            grid = np.unique(np.append(around, grid[peak]))
    return SweptGain(float(gains[peak]), float(grid[peak]))


def gain_checks(game: Game, K: np.ndarray) -> tuple[Check, ...]:
    """The gain of the closed loop is below delta, and the two methods agree on it."""
    swept, gain = swept_gain(game, K), bounded_real_gain(game, K)
    if math.isinf(gain):
        return (below("l2_gain", gain, game.delta, "A - B K is not Hurwitz: the closed loop has no finite L2 gain"),)
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


def disk_margin(game: Game, K: np.ndarray) -> DiskMargin:
    """α = 1 / max_ω μ(S(jω) - I/2), μ over independent complex factors, bounded above by D-scaling.

    K: (m, n).  μ(M) <= min_D σ_max(D M D⁻¹), D diagonal: convex in log D, minimised at each peak of a frequency
    grid until the highest peak has been minimised.  Raises NoSolutionError when A - B K is not Hurwitz.
    Source: Seiler, Packard and Gahinet, IEEE Control Systems Magazine 40 (2020), 78-95.
    """
    grid = loop_grid(game, K)
    responses = balanced_sensitivity(game, K, grid)
    bounds = scaled_norm(responses, _osborne_scaling(responses))
    minimised = np.zeros(len(grid), dtype=bool)
    for _ in range(MAX_PEAKS):
        peak = int(np.argmax(bounds))
        if minimised[peak]:
            break
        # The scaling found at a peak serves its neighbours too: a flat top is done at once.
        bounds = np.minimum(bounds, scaled_norm(responses, best_scaling(responses[peak])))
        minimised[peak] = True
    peak = int(np.argmax(bounds))
    alpha = min(1.0 / float(bounds[peak]), DISK_AT_INFINITY)
    return DiskMargin(alpha, *disk_sizes(alpha), float(grid[peak]))


def best_scaling(M: np.ndarray) -> np.ndarray:
    """log D, (m,), of the smallest σ_max(D M D⁻¹), D > 0 diagonal: the upper bound of μ(M), M: (m, m) complex.

    Exact for m <= 3.  BFGS with a line search that asks for no smoothness: the smallest is often at a kink, where two
    singular values are the largest.  Sources: Packard and Doyle, Automatica 29 (1993), 71-109; Lewis and Overton,
    Mathematical Programming 141 (2013), 135-163.
    """
    start = _osborne_scaling(M)
    free = start[:-1] - start[-1]
    size, slope = _norm_and_slope(free, M)
    inverse = np.eye(len(free)) / size if size > 0.0 else np.eye(len(free))
    for _ in range(MAX_STEPS):
        if np.abs(slope).max(initial=0.0) <= TOLERANCE * size:
            break
        way = -inverse @ slope
        if np.abs(way).max() > FARTHEST:  # no curvature is left: steepest descent again
            inverse = np.eye(len(free)) / size
            way = -inverse @ slope
        falls, share, low, high = slope @ way, 1.0, 0.0, math.inf
        for _ in range(MAX_TRIALS):
            there, slope_there = _norm_and_slope(free + share * way, M)
            if there >= size + 1e-4 * share * falls:
                high = share
            elif slope_there @ way < 0.9 * falls:
                low = share
            else:
                break
            share = 2.0 * low if math.isinf(high) else 0.5 * (low + high)
        else:
            break
        step, change = share * way, slope_there - slope
        turn = np.eye(len(free)) - np.outer(step, change) / (step @ change)
        inverse = turn @ inverse @ turn.T + np.outer(step, step) / (step @ change)
        free, size, slope = free + step, there, slope_there
    return np.append(free, 0.0)


def _norm_and_slope(free: np.ndarray, M: np.ndarray) -> tuple[float, np.ndarray]:
    """σ = σ_max(D M D⁻¹) and ∂σ/∂log D_i = σ (|u_i|² - |v_i|²), (m - 1,): its singular vectors are u, v; D_m = 1."""
    D = np.exp(np.append(free, 0.0))
    u, sizes, v = np.linalg.svd(D[:, None] * M / D)
    return float(sizes[0]), sizes[0] * (np.abs(u[:-1, 0]) ** 2 - np.abs(v[0, :-1]) ** 2)


def loop_grid(game: Game, K: np.ndarray) -> np.ndarray:
    """`frequency_grid` of A and A - B K; NoSolutionError when that is not Hurwitz."""
    closed = spectrum(game.A - game.B @ game.checked_gain(K))
    if closed.abscissa >= 0.0:
        raise NoSolutionError(f"A - B K has abscissa {closed.abscissa:+.4g} 1/s: an unstable loop has no margins")
    both = np.concatenate([closed.eigenvalues, np.linalg.eigvals(game.A)])
    return frequency_grid(both)


def balanced_sensitivity(game: Game, K: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """S(jω) - I/2 = I/2 - K (jω I - A + B K)⁻¹ B, (N, m, m): mode by mode where the modes are well conditioned."""
    loop, half = game.A - game.B @ K, 0.5 * np.eye(game.B.shape[1])
    poles, modes = np.linalg.eig(loop)
    if np.linalg.cond(modes) < WELL_CONDITIONED:
        decays = 1.0 / (1j * frequencies[:, None] - poles)
        return half - ((K @ modes) * decays[:, None, :]) @ np.linalg.solve(modes, game.B)
    return half - K @ _responses(loop, game.B, frequencies)


def scaled_norm(M: np.ndarray, log_D: np.ndarray) -> np.ndarray:
    """σ_max(D M D⁻¹) of one matrix or of a stack (..., m, m) with its scalings (..., m)."""
    scaled = np.exp(log_D[..., :, None] - log_D[..., None, :]) * M
    return np.asarray(np.linalg.norm(scaled, 2, axis=(-2, -1)))


def _osborne_scaling(M: np.ndarray) -> np.ndarray:
    """log D that equalises the norms of the rows and columns of D M D⁻¹ off the diagonal: a good start.

    M: (..., m, m), one matrix or a stack; returns (..., m).
    """
    off = np.abs(M) ** 2 * (1.0 - np.eye(M.shape[-1]))
    log_D = np.zeros(M.shape[:-1])
    for _ in range(SWEEPS):
        scaled = off * np.exp(2.0 * (log_D[..., :, None] - log_D[..., None, :]))
        row, column = scaled.sum(axis=-1), scaled.sum(axis=-2)
        ratio = np.divide(column, row, out=np.ones_like(row), where=(row > 0.0) & (column > 0.0))
        log_D += 0.125 * np.log(np.where(ratio > 0.0, ratio, 1.0))
    return np.asarray(log_D - log_D.mean(axis=-1, keepdims=True))


def disk_sizes(alpha: float) -> tuple[float, float]:
    """The real gain and the phase, degrees, of a disk of margin α."""
    gain = (2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf
    return gain, math.degrees(2.0 * math.atan(alpha / 2.0))


def frequency_grid(eigenvalues: np.ndarray) -> np.ndarray:
    """0, a logarithmic grid over the moduli of the eigenvalues (two decades beyond), and their resonances."""
    moduli = np.abs(eigenvalues)
    slowest = float(moduli[moduli > 0.0].min(initial=1.0))
    fastest = float(moduli.max(initial=1.0))
    decades = math.log10(fastest / slowest) + 4.0
    grid = np.geomspace(1e-2 * slowest, 1e2 * fastest, math.ceil(decades * GRID_PER_DECADE))
    return np.unique(np.concatenate([[0.0], grid, np.abs(eigenvalues.imag)]))


def _responses(loop: np.ndarray, B: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """(jω I - loop)⁻¹ B, (N, n, m); NoSolutionError where rounding leaves a pole of the loop on the axis."""
    resolvent = 1j * frequencies[:, None, None] * np.eye(len(loop)) - loop
    try:
        return np.linalg.solve(resolvent, np.broadcast_to(B, (len(frequencies), *B.shape)))
    except np.linalg.LinAlgError as error:
        raise NoSolutionError("rounding leaves a pole of A - B K on the imaginary axis; check the scaling") from error


def square_root(matrix: np.ndarray) -> np.ndarray:
    """M^½ of a symmetric positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
