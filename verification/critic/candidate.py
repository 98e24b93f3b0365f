"""A critic to be judged: what is known of it, whatever it came as."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from controller.game.basis import Basis
from controller.game.model_file import StoredCritic
from controller.game.zero_sum import Game
from hfa_model.support.errors import BadInputError

#: W and P of one file may differ by this part, which is what printing six digits leaves.
TOGETHER = 1e-6


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
    """The candidate of a file, each matrix as it is stored: W gives what is missing of P and K, or else P does.

    The policy is that of W, or else of K. BadInputError for a wrong shape, and when W and P are not of one value.
    """
    of_P = None if stored.P is None else from_value(game, stored.P)
    if stored.W is not None:
        found = from_weights(game, stored.W, basis)
        if of_P is not None and not _are_one_value(of_P.P, found.P):
            raise BadInputError("W and P are of different values; leave one of them out")
    elif of_P is not None:
        found = of_P
    else:
        assert stored.K is not None
        return from_gain(game, stored.K)
    if stored.K is None:
        return found
    alone = from_gain(game, stored.K)
    return replace(found, K=alone.K, policy=found.policy if stored.W is not None else alone.policy)


def _are_one_value(P: np.ndarray | None, other: np.ndarray | None) -> bool:
    """|P - P2|_ij <= `TOGETHER` sqrt(|P_ii P_jj|), whatever the units of the states."""
    assert P is not None
    assert other is not None
    sizes = np.sqrt(np.abs(np.diag(P)))
    return bool(np.all(np.abs(P - other) <= TOGETHER * np.outer(sizes, sizes)))
