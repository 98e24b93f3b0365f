"""Where the response of a loop is real, and where its size is one: what classical margins are made of.

L(jω) = c (jω I - A)⁻¹ b = -c (jω I + A) (ω² I + A²)⁻¹ b. Frequencies come from eigenvalues, not from a grid, and are
polished on the response itself, so that badly conditioned ones are accepted only where the response says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from verification.riccati.spectrum import balanced

#: How near to the axis an eigenvalue must lie to be tried, and a polished response to its condition to be taken.
_NEAR, _MET = 1e-3, 1e-9
_STEPS = 20


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
