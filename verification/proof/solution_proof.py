"""The exact solution of the game, proved; and how far somebody's W, P or K is from it, from below and from above."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from controller.game.basis import Basis
from controller.game.critic_file import StoredCritic
from controller.game.zero_sum import Game
from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import minimum_delta
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.fields import Shown
from verification.arithmetic import flint_or_refusal
from verification.arithmetic.balls import matrix, norm
from verification.enclosures.game_balls import BallGame, Enclosed, enclose_solution, is_hurwitz, unstable_modes
from verification.enclosures.trim_branch import TrimBranch
from verification.enclosures.trim_family import Family
from verification.proof.delta_proof import ProvedDelta, prove_delta_min


class Distance(NamedTuple):
    """|X - X*| / |X*|, Frobenius, lies between the two; rounded outward."""

    at_least: float
    at_most: float


@dataclass(frozen=True, eq=False, repr=False)
class SolutionProof(Shown):
    """The stabilizing solution of the game, enclosed.

    enclosed: about the game of the doubles. radius: of the printed P, relative, Frobenius: the exact solution lies
    within it, also for every parameter that reads as the same decimal where the game is the aircraft's. P: (n, n), the
    printed one. delta: the bracket of delta_min, None when open. unstable: modes of A, None when open.
    """

    says = ("proved",)

    game: Game
    P: np.ndarray
    enclosed: Enclosed
    radius: float
    delta: ProvedDelta | None
    unstable: int | None

    @property
    def proved(self) -> bool:
        """P > 0, A - S P and A - B K Hurwitz, delta above the proved bracket of delta_min."""
        above = self.delta is not None and self.game.delta > self.delta.value
        return self.enclosed.is_value and self.enclosed.stable and above


@dataclass(frozen=True, eq=False, repr=False)
class CriticProof(Shown):
    """Distances of what a file holds from the exact solution, by name; whether its gain makes A - B K Hurwitz.

    given: W, P, K of the file, P of its W where there is none.
    """

    game: Game
    given: dict[str, np.ndarray]
    distances: dict[str, Distance]
    stabilizes: bool | None


def games_of(game: Game, family: Family | None, degrees: float | None) -> tuple[BallGame, BallGame]:
    """The game of the doubles, and the same with every decimal in its ball; twice the same for a plant of a file."""
    if family is None or degrees is None:
        return BallGame.of(game), BallGame.of(game)
    doubles_only = TrimBranch(replace(family, decimals=False))
    sharp, wide = doubles_only.model_at(degrees), TrimBranch(family).model_at(degrees)
    return BallGame(game, *sharp[:2]), BallGame(game, *wide[:2])


def prove_solution(game: Game, family: Family | None = None, degrees: float | None = None) -> SolutionProof:
    """Enclose the solution; of the aircraft of a family at a dihedral (deg), or of a game given by its matrices.

    NoSolutionError when the game has no value, or when it cannot be enclosed.
    """
    flint_or_refusal()
    found = solve_game(game)
    sharp, wide = games_of(game, family, degrees)
    enclosed = enclose_solution(sharp, found.P)
    around = enclose_solution(wide, found.P)
    if not around.is_value:
        raise NoSolutionError("the rounding of the decimals is too much for a proof that the solution is the value")
    return SolutionProof(
        game,
        found.P,
        enclosed,
        max(distance(found.P, each.P).at_most for each in (enclosed, around)),
        prove_delta_min(sharp, minimum_delta(game)),
        unstable_modes(sharp.A),
    )


def prove_critic(
    game: Game, stored: StoredCritic, basis: Basis, family: Family | None = None, degrees: float | None = None
) -> CriticProof:
    """How far W, P and K of a file are from the exact ones. BadInputError when a shape does not fit the game."""
    flint_or_refusal()
    sharp, _ = games_of(game, family, degrees)
    enclosed = enclose_solution(sharp, solve_game(game).P)
    K_exact = sharp.gain_of(enclosed.P)
    n, m = game.B.shape
    shapes = {"W": (basis.size,), "P": (n, n), "K": (m, n)}
    given = {name: value for name in shapes if (value := getattr(stored, name)) is not None}
    for name, value in given.items():
        if value.shape != shapes[name]:
            raise BadInputError(f"{name} has shape {value.shape}; with this game it must be {shapes[name]}")
    targets = {"P": enclosed.P, "K": K_exact}
    found = {}
    if "W" in given:
        found["W"] = distance(given["W"][:, None], _weights(enclosed.P, basis))
        given.setdefault("P", basis.matrix(given["W"]))
    found |= {name: distance(given[name], targets[name]) for name in ("P", "K") if name in given}
    gain = matrix(given["K"]) if "K" in given else sharp.gain_of(matrix(given["P"]))
    if "K" not in given:
        found["K"] = _distance(gain, K_exact)
    loop = sharp.A - sharp.B * gain
    count = unstable_modes(loop)
    return CriticProof(game, given, found, None if count is None else is_hurwitz(loop))


def distance(values: np.ndarray, target: arb_mat) -> Distance:
    """Of doubles, taken exactly, from every matrix in the balls."""
    return _distance(matrix(values), target)


def _distance(values: arb_mat, target: arb_mat) -> Distance:
    ratio = norm((values - target).entries()) / norm(target.entries())
    if not ratio.is_finite():
        return Distance(0.0, np.inf)
    low, high = float(ratio.lower()), float(ratio.upper())
    return Distance(max(0.0, np.nextafter(low, -np.inf)), np.nextafter(high, np.inf))


def _weights(P: arb_mat, basis: Basis) -> arb_mat:
    """W with W'ψ(z) = z'Pz, (M, 1): P_ii and 2 P_ij, then zeros."""
    row, column = np.triu_indices(basis.states)
    entries = [P[i, j] if i == j else 2 * P[i, j] for i, j in zip(row.tolist(), column.tolist(), strict=True)]
    return arb_mat([[entry] for entry in [*entries, *[arb(0)] * (basis.size - len(entries))]])
