"""Exact feedforward of a game for a reference that is known in advance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, identity
from controller.riccati.gare import Solution
from hfa_aircraft.waveform import Harmonic, Waveform
from hfa_support.errors import BadInputError


@dataclass(frozen=True, eq=False)
class Feedforward:
    """Policies of the game of tracking a reference x_d(t), u = -K z + u_d(t).

    With z = x - x_d and r = A x_d - x_d', the error obeys z' = A z + B u + E d + r(t). The value is
    V = z'Pz + 2 s'z + c, with the bounded solution s(t) of

        -s' = (A - S P)'s + P r,   -c' = 2 s'r - s'S s,
        u = -R⁻¹(B'(P z + s) + N'z),   d = δ⁻²E'(P z + s).

    solution: of the game of regulation
    reference: x_d, (n,)
    forcing: r, (n,)
    costate: s, (n,)

    Source: Athans and Falb, Optimal Control, Section 9.9, with S in place of B R⁻¹B'.
    """

    solution: Solution
    reference: Waveform
    forcing: Waveform
    costate: Waveform

    @property
    def game(self) -> Game:
        """The game of regulation."""
        return self.solution.game

    @property
    def inputs(self) -> Waveform:
        """Feedforward u_d = -R⁻¹B's, (m,), of the inputs."""
        return self.costate.through(-self.game.R_inverse_B_transposed)


def forcing(A: np.ndarray, reference: Waveform) -> Waveform:
    """Return r = A x_d - x_d', (n,), the effect of a reference x_d on the rate of the error z.

    A: (n, n)
    """
    return reference.through(A) + reference.rate().through(-np.eye(len(A)))


def particular(M: np.ndarray, forcing: Waveform) -> Waveform:
    """Return the solution w(t), (n,), of w' = M w + f(t) that has the form of f.

    With a Hurwitz M, or -M, this is the only solution that grows no faster than f. The sinusoid
    Re(ρ exp(jωt)) of f has Re(σ exp(jωt)) in w, (jω I - M) σ = ρ, and the ramp f_0 + f_1 t has
    w_0 + w_1 t, M w_1 = -f_1, M w_0 = w_1 - f_0.

    M: (n, n), without an eigenvalue 0 or ±jω
    forcing: f, (n,)
    """
    slope = -np.linalg.solve(M, forcing.slope)
    constant = np.linalg.solve(M, slope - forcing.constant)
    identity = np.eye(len(M))
    waves = []
    for wave in forcing.harmonics:
        # sine sin(ωt) + cosine cos(ωt) = Re((cosine - j sine) exp(jωt))
        phasor = np.linalg.solve(1j * wave.frequency * identity - M, wave.cosine - 1j * wave.sine)
        waves.append(Harmonic(wave.frequency, -phasor.imag, phasor.real))
    return Waveform(constant, slope, tuple(waves))


def feedforward(solution: Solution, reference: Waveform) -> Feedforward:
    """Return the exact feedforward of a game for a reference of its states.

    The costate is computed in the states of `Solution.level`, where its loop keeps its digits.

    Raises BadInputError if the game is in discrete time, or if the reference has another number of
    states than the game.
    """
    game, level = solution.game, solution.level
    game.refuse_steps("a reference")
    if reference.size != len(game.A):
        raise BadInputError(
            f"the reference has {reference.size} states; the game has {len(game.A)}"
        )
    r = forcing(game.A, reference)
    minus_P_r = r.through(-level.rows(solution.enclosure.P).T)
    costate_in_level = particular(-level.worst_loop.T, minus_P_r)
    to_level = level.columns(np.eye(len(game.A)))
    return Feedforward(solution, reference, r, costate_in_level.through(to_level.T))


def late_error(exact: Feedforward, K: np.ndarray, inputs: Waveform) -> Waveform:
    """Return the error z(t), (n,), of z' = (A - B K) z + B inputs + r after the transients.

    K: (m, n)
    inputs: (m,)
    """
    solution = exact.solution
    level = solution.level
    loop = level.with_gain(ball_matrix(K))
    to_level, from_level = level.columns(np.eye(len(loop))), level.rows(identity(len(loop)))
    forcing_in_level = inputs.through(level.inputs) + exact.forcing.through(to_level)
    return particular(loop, forcing_in_level).through(from_level)
