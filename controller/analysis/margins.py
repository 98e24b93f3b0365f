"""How much gain and phase the loop of one input of a policy u = -K z tolerates, all others closed.

The classical margins are where the response of the loop is real, and where its size is one. L(jω) = c (jω I - A)⁻¹ b =
-c (jω I + A) (ω² I + A²)⁻¹ b: frequencies come from eigenvalues, not from a grid, and are polished on the response
itself, so that badly conditioned ones are accepted only where the response says so. Gains are factors (not dB), phases
degrees, frequencies rad/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced
from controller.riccati.frequency_response import DISK_AT_INFINITY, balanced_sensitivity, disk_sizes, loop_grid

#: A gain below this is a crossover at infinite frequency that rounding moved off zero.
ROUNDING = 1e-12
#: How near to the axis an eigenvalue must lie to be tried, and a polished response to its condition to be taken.
_NEAR, _MET = 1e-3, 1e-9
_STEPS = 20


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


def loop_margins(game: Game, K: np.ndarray) -> tuple[LoopMargin, ...]:
    """Margins of each input, in the order of the inputs. K: (m, n).

    L_i(s) = K_i (sI - A + Σ_{j≠i} B_j K_j)⁻¹ B_i.  Raises NoSolutionError when A - B K is not Hurwitz.
    Source: Blight, Dailey and Gangsaas, Int. J. Control 59 (1994).
    """
    peaks = np.abs(balanced_sensitivity(game, K, loop_grid(game, K))).max(axis=0)
    return tuple(_loop_margin(game, K, i, float(peaks[i, i])) for i in range(game.B.shape[1]))


def _loop_margin(game: Game, K: np.ndarray, i: int, largest: float) -> LoopMargin:
    """largest: |S_ii - 1/2| at its peak; S_ii = 1/(1 + L_i)."""
    others = [j for j in range(game.B.shape[1]) if j != i]
    loop = Loop(game.A - game.B[:, others] @ K[others], game.B[:, i], K[i])
    real = loop.real_responses()
    gains = 1.0 / -real[real < 0.0]
    phases = np.abs(np.angle(-loop.unit_responses(), deg=True))
    disk = min(1.0 / largest, DISK_AT_INFINITY)
    gain, phase = disk_sizes(disk)
    return LoopMargin(
        gain_low=float(gains[(gains < 1.0) & (gains > ROUNDING)].max(initial=0.0)),
        gain_high=float(gains[gains > 1.0].min(initial=math.inf)),
        phase=float(phases.min(initial=math.inf)),
        disk=disk,
        disk_gain=gain,
        disk_phase=phase,
    )


@dataclass(frozen=True, eq=False)
class Loop:
    """L(s) = c (sI - A)⁻¹ b. A: (n, n), b, c: (n,)."""

    A: np.ndarray
    b: np.ndarray
    c: np.ndarray

    def at(self, frequency: float) -> tuple[complex, complex]:
        """L and dL/dω at jω, nan at a pole."""
        resolvent = 1j * frequency * np.eye(len(self.A)) - self.A
        try:
            x = np.linalg.solve(resolvent, self.b)
            return complex(self.c @ x), complex(-1j * self.c @ np.linalg.solve(resolvent, x))
        except np.linalg.LinAlgError:
            return complex(np.nan), complex(np.nan)

    def real_responses(self) -> np.ndarray:
        """L(jω) wherever it is real, ω >= 0: at 0, and where c (A² - s²I)⁻¹ b = 0 at s = jω."""
        from scipy.linalg import eigvals

        n = len(self.A)
        pencil = np.block([[self.A @ self.A, self.b[:, None]], [self.c[None], np.zeros((1, 1))]])
        squares = eigvals(balanced(pencil)[0], np.diag([*np.ones(n), 0.0]))
        candidates = [0.0, *_frequencies(np.emath.sqrt(squares[np.isfinite(squares)]))]

        def met(frequency: float) -> tuple[float, float, float]:
            response, slope = self.at(frequency)
            return response.imag, slope.imag, abs(response)

        return np.array([self.at(each)[0].real for each in _polished(candidates, met)])

    def unit_responses(self) -> np.ndarray:
        """L(jω) wherever |L| = 1, ω >= 0: jω is an eigenvalue of [[A, bb'], [-cc', -A']]."""
        H = np.block([[self.A, np.outer(self.b, self.b)], [-np.outer(self.c, self.c), -self.A.T]])

        def met(frequency: float) -> tuple[float, float, float]:
            response, slope = self.at(frequency)
            return abs(response) ** 2 - 1.0, 2.0 * (np.conj(response) * slope).real, 1.0

        candidates = _frequencies(np.linalg.eigvals(balanced(H)[0]))
        return np.array([self.at(each)[0] for each in _polished(candidates, met)])


def _frequencies(eigenvalues: np.ndarray) -> list[float]:
    """ω >= 0 of the eigenvalues that may lie on the imaginary axis."""
    near = np.abs(eigenvalues.real) <= _NEAR * np.abs(eigenvalues)
    return np.unique(np.abs(eigenvalues[near].imag)).tolist()


def _polished(candidates: list[float], met: Callable[[float], tuple[float, float, float]]) -> list[float]:
    """Where Newton's method on `met` (value, slope, scale) ends near a candidate, and the value is rounding."""
    found = []
    for start in candidates:
        best, least = start, np.inf
        frequency = start
        for _ in range(_STEPS):
            value, slope, scale = met(frequency)
            if not np.isfinite(value) or abs(frequency - start) > _NEAR * max(start, 1e-300):
                break
            if abs(value) < least * scale:
                best, least = frequency, abs(value) / scale
            if value == 0.0 or slope == 0.0 or start == 0.0:
                break
            frequency -= value / slope
        if least <= _MET:
            found.append(best)
    return found
