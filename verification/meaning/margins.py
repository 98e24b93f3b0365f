"""How much gain and phase the loop of a policy u = -K z tolerates at the plant input.

L(s) = K (sI - A)⁻¹ B is the loop broken at the input, S = (I + L)⁻¹. The margins concern the gain alone: learned
and exact gains are compared by the same numbers. Gains are factors (not dB), phases degrees, frequencies rad/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError
from verification.meaning.crossovers import Loop
from verification.riccati.l2_gain import frequency_grid
from verification.riccati.spectrum import spectrum

#: Peaks whose scaling is optimised one after another until none is left above; a loop has far fewer.
MAX_PEAKS = 200
#: L vanishes at infinite frequency, where S - I/2 = I/2; no grid reaches that far.
DISK_AT_INFINITY = 2.0
#: A gain below this is a crossover at infinite frequency that rounding moved off zero.
ROUNDING = 1e-12
#: Rounds of balancing all rows and columns: a start, which the search at each peak betters.
SWEEPS = 6
#: Condition of the modes up to which responses keep ten digits when summed over them.
WELL_CONDITIONED = 1e6


class LoopMargin(NamedTuple):
    """One input at a time, all other loops closed (classical margins, and the balanced disk margin).

    The loop stays stable while its gain is multiplied by a factor in (gain_low, gain_high), or its phase
    shifted by less than `phase`; with both at once, within the disk of margin `disk`.
    """

    gain_low: float
    gain_high: float
    phase: float
    disk: float
    disk_gain: float
    disk_phase: float


class DiskMargin(NamedTuple):
    """All inputs at once: each may be multiplied by its own factor f = (2 + αε)/(2 - αε), |ε| < 1 complex.

    disk: α.  Real f lies in (1/gain, gain), gain = (2 + α)/(2 - α); pure phase within `phase` = 2 arctan(α/2).
    frequency: where the margin is smallest.  A lower bound: the true margin may be a little larger.
    """

    disk: float
    gain: float
    phase: float
    frequency: float


def loop_margins(game: Game, K: np.ndarray) -> tuple[LoopMargin, ...]:
    """Margins of each input, in the order of the inputs. K: (m, n).

    L_i(s) = K_i (sI - A + Σ_{j≠i} B_j K_j)⁻¹ B_i.  Raises NoSolutionError when A - B K is not Hurwitz.
    Source: Blight, Dailey and Gangsaas, Int. J. Control 59 (1994).
    """
    peaks = np.abs(_balanced_sensitivity(game, K, _grid(game, K))).max(axis=0)
    return tuple(_loop_margin(game, K, i, float(peaks[i, i])) for i in range(game.B.shape[1]))


def disk_margin(game: Game, K: np.ndarray) -> DiskMargin:
    """α = 1 / max_ω μ(S(jω) - I/2), μ over independent complex factors, bounded above by D-scaling.

    K: (m, n).  μ(M) <= min_D σ_max(D M D⁻¹), D diagonal: convex in log D, minimised at each peak of a frequency
    grid until the highest peak has been minimised.  Raises NoSolutionError when A - B K is not Hurwitz.
    Source: Seiler, Packard and Gahinet, IEEE Control Systems Magazine 40 (2020), 78-95.
    """
    grid = _grid(game, K)
    responses = _balanced_sensitivity(game, K, grid)
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
    return DiskMargin(alpha, _disk_gain(alpha), _disk_phase(alpha), float(grid[peak]))


def best_scaling(M: np.ndarray) -> np.ndarray:
    """log D, (m,), of the smallest σ_max(D M D⁻¹), D > 0 diagonal: the upper bound of μ(M), M: (m, m) complex.

    Exact for m <= 3.  Source: Packard and Doyle, Automatica 29 (1993), 71-109.
    """
    from scipy.optimize import minimize

    start = _osborne_scaling(M)
    if len(M) == 1:
        return start
    size = float(scaled_norm(M, start))
    # BFGS ends well at kinks too, where two singular values are the largest.
    found = minimize(_norm_and_slope, start[:-1] - start[-1], (M,), "BFGS", jac=True, options={"gtol": 1e-9 * size})
    return np.append(found.x, 0.0) if found.fun < size else start


def _norm_and_slope(free: np.ndarray, M: np.ndarray) -> tuple[float, np.ndarray]:
    """σ = σ_max(D M D⁻¹) and ∂σ/∂log D_i = σ (|u_i|² - |v_i|²), (m - 1,): its singular vectors are u, v; D_m = 1."""
    D = np.exp(np.append(free, 0.0))
    u, sizes, v = np.linalg.svd(D[:, None] * M / D)
    return float(sizes[0]), sizes[0] * (np.abs(u[:-1, 0]) ** 2 - np.abs(v[0, :-1]) ** 2)


def _loop_margin(game: Game, K: np.ndarray, i: int, largest: float) -> LoopMargin:
    """largest: |S_ii - 1/2| at its peak; S_ii = 1/(1 + L_i)."""
    others = [j for j in range(game.B.shape[1]) if j != i]
    loop = Loop(game.A - game.B[:, others] @ K[others], game.B[:, i], K[i])
    real = loop.real_responses()
    gains = 1.0 / -real[real < 0.0]
    phases = np.abs(np.angle(-loop.unit_responses(), deg=True))
    disk = min(1.0 / largest, DISK_AT_INFINITY)
    return LoopMargin(
        gain_low=float(gains[(gains < 1.0) & (gains > ROUNDING)].max(initial=0.0)),
        gain_high=float(gains[gains > 1.0].min(initial=math.inf)),
        phase=float(phases.min(initial=math.inf)),
        disk=disk,
        disk_gain=_disk_gain(disk),
        disk_phase=_disk_phase(disk),
    )


def _grid(game: Game, K: np.ndarray) -> np.ndarray:
    closed = spectrum(game.A - game.B @ K)
    if closed.abscissa >= 0.0:
        raise NoSolutionError(f"A - B K has abscissa {closed.abscissa:+.4g} rad/s: an unstable loop has no margins")
    both = np.concatenate([closed.eigenvalues, np.linalg.eigvals(game.A)])
    return frequency_grid(both)


def _balanced_sensitivity(game: Game, K: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """S(jω) - I/2 = I/2 - K (jω I - A + B K)⁻¹ B, (N, m, m): mode by mode where the modes are well conditioned."""
    loop, half = game.A - game.B @ K, 0.5 * np.eye(game.B.shape[1])
    poles, modes = np.linalg.eig(loop)
    if np.linalg.cond(modes) < WELL_CONDITIONED:
        decays = 1.0 / (1j * frequencies[:, None] - poles)
        return half - ((K @ modes) * decays[:, None, :]) @ np.linalg.solve(modes, game.B)
    resolvent = 1j * frequencies[:, None, None] * np.eye(len(loop)) - loop
    return half - K @ np.linalg.solve(resolvent, np.broadcast_to(game.B, (len(frequencies), *game.B.shape)))


def scaled_norm(M: np.ndarray, log_D: np.ndarray) -> np.ndarray:
    """σ_max(D M D⁻¹) of one matrix or of a stack (..., m, m) with its scalings (..., m)."""
    scaled = np.exp(log_D[..., :, None] - log_D[..., None, :]) * M
    return np.asarray(np.linalg.norm(scaled, 2, axis=(-2, -1)))


def _osborne_scaling(M: np.ndarray) -> np.ndarray:
    """log D that equalises the norms of the rows and columns of D M D⁻¹ off the diagonal: a good start.

    M: (..., m, m), one matrix or a stack; returns (..., m).
    """
    m = M.shape[-1]
    off = np.abs(M) ** 2 * (1.0 - np.eye(m))
    log_D = np.zeros(M.shape[:-1])
    for _ in range(SWEEPS):
        for i in range(m):
            weights = np.exp(2.0 * (log_D - log_D[..., i : i + 1]))
            row, column = (off[..., i, :] / weights).sum(axis=-1), (off[..., :, i] * weights).sum(axis=-1)
            both = (row > 0.0) & (column > 0.0)
            ratio = np.divide(column, row, out=np.ones_like(row), where=both)
            log_D[..., i] += 0.25 * np.log(np.where(both, ratio, 1.0))
    return np.asarray(log_D - log_D.mean(axis=-1, keepdims=True))


def _disk_gain(alpha: float) -> float:
    return (2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf


def _disk_phase(alpha: float) -> float:
    return math.degrees(2.0 * math.atan(alpha / 2.0))
