"""The exact answer to a known reference: the feedforward that the game adds to u = -K z.

With z = x - x_d and r(t) = A x_d - x_d' the error obeys z' = A z + B u + E d + r(t), and the value of the game
is V = z'P z + 2 s'z + c with

    -s' = (A - S P)' s + P r,    grad V = 2 (P z + s),    u = -R⁻¹B'(P z + s),    d = δ⁻²E'(P z + s),

s being the bounded solution (Athans and Falb, Optimal Control, Section 9.9, with S in place of B R⁻¹B').
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES
from verification.riccati.spectrum import spectrum


@dataclass(frozen=True, eq=False)
class Exosystem:
    """A reference made by a linear system: w' = Ω w, w(0) = w0, x_d = C w.

    omega: (p, p), C: (n, p), w0: (p,). Constants, ramps and sinusoids together are one such system.
    """

    omega: np.ndarray
    C: np.ndarray
    w0: np.ndarray

    def state(self, t: float) -> np.ndarray:
        """w(t) = exp(Ω t) w0, (p,)."""
        from scipy.linalg import expm

        return expm(self.omega * t) @ self.w0

    def reference(self, t: float) -> np.ndarray:
        """x_d(t), (n,)."""
        return self.C @ self.state(t)

    def forcing(self, A: np.ndarray) -> np.ndarray:
        """G with r = G w:  G = A C - C Ω, (n, p)."""
        return A @ self.C - self.C @ self.omega


def exosystem(
    constant: np.ndarray, slope: np.ndarray, sine: np.ndarray, cosine: np.ndarray, frequency: float
) -> Exosystem:
    """x_d(t) = constant + slope t + sine sin(f t) + cosine cos(f t), each (n,), f in rad/s.

    w = [1, t, sin f t, cos f t]; Ω is nilpotent on the first two, which a Sylvester equation does not mind.
    """
    omega = np.zeros((4, 4))
    omega[1, 0] = 1.0
    omega[2, 3], omega[3, 2] = frequency, -frequency
    return Exosystem(omega, np.column_stack([constant, slope, sine, cosine]), np.array([1.0, 0.0, 0.0, 1.0]))


def paper_reference() -> Exosystem:
    """x_d(t) = [7 + 0.01 t + 2 sin 0.5 t, 0.1, 0, 0, 0.5, 0], ft/s and rad (paper Section 5.1)."""
    constant, slope, sine = np.zeros((3, len(LINEAR_STATES)))
    speed, alpha, dihedral = (LINEAR_STATES.index(name) for name in ("speed", "alpha", "dihedral"))
    constant[[speed, alpha, dihedral]] = 7.0, 0.1, 0.5
    slope[speed], sine[speed] = 0.01, 2.0
    return exosystem(constant, slope, sine, np.zeros_like(sine), 0.5)


def exosystem_feedforward(game: Game, P: np.ndarray, reference: Exosystem) -> np.ndarray:
    """P_s with s = P_s w:  (A - S P)'P_s + P_s Ω + P (A C - C Ω) = 0, (n, p).

    P: (n, n), with A - S P Hurwitz.  Raises BadInputError when the reference has another number of states than
    the game, or grows as fast as the closed loop decays, so that no bounded answer exists.
    Source: Francis, SIAM J. Control Optim. 15 (1977), the regulator equation of the costate.
    """
    from scipy.linalg import solve_sylvester

    if len(reference.C) != len(game.A):
        raise BadInputError(f"the reference has {len(reference.C)} states; the game has {len(game.A)}")
    loop = game.A - game.S @ P
    decay, growth = _decay(loop), spectrum(reference.omega).abscissa
    if growth >= decay:
        raise BadInputError(
            f"the reference grows at {growth:.4g} rad/s, the closed loop decays at {decay:.4g} rad/s: "
            "give a reference that grows more slowly"
        )
    return solve_sylvester(loop.T, reference.omega, -P @ reference.forcing(game.A))


@dataclass(frozen=True, eq=False)
class SampledFeedforward:
    """s at the times of the samples, (N,) and (N, n); between them s is interpolated linearly."""

    times: np.ndarray
    s: np.ndarray

    def __call__(self, t: float) -> np.ndarray:
        """s(t), (n,); constant outside the samples."""
        return np.array([np.interp(t, self.times, column) for column in self.s.T])


def sampled_feedforward(game: Game, P: np.ndarray, times: np.ndarray, samples: np.ndarray) -> SampledFeedforward:
    """s of a reference given by samples: x_d linear between them, and held at the last one for ever after.

    times: (N,) increasing, s; samples x_d: (N, n); P: (n, n) with A - S P Hurwitz. The equation of s is
    integrated backward (where it is stable) from its constant solution at the end, exactly over each interval:
    r is linear there. A jump of x_d' makes r jump, which is how a corner of the reference is felt.
    Raises BadInputError when times or samples have the wrong shape, order or numbers.
    """
    from scipy.linalg import expm

    times, samples = _checked_samples(game, times, samples)
    n, loop = len(game.A), game.A - game.S @ P
    _decay(loop)
    s = np.empty_like(samples)
    s[-1] = -np.linalg.solve(loop.T, P @ game.A @ samples[-1])
    # Backward in τ = t_{k+1} - t:  ds/dτ = F's + P r,  dr/dτ = -ρ,  dρ/dτ = 0.
    rate = np.zeros((3 * n, 3 * n))
    rate[:n, :n], rate[:n, n : 2 * n], rate[n : 2 * n, 2 * n :] = loop.T, P, -np.eye(n)
    steps = np.diff(times)
    propagators = {step: expm(rate * step)[:n] for step in np.unique(steps)}
    for k in range(len(steps) - 1, -1, -1):
        slope = (samples[k + 1] - samples[k]) / steps[k]
        end = np.concatenate([s[k + 1], game.A @ samples[k + 1] - slope, game.A @ slope])
        s[k] = propagators[steps[k]] @ end
    return SampledFeedforward(times, s)


def _decay(loop: np.ndarray) -> float:
    """-abscissa of A - S P, positive or the feedforward is not defined."""
    abscissa = spectrum(loop).abscissa
    if abscissa >= 0.0:
        raise BadInputError(f"A - S P has abscissa {abscissa:+.4g} rad/s; give the stabilizing P of the game")
    return -abscissa


def _checked_samples(game: Game, times: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    times, samples = np.array(times, dtype=float), np.array(samples, dtype=float)
    n = len(game.A)
    if times.ndim != 1 or len(times) < 2 or samples.shape != (len(times), n):
        raise BadInputError(
            f"the reference has times of shape {times.shape} and samples of shape {samples.shape}; "
            f"give (N,) and (N, {n}) with N at least 2"
        )
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(samples))):
        raise BadInputError("the reference has entries that are not finite")
    if np.any(np.diff(times) <= 0.0):
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise BadInputError(f"the times of the reference do not increase at sample {row} (t = {times[row]:g} s)")
    return times, samples
