"""The exact answer to a known reference: the feedforward that the game adds to u = -K z.

With z = x - x_d and r(t) = A x_d - x_d' the error obeys z' = A z + B u + E d + r(t), and the value
of the game is V = z'P z + 2 s'z + c with

    -s' = (A - S P)' s + P r,    grad V = 2 (P z + s),
    u = -R⁻¹B'(P z + s),         d = δ⁻²E'(P z + s).

s is the bounded solution (Athans and Falb, Optimal Control, Section 9.9, with S in place of B
R⁻¹B').
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Reported


@dataclass(frozen=True, eq=False, repr=False)
class Exosystem(Reported):
    """A reference made by a linear system: w' = Ω w, w(0) = w0, x_d = C w.

    Constants, ramps and sinusoids together are one such system.

    omega: (p, p)
    C: (n, p)
    w0: (p,)
    """

    omega: np.ndarray
    C: np.ndarray
    w0: np.ndarray

    def state(self, t: float) -> np.ndarray:
        """Return w(t) = exp(Ω t) w0, (p,)."""
        from scipy.linalg import expm

        return expm(self.omega * t) @ self.w0

    def forcing(self, A: np.ndarray) -> np.ndarray:
        """Return G with r = G w:  G = A C - C Ω, (n, p)."""
        return A @ self.C - self.C @ self.omega


def exosystem(
    constant: np.ndarray, slope: np.ndarray, *harmonics: tuple[float, np.ndarray, np.ndarray]
) -> Exosystem:
    """Return the system of x_d(t) = constant + slope t + Σ sine sin(f t) + cosine cos(f t), each
    (n,).

    w = [1, t, sin f t, cos f t, ...]. Ω is nilpotent on the first two, which a Sylvester equation
    permits.

    harmonics: (f in rad/s, sine, cosine) each
    """
    from scipy.linalg import block_diag

    waves = [np.array([[0.0, frequency], [-frequency, 0.0]]) for frequency, _, _ in harmonics]
    omega = block_diag(np.array([[0.0, 0.0], [1.0, 0.0]]), *waves)
    columns = [constant, slope, *(each for _, *both in harmonics for each in both)]
    return Exosystem(
        omega, np.column_stack(columns), np.array([1.0, 0.0] + [0.0, 1.0] * len(harmonics))
    )


def exosystem_feedforward(game: Game, P: np.ndarray, reference: Exosystem) -> np.ndarray:
    """Return P_s with s = P_s w, (n, p).

        (A - S P)'P_s + P_s Ω + P (A C - C Ω) = 0

    P: (n, n), with A - S P Hurwitz

    Raises BadInputError when the reference has another number of states than the game, or grows as
    fast as the closed loop decays, so that no bounded answer exists. Source: Francis, SIAM J.
    Control Optim. 15 (1977), the regulator equation of the costate.
    """
    from scipy.linalg import solve_sylvester

    if len(reference.C) != len(game.A):
        raise BadInputError(
            f"the reference has {len(reference.C)} states; the game has {len(game.A)}"
        )
    loop = game.A - game.S @ P
    decay = _decay(loop)
    growth = spectrum(reference.omega).abscissa
    if growth >= decay:
        raise BadInputError(
            f"the reference grows at {growth:.4g} rad/s, the closed loop decays at {decay:.4g}"
            " rad/s: give a reference that grows more slowly"
        )
    return solve_sylvester(loop.T, reference.omega, -P @ reference.forcing(game.A))


def _decay(loop: np.ndarray) -> float:
    """Return -abscissa of A - S P. It must be positive for the feedforward to be defined."""
    abscissa = spectrum(loop).abscissa
    if abscissa >= 0.0:
        raise BadInputError(
            f"A - S P has abscissa {abscissa:+.4g} 1/s; give the stabilizing P of the game"
        )
    return -abscissa
