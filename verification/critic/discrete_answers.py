"""Answers of a linear-quadratic problem in discrete time: right where they come from, others than the game's.

With F = exp([A B; 0 0] dt) = [A_d B_d; 0 I]:  K = (R + B_d'S B_d)⁻¹ B_d'S A_d,  S the solution of the discrete Riccati
equation with Q and R (`dlqr`), or with the cost of the continuous problem between the samples (`lqrd`; Franklin,
Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., Section 9.4). z'S z is a sum over samples, z'S z dt an
integral.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, partial

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from verification.critic.other_games import difference_of, searched

#: s; where the search for a sample time begins.
TIMES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
KINDS = {
    "dlqr": "the discrete-time LQR (dlqr of the plant with a zero-order hold)",
    "euler": "the discrete-time LQR (dlqr of I + A dt, B dt)",
    "lqrd": "the discrete-time LQR with the continuous cost (lqrd)",
}


def discrete_lqr(game: Game, time: float, kind: str = "dlqr") -> tuple[np.ndarray, np.ndarray]:
    """S, (n, n), and K, (m, n), of the LQR (delta = inf) at a sample time, s.

    LinAlgError, ValueError where there is none.
    """
    from scipy.linalg import expm, solve_discrete_are

    if time <= 0.0:
        raise ValueError("a sample time is positive")
    units = balanced_units(game)
    there = in_units(game, units)
    n, m = there.B.shape
    F = np.zeros((n + m, n + m))
    F[:n] = np.hstack([there.A, there.B])
    cost = np.zeros((n + m, n + m))
    cost[:n, :n], cost[n:, n:] = there.Q, there.R
    step = expm(F * time)
    if kind == "euler":
        step = np.eye(n + m) + F * time
    elif kind == "lqrd":  # ∫ exp(F't) cost exp(Ft) dt, by Van Loan
        double = expm(np.block([[-F.T, cost], [np.zeros_like(F), F]]) * time)
        cost = double[n + m :, n + m :].T @ double[: n + m, n + m :]
        cost = (cost + cost.T) / (2.0 * time)
    A, B = step[:n, :n], step[:n, n:]
    Q, R, N = cost[:n, :n], cost[n:, n:], cost[:n, n:]
    S = solve_discrete_are(A, B, Q, R, s=N)
    return S / np.outer(units, units), np.asarray(np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A + N.T) / units)


def discrete_answers(game: Game, P: np.ndarray | None, K: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """What P, (n, n), or without one K, (m, n), may be, with its sample time, and the answer that this is."""
    sums = (False,) if P is None else (False, True)
    lqr = lru_cache(maxsize=100)(partial(discrete_lqr, game))
    for kind, said in KINDS.items():
        for is_sum in sums:

            def answer_at(time: float, kind: str = kind, is_sum: bool = is_sum) -> np.ndarray:
                S, gain = lqr(time, kind)
                return gain if P is None else S if is_sum else S * time

            found = searched(answer_at, list(TIMES), difference_of(game, P, K))
            if found is not None:
                counted = ", a sum over its samples," if is_sum else ""
                yield f"{said}{counted} at dt = {found:.4g} s", answer_at(found)
