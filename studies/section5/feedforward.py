"""Feedforward of the game for a known reference, which is added to u = -K z.

With z = x - x_d and r(t) = A x_d - x_d', the error obeys z' = A z + B u + E d + r(t). The value of
the game is V = z'P z + 2 s'z + c with

    -s' = (A - S P)' s + P r,    grad V = 2 (P z + s),
    u = -R⁻¹B'(P z + s),         d = δ⁻²E'(P z + s).

s is the bounded solution (Athans and Falb, Optimal Control, Section 9.9, with S in place of
B R⁻¹B').
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
    """Reference x_d = C w of a linear system w' = Ω w with w(0) = w0.

    Sums of constants, ramps and sinusoids are such references.

    omega: (p, p)
    C: (n, p)
    w0: (p,)
    """

    omega: np.ndarray
    C: np.ndarray
    w0: np.ndarray

    def state(self, t: float) -> np.ndarray:
        """Return the state w(t) = exp(Ω t) w0, (p,), at time t in s."""
        from scipy.linalg import expm

        return expm(self.omega * t) @ self.w0

    def forcing(self, A: np.ndarray) -> np.ndarray:
        """Return G = A C - C Ω, (n, p), with which r = A x_d - x_d' = G w."""
        return A @ self.C - self.C @ self.omega


def exosystem(
    constant: np.ndarray, slope: np.ndarray, *harmonics: tuple[float, np.ndarray, np.ndarray]
) -> Exosystem:
    """Return the linear system of x_d(t) = constant + slope t + Σ sine sin(f t) + cosine cos(f t).

    The state is w = [1, t, sin f t, cos f t, ...].

    constant, slope: (n,)
    harmonics: (f in rad/s, sine (n,), cosine (n,)) of each sinusoid
    """
    from scipy.linalg import block_diag

    waves = [np.array([[0.0, frequency], [-frequency, 0.0]]) for frequency, _, _ in harmonics]
    omega = block_diag(np.array([[0.0, 0.0], [1.0, 0.0]]), *waves)
    columns = [constant, slope, *(each for _, *both in harmonics for each in both)]
    return Exosystem(
        omega, np.column_stack(columns), np.array([1.0, 0.0] + [0.0, 1.0] * len(harmonics))
    )


def exosystem_feedforward(game: Game, P: np.ndarray, reference: Exosystem) -> np.ndarray:
    """Return the solution P_s, (n, p), of a Sylvester equation, for the s = P_s w of this module.

        (A - S P)'P_s + P_s Ω + P (A C - C Ω) = 0

    P: (n, n), for which A - S P is Hurwitz

    Raises BadInputError if the reference has another number of states than the game, if A - S P is
    not Hurwitz, or if the reference grows at least as fast as the closed loop decays. In the last
    case, there is no bounded solution. Source: Francis, SIAM J. Control Optim. 15 (1977), the
    regulator equation of the costate.
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
    """Return the decay rate -max Re λ of the closed loop, 1/s.

    loop: A - S P

    Raises BadInputError unless the decay rate is positive.
    """
    abscissa = spectrum(loop).abscissa
    if abscissa >= 0.0:
        raise BadInputError(
            f"A - S P has abscissa {abscissa:+.4g} 1/s; give the stabilizing P of the game"
        )
    return -abscissa
