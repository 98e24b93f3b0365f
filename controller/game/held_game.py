"""The game at which a policy flies: inputs held over samples, commands that act late."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.matrices import of_step, spectral_abscissa
from trim.linear.delays import in_samples

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
    count, rest = in_samples(delay, dt) if 0.0 <= delay < math.inf else (0, delay)
    if rest:
        raise BadInputError(
            f"the delay is {delay:g} s, not a whole number of samples of {dt:g} s; give "
            f"{(count or 1) * dt:g} s, or another rate"
        )
    growth = spectral_abscissa(game.A) * dt
    if growth > MOST_GROWTH:
        raise BadInputError(
            f"a mode grows by e^{growth:.3g} in a sample of {dt:g} s, and doubles lose the game of"
            f" such samples; give a rate of at least {1.01 * rate * growth / MOST_GROWTH:.3g} 1/s"
        )
    n, m = game.B.shape
    held_inputs = np.block([[game.A, game.B], [np.zeros((m, n + m))]])
    _, weights = of_step(held_inputs.T, game.weights, dt)  # ∫ e^(M't) W e^(Mt) dt
    # Of z, the commands under way and the new one, the first command acts. The others move up.
    late, names = count * m, game.names
    weights = np.pad((weights + weights.T) / 2.0, (0, late))
    z, command = slice(n + late), slice(n + late, None)
    moved = np.zeros((n + late, n + late + m))
    moved[:n, : n + m] = np.hstack([step.A, step.B])
    moved[n:, n + m :] = np.eye(late)
    older = (f"{name}_{age}_before" for age in range(count, 0, -1) for name in names.inputs)
    return replace(
        step,
        A=moved[:, z],
        B=moved[:, command],
        E=np.pad(step.E, [(0, late), (0, 0)]),
        Q=weights[z, z],
        R=weights[command, command],
        N=weights[z, command],
        names=names._replace(
            states=(*names.states, *older),
            state_units=names.state_units + count * names.input_units,
        ),
        half_widths=None if count else step.half_widths,
    )
