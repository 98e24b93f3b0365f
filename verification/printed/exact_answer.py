"""The exact answer of a plant as typed, and how it changes with an entry of the plant."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from controller.game.discrete_game import DiscreteGame
from controller.game.zero_sum import Game
from controller.riccati.discrete import solve_discrete
from controller.riccati.gare import solve_game
from hfa_support.errors import NoSolutionError

#: Newton steps after the Schur form of `quick_value`.
_REFINEMENTS = 1
#: Eigenvalues this close to the edge of stability do not count as stable.
_EDGE = 1e-12


@dataclass(frozen=True, eq=False)
class Plant:
    """x' = A x + B u + E w or x⁺ = A x + B u + E w, and the cost x'Qx + 2x'Nu + u'Ru - γ²w'w.

    A: (n, n)
    B: (n, m)
    E: (n, k); k = 0 where there is no disturbance
    N: (n, m)
    Q: (n, n)
    R: (m, m)
    gamma: inf where there is no disturbance
    is_discrete: the time
    discount: α, of one step
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    N: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    gamma: float
    is_discrete: bool = False
    discount: float = 1.0

    @cached_property
    def G(self) -> np.ndarray:
        """[B E], (n, m + k)."""
        return np.hstack([self.B, self.E])

    @cached_property
    def S(self) -> np.ndarray:
        """[N 0], (n, m + k)."""
        return np.hstack([self.N, np.zeros_like(self.E)])

    @cached_property
    def W(self) -> np.ndarray:
        """blkdiag(R, -γ² I), (m + k, m + k)."""
        m = len(self.R)
        weights = np.zeros((self.G.shape[1],) * 2)
        weights[:m, :m] = self.R
        k = self.E.shape[1]
        if k:
            weights[m:, m:] = -(self.gamma**2) * np.eye(k)
        return weights

    def game(self) -> Game | DiscreteGame:
        """As a value of `controller.game`; of continuous time in v = u + R⁻¹N'x."""
        E = self.E
        if not E.shape[1]:
            E = np.zeros((len(self.A), 1))
        if self.is_discrete:
            step = Game(self.A, self.B, E, self.Q, self.R, self.gamma)
            return DiscreteGame(step, self.discount, self.N)
        feed = np.linalg.solve(self.R, self.N.T)
        Q = self.Q - self.N @ feed
        return Game(self.A - self.B @ feed, self.B, E, Q, self.R, self.gamma)

    def with_entry(self, name: str, row: int, column: int, value: float) -> Plant:
        """The plant with another entry; of Q and R its mirror too."""
        if name == "gamma":
            return replace(self, gamma=value)
        matrix = getattr(self, name).copy()
        matrix[row, column] = value
        if name in ("Q", "R"):
            matrix[column, row] = value
        changes: dict[str, Any] = {name: matrix}
        return replace(self, **changes)


def certified_value(plant: Plant) -> np.ndarray:
    """P, (n, n), by two derivations. NoSolutionError where there is none."""
    game = plant.game()
    if isinstance(game, DiscreteGame):
        return solve_discrete(game).P
    return solve_game(game).P


def quick_value(plant: Plant) -> np.ndarray:
    """P, (n, n), refined and with a stable loop, but not certified: for a search.

    NoSolutionError where there is none."""
    from scipy.linalg import solve_continuous_are, solve_discrete_are

    root = math.sqrt(plant.discount)
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
            if plant.is_discrete:
                P = solve_discrete_are(root * plant.A, root * plant.G, plant.Q, plant.W, s=plant.S)
            else:
                P = solve_continuous_are(plant.A, plant.G, plant.Q, plant.W, s=plant.S)
            for _ in range(_REFINEMENTS):
                P = P + _lyapunov(plant, _loop(plant, P), _residual(plant, P))
            eigenvalues = np.linalg.eigvals(_loop(plant, P))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError("no stable subspace") from error
    edge = root * np.abs(eigenvalues).max() - 1.0 if plant.is_discrete else eigenvalues.real.max()
    if not edge < -_EDGE:
        raise NoSolutionError("the loop is not stable")
    return np.asarray(P)


def policies(plant: Plant, P: np.ndarray) -> np.ndarray:
    """[K; -L], (m + k, n), of u = -K x and w = L x."""
    G = plant.G
    if plant.is_discrete:
        weights = plant.W + plant.discount * G.T @ P @ G
        return np.linalg.solve(weights, plant.discount * G.T @ P @ plant.A + plant.S.T)
    return np.linalg.solve(plant.W, G.T @ P + plant.S.T)


def answer_of(plant: Plant, P: np.ndarray) -> dict[str, np.ndarray]:
    """P, K, L, W and, in discrete time, H of the value x'P x."""
    gains = policies(plant, P)
    m = len(plant.R)
    answer = {"P": P, "K": gains[:m], "L": -gains[m:], "W": weights_of(P)}
    if plant.is_discrete:
        moved = np.hstack([plant.A, plant.G])
        weights = np.block([[plant.Q, plant.S], [plant.S.T, plant.W]])
        answer["H"] = weights + plant.discount * moved.T @ P @ moved
    return answer


def weights_of(P: np.ndarray) -> np.ndarray:
    """W, (1, n(n+1)/2), with x'P x = W'(x1², x1 x2, ..., xn²)."""
    row, column = np.triu_indices(len(P))
    factors = np.where(row == column, 1.0, 2.0)
    return (factors * P[row, column])[None, :]


def answer_change(
    plant: Plant, P: np.ndarray, name: str, row: int, column: int
) -> Mapping[str, np.ndarray]:
    """The derivatives of `answer_of` with an entry of the plant; of Q and R with its mirror.

    The policies are stationary, so that dP solves Lyapunov's equation of the closed loop."""
    zero = replace(
        plant, **{key: np.zeros_like(getattr(plant, key)) for key in "ABENQR"}, gamma=0.0
    )
    unit = zero if name == "gamma" else zero.with_entry(name, row, column, 1.0)
    dW = unit.W
    m = len(plant.R)
    if name == "gamma":
        dW[m:, m:] = -2.0 * plant.gamma * np.eye(plant.E.shape[1])
    G = plant.G
    dG = unit.G
    gains = policies(plant, P)
    F = plant.A - G @ gains
    dF = unit.A - dG @ gains
    cost = unit.Q - unit.S @ gains - gains.T @ unit.S.T + gains.T @ dW @ gains
    factor = plant.discount * F.T if plant.is_discrete else np.eye(len(F))
    moved = factor @ P @ dF
    dP = _lyapunov(plant, F, cost + moved + moved.T)
    if plant.is_discrete:
        inner = dG.T @ P @ F + G.T @ dP @ F + G.T @ P @ dF
        weights = plant.W + plant.discount * G.T @ P @ G
        dgains = np.linalg.solve(weights, plant.discount * inner + unit.S.T - dW @ gains)
    else:
        dgains = np.linalg.solve(plant.W, dG.T @ P + G.T @ dP + unit.S.T - dW @ gains)
    change = {"P": dP, "K": dgains[:m], "L": -dgains[m:], "W": weights_of(dP)}
    if plant.is_discrete:
        step = np.hstack([plant.A, G])
        dstep = np.hstack([unit.A, dG])
        crossed = dstep.T @ P @ step
        weights = np.block([[unit.Q, unit.S], [unit.S.T, dW]])
        change["H"] = weights + plant.discount * (crossed + crossed.T + step.T @ dP @ step)
    return change


def _loop(plant: Plant, P: np.ndarray) -> np.ndarray:
    """A - B K + E L, (n, n)."""
    return np.asarray(plant.A - plant.G @ policies(plant, P))


def _residual(plant: Plant, P: np.ndarray) -> np.ndarray:
    """What is left of the Riccati equation at P, (n, n)."""
    gains = policies(plant, P)
    F = plant.A - plant.G @ gains
    cost = plant.Q - plant.S @ gains - gains.T @ plant.S.T + gains.T @ plant.W @ gains
    if plant.is_discrete:
        return np.asarray(cost + plant.discount * F.T @ P @ F - P)
    return np.asarray(cost + F.T @ P + P @ F)


def _lyapunov(plant: Plant, F: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Z with F'Z + Z F + right = 0, in discrete time Z = α F'Z F + right."""
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    symmetric = (right + right.T) / 2.0
    with warnings.catch_warnings(action="ignore"):  # of a loop near the edge of stability
        if plant.is_discrete:
            Z = solve_discrete_lyapunov(math.sqrt(plant.discount) * F.T, symmetric)
        else:
            Z = solve_continuous_lyapunov(F.T, -symmetric)
    return np.asarray(Z + Z.T) / 2.0
