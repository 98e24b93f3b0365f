"""Margins of a closed loop, all inputs at once within disks.

S = (I + L)⁻¹ = I + C (jω I - A)⁻¹ B of a closed loop with the matrix A that is broken where B
enters and C leaves; M = S - I/2. A loop l = (1/2 - M) / (1/2 + M) is real where M is, and of size 1
where M is imaginary. Margins are factors (not dB), phases degrees, frequencies rad/s."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.frequency_response import TOLERANCE, frequency_grid, responses
from hfa_support.arguments import checks_arguments
from hfa_support.errors import NoSolutionError

#: Peaks whose scaling is optimised one after another until none is left above; a loop has far
#: fewer.
MAX_PEAKS = 200
#: L vanishes at infinite frequency, where S - I/2 = I/2; no grid reaches that far.
DISK_AT_INFINITY = 2.0
#: Rounds of balancing all rows and columns: a start, which the search at each peak betters.
SWEEPS = 20
#: Most steps of that search, and most trials of the length of one: at a kink no length is left in
#: the end.
MAX_STEPS = 1000
MAX_TRIALS = 40
#: Longest step of log D, which is best at infinity for a triangular M: there exp(log D) must not
#: overflow on the way.
FARTHEST = 5.0
#: Condition of the modes up to which responses keep ten digits when summed over them.
WELL_CONDITIONED = 1e6

#: ω, (N,) -> M, (N, m, m), where an index follows only of this loop; or (N, k) of k loops.
Response = Callable[..., np.ndarray]


class DiskMargin(NamedTuple):
    """All inputs at once: each may be multiplied by its own factor f = (2 + αε)/(2 - αε), |ε| < 1
    complex.

    disk: α, a lower bound: the true margin may be a little larger
    gain: (2 + α)/(2 - α); a real f lies in (1/gain, gain)
    phase: 2 arctan(α/2), deg, for f of pure phase
    frequency: rad/s, where the margin is smallest
    """

    disk: float
    gain: float
    phase: float
    frequency: float


def shifted_sensitivity(closed: np.ndarray, enters: np.ndarray, leaves: np.ndarray) -> Response:
    """M = I/2 + leaves (jω I - closed)⁻¹ enters: summed over the modes where these are well
    conditioned."""
    half = 0.5 * np.eye(len(leaves))
    poles, modes = np.linalg.eig(closed)
    well = np.linalg.cond(modes) < WELL_CONDITIONED
    if well:
        leaves = leaves @ modes
        enters = np.linalg.solve(modes, enters)

    def response(frequencies: np.ndarray, loop: int | None = None) -> np.ndarray:
        loops = slice(None) if loop is None else slice(loop, loop + 1)
        if well:
            scaled = leaves[loops] / (1j * frequencies[:, None, None] - poles)
            return half[loops, loops] + scaled @ enters[:, loops]
        return half[loops, loops] + leaves[loops] @ responses(closed, enters[:, loops], frequencies)

    return response


def stable_poles(closed: np.ndarray) -> np.ndarray:
    """The poles of a closed loop. NoSolutionError where one is not stable."""
    poles = spectrum(closed)
    if poles.abscissa >= 0.0:
        raise NoSolutionError(
            f"the loop has a pole at {poles.abscissa:+.4g} 1/s: an unstable loop has no margins"
        )
    return poles.eigenvalues


def response_of(game: Game, K: np.ndarray) -> tuple[Response, np.ndarray]:
    """M of all inputs of u = -K z, and a grid."""
    closed = game.A - game.B @ game.checked_gain(K)
    grid = frequency_grid(np.concatenate([stable_poles(closed), np.linalg.eigvals(game.A)]))
    return shifted_sensitivity(closed, game.B, -K), grid


@checks_arguments
def disk_margin(game: Game, K: np.ndarray) -> DiskMargin:
    """α = 1 / max_ω μ(S(jω) - I/2), μ over independent complex factors, bounded above by D-scaling.

    game: the plant
    K: (m, n)

    μ(M) <= min_D σ_max(D M D⁻¹), D diagonal: convex in log D, minimised at each peak of
    a frequency grid until the highest peak has been minimised.  Raises NoSolutionError when A - B K
    is not Hurwitz. Source: Seiler, Packard and Gahinet, IEEE Control Systems Magazine 40 (2020),
    78-95."""
    return disk_of(*response_of(game, K))


def disk_of(M: Response, grid: np.ndarray) -> DiskMargin:
    """The margin of `disk_margin` of any loop. M: of all inputs. grid: has every resonance."""
    shifted = M(grid)
    bounds = scaled_norm(shifted, _osborne_scaling(shifted))
    minimised = np.zeros(len(grid), dtype=bool)
    for _ in range(MAX_PEAKS):
        peak = int(np.argmax(bounds))
        if minimised[peak]:
            break
        # The scaling found at a peak serves its neighbours too: a flat top is done at once.
        bounds = np.minimum(bounds, scaled_norm(shifted, best_scaling(shifted[peak])))
        minimised[peak] = True
    peak = int(np.argmax(bounds))
    alpha = min(1.0 / float(bounds[peak]), DISK_AT_INFINITY)
    return DiskMargin(alpha, *disk_sizes(alpha), float(grid[peak]))


def best_scaling(M: np.ndarray) -> np.ndarray:
    """log D, (m,), of the smallest σ_max(D M D⁻¹), D > 0 diagonal: the upper bound of μ(M), M: (m,
    m) complex.

    Exact for m <= 3.  BFGS with a line search that asks for no smoothness: the smallest is often at
    a kink, where two singular values are the largest.  Sources: Packard and Doyle, Automatica 29
    (1993), 71-109; Lewis and Overton, Mathematical Programming 141 (2013), 135-163."""
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
        falls = slope @ way
        share = 1.0
        low = 0.0
        high = math.inf
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
        step = share * way
        change = slope_there - slope
        turn = np.eye(len(free)) - np.outer(step, change) / (step @ change)
        inverse = turn @ inverse @ turn.T + np.outer(step, step) / (step @ change)
        free = free + step
        size = there
        slope = slope_there
    return np.append(free, 0.0)


def _norm_and_slope(free: np.ndarray, M: np.ndarray) -> tuple[float, np.ndarray]:
    """σ = σ_max(D M D⁻¹) and ∂σ/∂log D_i = σ (|u_i|² - |v_i|²), (m - 1,): its singular vectors are
    u, v; D_m = 1."""
    D = np.exp(np.append(free, 0.0))
    u, sizes, v = np.linalg.svd(D[:, None] * M / D)
    return float(sizes[0]), sizes[0] * (np.abs(u[:-1, 0]) ** 2 - np.abs(v[0, :-1]) ** 2)


def scaled_norm(M: np.ndarray, log_D: np.ndarray) -> np.ndarray:
    """σ_max(D M D⁻¹) of one matrix or of a stack (..., m, m) with its scalings (..., m)."""
    scaled = np.exp(log_D[..., :, None] - log_D[..., None, :]) * M
    return np.asarray(np.linalg.norm(scaled, 2, axis=(-2, -1)))


def _osborne_scaling(M: np.ndarray) -> np.ndarray:
    """log D that equalises the norms of the rows and columns of D M D⁻¹ off the diagonal: a good
    start.

    M: (..., m, m), one matrix or a stack; returns (..., m).
    """
    off = np.abs(M) ** 2 * (1.0 - np.eye(M.shape[-1]))
    log_D = np.zeros(M.shape[:-1])
    for _ in range(SWEEPS):
        scaled = off * np.exp(2.0 * (log_D[..., :, None] - log_D[..., None, :]))
        row = scaled.sum(axis=-1)
        column = scaled.sum(axis=-2)
        ratio = np.divide(column, row, out=np.ones_like(row), where=(row > 0.0) & (column > 0.0))
        log_D += 0.125 * np.log(np.where(ratio > 0.0, ratio, 1.0))
    return np.asarray(log_D - log_D.mean(axis=-1, keepdims=True))


def disk_sizes(alpha: float) -> tuple[float, float]:
    """The real gain and the phase, degrees, of a disk of margin α."""
    gain = (2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf
    return gain, math.degrees(2.0 * math.atan(alpha / 2.0))
