"""Exact answer of the plant in a file, and its derivatives with respect to the plant's entries."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.gare import unconfirmed_solution

#: Largest number of doublings of the horizon for an approximate value.
_DOUBLINGS = 30
#: A smaller relative correction is rounding.
_SETTLED = 1e-14


@dataclass(frozen=True, eq=False)
class Plant:
    """Linear plant with a quadratic cost, as stated in a file.

    x' = A x + B u + E w or x⁺ = A x + B u + E w
    cost x'Qx + 2x'Nu + u'Ru - γ²w'w

    A: (n, n)
    B: (n, m)
    E: (n, k), with k = 0 without a disturbance
    N: (n, m)
    Q: (n, n)
    R: (m, m)
    gamma: γ, inf without a disturbance
    is_discrete: whether time is discrete
    discount: factor α on the cost of each further step, in discrete time
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
        """Matrix [B E], (n, m + k)."""
        return np.concatenate([self.B, self.E], axis=-1)

    @cached_property
    def S(self) -> np.ndarray:
        """Matrix [N 0], (n, m + k)."""
        return np.concatenate([self.N, np.zeros_like(self.E)], axis=-1)

    @cached_property
    def W(self) -> np.ndarray:
        """Matrix blkdiag(R, -γ² I), (m + k, m + k)."""
        m = self.R.shape[-1]
        k = self.E.shape[-1]
        weights = np.zeros((*self.R.shape[:-2], m + k, m + k))
        weights[..., :m, :m] = self.R
        if k:
            weights[..., m:, m:] = -(self.gamma**2) * np.eye(k)
        return weights

    def game(self) -> Game:
        """Return the plant as a game."""
        E = self.E
        if not E.shape[1]:
            E = np.zeros((len(self.A), 1))
        return Game(
            self.A,
            self.B,
            E,
            self.Q,
            self.R,
            self.gamma,
            self.N,
            dt=self.is_discrete or None,
            discount=self.discount if self.is_discrete else 1.0,
        )

    def with_entry(self, name: str, row: int, column: int, value: float) -> Plant:
        """Return the plant with one entry changed.

        In Q and R, the mirrored entry is changed too.
        """
        if name == "gamma":
            return replace(self, gamma=value)
        matrix = getattr(self, name).copy()
        matrix[row, column] = value
        if name in ("Q", "R"):
            matrix[column, row] = value
        changes: dict[str, Any] = {name: matrix}
        return replace(self, **changes)

    def stacked(self, name: str, row: int, column: int, values: np.ndarray) -> Plant:
        """Return a stack of plants that differ in the value of one entry.

        A, B, E, N, Q and R of the result have a first axis for the values. If gamma is the changed
        entry, gamma is (count, 1, 1). In Q and R the mirrored entry is changed too.

        name: "A", "B", "E", "N", "Q", "R" or "gamma"
        row, column: position of the entry, ignored for gamma
        values: (count,)
        """
        fields: dict[str, Any] = {}
        for key in "ABENQR":
            matrix = getattr(self, key)
            fields[key] = np.broadcast_to(matrix, (len(values), *matrix.shape)).copy()
        if name == "gamma":
            fields["gamma"] = values[:, None, None]
        else:
            fields[name][:, row, column] = values
        if name in ("Q", "R"):
            fields[name][:, column, row] = values
        return replace(self, **fields)


def certified_value(plant: Plant) -> np.ndarray:
    """Return P (n, n) of the certified value x'P x of a plant.

    Raises NoSolutionError if no solution exists.
    """
    return unconfirmed_solution(plant.game()).P


def rough_values(plants: Plant) -> np.ndarray:
    """Return P (N, n, n) of the values x'P x of a stack of plants, without a check.

    For a plant without a solution, P is arbitrary or nan. With M = (I + S P)⁻¹, each pass

        A <- A M A,  S <- S + A M S A',  P <- P + A'P M A

    doubles the horizon. A plant in continuous time is converted to discrete time by the Cayley
    transformation. Sources: Chu, Fan, Lin and Wang, Int. J. Control 77 (2004), 767-788; in
    continuous time Chu, Fan and Lin, Linear Algebra and its Applications 396 (2005), 55-80.
    """
    G = plants.G
    identity = np.eye(plants.A.shape[-1])
    with np.errstate(all="ignore"):
        inverse = _inverses(plants.W)
        A = plants.A - G @ inverse @ plants.S.mT
        S = G @ inverse @ G.mT
        P = plants.Q - plants.S @ inverse @ plants.S.mT
        if plants.is_discrete:
            A = math.sqrt(plants.discount) * A
            S = plants.discount * S
        else:
            rate = np.linalg.norm(A, axis=(-2, -1), keepdims=True)
            shifted = _inverses(A - rate * identity)
            mixed = _inverses((A - rate * identity).mT + P @ shifted @ S)
            A = identity + 2.0 * rate * mixed.mT
            S = 2.0 * rate * shifted @ S @ mixed
            P = 2.0 * rate * mixed @ P @ shifted
        for _ in range(_DOUBLINGS):
            M = _inverses(identity + S @ P)
            increase = A.mT @ P @ M @ A
            S = S + A @ M @ S @ A.mT
            P = P + (increase + increase.mT) / 2.0
            A = A @ M @ A
            sizes, changes = (np.abs(each).max(axis=(-2, -1)) for each in (P, increase))
            if not (changes > _SETTLED * sizes).any():
                break
    return P


def _inverses(matrices: np.ndarray) -> np.ndarray:
    """Return the inverse of each matrix of a stack, nan for a singular matrix."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(matrices)[0] == 0.0
        return np.linalg.inv(np.where(singular[..., None, None], np.nan, matrices))


def policies(plant: Plant, P: np.ndarray) -> np.ndarray:
    """Return [K; -L] (m + k, n) of the policies u = -K x and w = L x for the value x'P x."""
    G = plant.G
    if plant.is_discrete:
        weights = plant.W + plant.discount * G.mT @ P @ G
        return _inverses(weights) @ (plant.discount * G.mT @ P @ plant.A + plant.S.mT)
    return _inverses(plant.W) @ (G.mT @ P + plant.S.mT)


def answer_of(plant: Plant, P: np.ndarray) -> dict[str, np.ndarray]:
    """Return name -> matrix of the answer of a plant with the value x'P x.

    The matrices are P, the gains K and L, the weights W of the value and, in discrete time, the
    matrix H of the Q-function. For a stack of plants, each matrix is a stack.
    """
    gains = policies(plant, P)
    m = plant.R.shape[-1]
    answer = {"P": P, "K": gains[..., :m, :], "L": -gains[..., m:, :], "W": weights_of(P)}
    if plant.is_discrete:
        moved = np.concatenate([plant.A, plant.G], axis=-1)
        of_state = np.concatenate([plant.Q, plant.S], axis=-1)
        of_policies = np.concatenate([plant.S.mT, plant.W], axis=-1)
        weights = np.concatenate([of_state, of_policies], axis=-2)
        answer["H"] = weights + plant.discount * moved.mT @ P @ moved
    return answer


def weights_of(P: np.ndarray) -> np.ndarray:
    """Return the weights W (1, n(n+1)/2) with x'P x = W'(x1², x1 x2, ..., xn²)."""
    row, column = np.triu_indices(P.shape[-1])
    factors = np.where(row == column, 1.0, 2.0)
    return (factors * P[..., row, column])[..., None, :]


def answer_change(
    plant: Plant, P: np.ndarray, name: str, row: int, column: int
) -> Mapping[str, np.ndarray]:
    """Return name -> derivative of a matrix of `answer_of` with respect to one entry of the plant.

    In Q and R, the mirrored entry changes too. The cost is stationary with respect to the policies.
    Therefore dP is the solution of the Lyapunov equation of the closed loop.

    P: matrix of the plant's value x'P x, (n, n)
    name: "A", "B", "E", "N", "Q", "R" or "gamma"
    row, column: position of the entry, ignored for gamma
    """
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


def _lyapunov(plant: Plant, F: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the solution Z of the Lyapunov equation of a plant."""
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    symmetric = (right + right.T) / 2.0
    with warnings.catch_warnings(action="ignore"):  # for a loop near the limit of stability
        if plant.is_discrete:
            Z = solve_discrete_lyapunov(math.sqrt(plant.discount) * F.T, symmetric)
        else:
            Z = solve_continuous_lyapunov(F.T, -symmetric)
    return np.asarray(Z + Z.T) / 2.0
