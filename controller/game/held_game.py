"""The game at which a policy flies: inputs held over samples, commands that act late."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError
from hfa_support.matrices import of_step


def held(game: Game, dt: float, delay: float = 0.0) -> Game:
    """Return the game in discrete time of inputs that are held for dt, and act after a delay.

      x⁺ = Φ x + Γ u_(k-n) + E d,  J = Σ ∫ (z'Qz + 2z'Nu + u'Ru) dt - δ² dt d'd

    The states are z and the n commands under way, the oldest first. The disturbance is held too;
    what it adds to the cost within its own step is left out.

    dt: sample time, s
    delay: time from a sample to the effect of its command, s

    Raises BadInputError if the delay is not a whole number of samples, or as `Game.sampled` does.
    """
    step = game.sampled(dt)
    n, m = game.B.shape
    count = round(delay / dt)
    if not (math.isfinite(delay) and math.isclose(count * dt, delay, rel_tol=1e-9)):
        raise BadInputError(
            f"the delay is {delay:g} s, not a whole number of samples of {dt:g} s; give "
            f"{max(count, 1) * dt:g} s, or another rate"
        )
    held_inputs = np.block([[game.A, game.B], [np.zeros((m, n + m))]])
    _, weights = of_step(held_inputs.T, game.weights, dt)  # ∫ e^(M't) W e^(Mt) dt
    weights = (weights + weights.T) / 2.0
    Q, N, R = weights[:n, :n], weights[:n, n:], weights[n:, n:]
    if not count:
        return replace(step, Q=Q, N=N, R=R)

    # The oldest command acts in the step, each other one becomes a sample older.
    under_way = count * m
    A, B = np.zeros((n + under_way,) * 2), np.zeros((n + under_way, m))
    A[:n, :n], A[:n, n : n + m] = step.A, step.B
    A[n : n + under_way - m, n + m :] = np.eye(under_way - m)
    B[n + under_way - m :] = np.eye(m)
    cost = np.zeros_like(A)
    cost[: n + m, : n + m] = weights
    names = game.names
    ages = range(count, 0, -1)
    return replace(
        step,
        A=A,
        B=B,
        E=np.vstack([step.E, np.zeros((under_way, step.E.shape[1]))]),
        Q=cost,
        R=np.zeros((m, m)),
        N=np.zeros(B.shape),
        names=names._replace(
            states=(
                *names.states,
                *(f"{name}_{age}_before" for age in ages for name in names.inputs),
            ),
            state_units=(*names.state_units, *(names.input_units * count)),
        ),
        half_widths=None,
    )
