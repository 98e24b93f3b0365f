"""A critic to be judged: what is known of it, whatever it came as."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from controller.basis import Basis
from controller.game import Game
from controller.model_file import StoredCritic
from hfa_model.errors import BadInputError


@dataclass(frozen=True, eq=False)
class Candidate:
    """K: (m, n), gain near the origin. P: (n, n), value matrix, None when only a gain is known. weights: (M,), None
    when it did not come as weights. policy: states (N, n) -> inputs (N, m), the policy as it would be flown."""

    K: np.ndarray
    P: np.ndarray | None
    weights: np.ndarray | None
    policy: Callable[[np.ndarray], np.ndarray]


def from_weights(game: Game, weights: np.ndarray, basis: Basis) -> Candidate:
    """u = -½ R⁻¹B' (∂ψ/∂z)'W (paper Eq. 28). BadInputError when W has another length than the basis."""
    if weights.shape != (basis.size,):
        raise BadInputError(
            f"there are {weights.size} weights; basis {basis.name!r} on {basis.states} states has {basis.size}: "
            "name the basis of the weights"
        )
    P = basis.matrix(weights)

    def policy(z: np.ndarray) -> np.ndarray:
        gradient = np.swapaxes(basis.gradient(z), -1, -2) @ weights
        return np.asarray(-0.5 * gradient @ game.R_inverse_B_transposed.T)

    return Candidate(game.gain(P), P, weights, policy)


def from_value(game: Game, P: np.ndarray) -> Candidate:
    """u = -R⁻¹B'P z. BadInputError when P has another shape than A."""
    if P.shape != game.A.shape:
        n = len(game.A)
        raise BadInputError(f"P is {P.shape[0]} x {P.shape[1]}; on a plant with {n} states it must be {n} x {n}")
    K = game.gain(P)
    return Candidate(K, P, None, lambda z: -z @ K.T)


def from_gain(game: Game, K: np.ndarray) -> Candidate:
    """u = -K z. BadInputError when K has another shape than B'."""
    if K.shape != game.B.T.shape:
        n, m = game.B.shape
        raise BadInputError(
            f"K is {K.shape[0]} x {K.shape[1]}; on a plant with {n} states and {m} inputs it must be {m} x {n}"
        )
    return Candidate(K, None, None, lambda z: -z @ K.T)


def from_stored(game: Game, stored: StoredCritic, basis: Basis) -> Candidate:
    """The candidate of a file."""
    if stored.kind == "W":
        return from_weights(game, stored.values, basis)
    return from_value(game, stored.values) if stored.kind == "P" else from_gain(game, stored.values)
