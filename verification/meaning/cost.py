"""What a pair of linear policies costs: by a Lyapunov equation, and integrated over time."""

from __future__ import annotations

import math

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.reporting.checks import Check, at_most
from hfa_model.support.errors import NoSolutionError
from verification.riccati.spectrum import is_hurwitz, spectrum

COST_TOLERANCE = 1e-8
#: Time constants of the slowest mode until a quadratic cost has spent all but e^-40 of itself.
TIME_CONSTANTS = 20.0


def cost_matrix(game: Game, K: np.ndarray, L: np.ndarray) -> np.ndarray:
    """X with cost z0'X z0 of u = -K z, d = L z:  F'X + X F + Q + K'R K - δ² L'L = 0,  F = A - B K + E L.

    K: (m, n); L: (k, n); X: (n, n).  Raises NoSolutionError when F is not Hurwitz: the cost is not finite.
    """
    from scipy.linalg import solve_continuous_lyapunov

    loop, _ = _stable_loop(game, K, L)
    price = 0.0 if math.isinf(game.delta) else game.delta**2
    X = solve_continuous_lyapunov(loop.T, -(game.Q + K.T @ game.R @ K - price * L.T @ L))
    return (X + X.T) / 2.0


def simulated_cost(game: Game, K: np.ndarray, L: np.ndarray, initial: np.ndarray) -> float:
    """J = ∫ z'Qz + u'Ru - δ² d'd dt of u = -K z, d = L z from z(0) = initial, (n,), until the state has died out.

    Integrated over time with transition matrices, which are exact: z(t) = Φ(t) z(0) and J(t) = z(0)'X(t) z(0) go on
    by Φ(2t) = Φ(t)², X(2t) = X(t) + Φ(t)'X(t) Φ(t), from a step in which no mode moves far.
    Raises NoSolutionError when A - B K + E L is not Hurwitz.
    Source: Van Loan, IEEE Trans. Automatic Control 23 (1978), for the first step.
    """
    from scipy.linalg import block_diag, expm

    F, abscissa = _stable_loop(game, K, L)
    n, price = len(F), 0.0 if math.isinf(game.delta) else game.delta**2  # no disturbance, no pay-off: inf * 0 is 0
    policies = np.vstack([np.eye(n), -K, L])
    running = policies.T @ block_diag(game.Q, game.R, -price * np.eye(len(L))) @ policies
    end, time = TIME_CONSTANTS / -abscissa, 1.0 / float(np.linalg.norm(F, 1))
    step = expm(np.block([[-F.T, running], [np.zeros_like(F), F]]) * time)
    transition = step[n:, n:]
    X = transition.T @ step[:n, n:]
    while time < end:
        X = X + transition.T @ X @ transition
        transition = transition @ transition
        time *= 2.0
    return float(initial @ X @ initial)


def cost_checks(game: Game, P: np.ndarray, initial: np.ndarray) -> tuple[Check, ...]:
    """The policies of P cost z0'P z0, by a Lyapunov equation and integrated over time from z0 = initial, (n,)."""
    K, L = game.gain(P), game.disturbance_gain(P)
    claimed = float(initial @ P @ initial)
    if not is_hurwitz(game.A - game.B @ K + game.E @ L):
        reason = "the policies of P do not bring the state to rest: their cost is not finite"
        return tuple(at_most(name, math.inf, COST_TOLERANCE, reason) for name in ("cost_lyapunov", "cost_simulated"))
    costs = {
        "cost_lyapunov": float(initial @ cost_matrix(game, K, L) @ initial),
        "cost_simulated": simulated_cost(game, K, L, initial),
    }
    return tuple(
        at_most(
            name,
            abs(cost - claimed) / max(abs(claimed), np.finfo(float).tiny),
            COST_TOLERANCE,
            f"the policies of P cost {cost:.10g} where P claims {claimed:.10g}",
        )
        for name, cost in costs.items()
    )


def _stable_loop(game: Game, K: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, float]:
    """A - B K + E L and its abscissa, rad/s."""
    loop = game.A - game.B @ K + game.E @ L
    abscissa = spectrum(loop).abscissa
    if abscissa >= 0.0:
        raise NoSolutionError(
            f"A - B K + E L has abscissa {abscissa:+.4g} rad/s: the cost of these policies is infinite"
        )
    return loop, abscissa
