"""A critic to be checked: its value and gain, whatever file or object it comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.analysis.cost import is_moderate
from controller.game.basis import Basis, bases_with, basis
from controller.game.critic_file import StoredCritic
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, numbers_in
from hfa_support.reporting.fields import Shown

#: W and P of one file may differ by this part, which is what printing six digits leaves.
TOGETHER = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Shown):
    """A critic's policy u = -K z at the origin, its value z'Pz or V = W'ψ(z), as much as is known of it.

    K: (m, n), gain at the origin. P: (n, n), value matrix, None when only a gain is known. weights: (M,), V = W'ψ(z)
    in `functions`, None when it did not come as weights."""

    K: np.ndarray
    P: np.ndarray | None
    functions: Basis
    weights: np.ndarray | None = None

    @property
    def finite(self) -> bool:
        """Whether K and P consist of numbers with which can be computed: P S P may not overflow."""
        return is_moderate(self.K) and (self.P is None or is_moderate(self.P))


def from_weights(game: Game, weights: np.ndarray, functions: Basis | str = "quadratic") -> Candidate:
    """V = W'ψ(z), u = -½ R⁻¹B' (∂ψ/∂z)'W (paper Eq. 28). BadInputError when W has another length than the basis, or is
    complex."""
    psi = basis(functions, len(game.A)) if isinstance(functions, str) else functions
    weights = numbers_in("W", weights)
    if weights.shape != (psi.size,):
        fitting = " or ".join(map(repr, bases_with(weights.size, psi.states)))
        advice = f"name the basis of the weights, {fitting}" if fitting else "no basis has as many"
        raise BadInputError(
            f"there are {weights.size} weights; basis {psi.name!r} on {psi.states} states has {psi.size}: {advice}"
        )
    P = psi.matrix(weights)
    return Candidate(game.gain(P), P, psi, weights)


def from_value(game: Game, P: np.ndarray) -> Candidate:
    """V = z'Pz, u = -R⁻¹B'P z. BadInputError when P has another shape than A, or is complex."""
    P = numbers_in("P", P)
    if P.shape != game.A.shape:
        n = len(game.A)
        raise BadInputError(f"P is {_shape(P)}; on a plant with {n} states it must be {n} x {n}")
    return Candidate(game.gain(P), P, basis("quadratic", len(P)))


def from_gain(game: Game, K: np.ndarray) -> Candidate:
    """u = -K z. BadInputError when K has another shape than B', or is complex."""
    return Candidate(game.checked_gain(K), None, basis("quadratic", len(game.A)))


def from_run(game: Game, run: LearningResult) -> Candidate:
    """What a law has learned at its end."""
    return from_weights(game, run.weights[-1], run.basis)


def from_stored(game: Game, stored: StoredCritic, functions: Basis) -> Candidate:
    """The candidate of a file, each matrix as it is stored: W gives what is missing of P and K, or else P does.

    BadInputError for a wrong shape, and when W and P are not of one value.
    """
    of_P = None if stored.P is None else from_value(game, stored.P)
    if stored.W is not None:
        found = from_weights(game, stored.W, functions)
        if of_P is not None and not _are_one_value(of_P.P, found.P):
            raise BadInputError("W and P are of different values; leave one of them out")
    elif of_P is not None:
        found = of_P
    else:
        assert stored.K is not None
        return from_gain(game, stored.K)
    return found if stored.K is None else replace(found, K=from_gain(game, stored.K).K)


def _are_one_value(P: np.ndarray | None, other: np.ndarray | None) -> bool:
    """|P - P2|_ij <= `TOGETHER` sqrt(|P_ii P_jj|), whatever the units of the states."""
    assert P is not None
    assert other is not None
    sizes = np.sqrt(np.abs(np.diag(P)))
    return bool(np.all(np.abs(P - other) <= TOGETHER * np.outer(sizes, sizes)))


def _shape(matrix: np.ndarray) -> str:
    return " x ".join(str(size) for size in matrix.shape)
