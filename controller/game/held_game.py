"""The game at which a policy flies: inputs held over samples, commands that act late."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.matrices import of_step, spectral_abscissa

#: Largest logarithm of the growth of a mode in a sample: the weights of the held game grow with its
#: square, and rounding then changes the value by about 1 %.
MOST_GROWTH = 16.0


def held(game: Game, rate: float | None, delay: float = 0.0) -> Game:
    """Return the game in discrete time of inputs that are held, and act after a delay; the same
    game without a rate.

      x⁺ = Φ x + Γ u_(k-n) + E d,  J = Σ ∫ (z'Qz + 2z'Nu + u'Ru) dt - δ² dt d'd

    The states are z and the n commands under way, the oldest first. The disturbance is held too;
    what it adds to the cost within its own step is left out.

    rate: samples a second
    delay: time from a sample to the effect of its command, s

    Raises BadInputError if the delay is not a whole number of samples, or a mode grows too much in
    a sample, and as `Game.sampled` does.
    """
    if rate is None:
        if delay:
            raise BadInputError(f"a delay of {delay:g} s requires a rate, the samples a second")
        return game
    refuse_unless_positive("rate", rate, " 1/s")
    dt = 1.0 / rate
    step = game.sampled(dt)
    n, m = game.B.shape
    count = round(delay / dt)
    if not (math.isfinite(delay) and math.isclose(count * dt, delay, rel_tol=1e-9)):
        raise BadInputError(
            f"the delay is {delay:g} s, not a whole number of samples of {dt:g} s; give "
            f"{max(count, 1) * dt:g} s, or another rate"
        )
    growth = spectral_abscissa(game.A) * dt
    if growth > MOST_GROWTH:
        raise BadInputError(
            f"a mode grows by e^{growth:.3g} in a sample of {dt:g} s, and doubles lose the game of"
            f" such samples; give a rate of at least {1.01 * rate * growth / MOST_GROWTH:.3g} 1/s"
        )
    held_inputs = np.block([[game.A, game.B], [np.zeros((m, n + m))]])
    _, weights = of_step(held_inputs.T, game.weights, dt)  # ∫ e^(M't) W e^(Mt) dt
    weights = (weights + weights.T) / 2.0
    held_game = replace(step, Q=weights[:n, :n], N=weights[:n, n:], R=weights[n:, n:])
    for age in range(count, 0, -1):
        held_game = _a_sample_later(held_game, age)
    return held_game


def _a_sample_later(game: Game, age: int) -> Game:
    """Return a game whose inputs act a sample later: a command is a state, then it acts.

    age: of the command when it acts, in samples
    """
    n, m = game.B.shape
    names = game.names
    older = tuple(f"{name}_{age}_before" for name in names.inputs)
    return replace(
        game,
        A=np.block([[game.A, game.B], [np.zeros((m, n + m))]]),
        B=np.vstack([np.zeros((n, m)), np.eye(m)]),
        E=np.pad(game.E, [(0, m), (0, 0)]),
        Q=game.weights,
        R=np.zeros((m, m)),
        N=np.zeros((n + m, m)),
        names=names._replace(
            states=names.states + older, state_units=names.state_units + names.input_units
        ),
        half_widths=None,
    )
