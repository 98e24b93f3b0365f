"""The exact solution of the game, proved; and how far somebody's W, P or K is from it, from below and from above."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, arb_mat

from controller.game.basis import Basis
from controller.game.critic_file import StoredCritic
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units
from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import DeltaMin, minimum_delta
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.fields import Shown
from verification.arithmetic import flint_or_refusal
from verification.arithmetic.balls import doubles, exact, map_entries, matrix, norm, symmetric
from verification.enclosures.eigenvalue_signs import counted
from verification.enclosures.game_balls import BallGame, Enclosed, enclose_solution, is_hurwitz, unstable_modes
from verification.enclosures.trim_branch import Family, TrimBranch
from verification.proof.certificate_file import flights_claim
from verification.proof.stated_model import stated_point

#: Relative width of the bracket, where the middle of a wider one can be decided.
WIDTH = 1e-6
#: Distances from the middle of what was found, relative, that are tried on either side.
_DISTANCES = (1e-7, 2e-7, 5e-7, 1e-6, 1e-5, 1e-4, 1e-3)


class ProvedDelta(NamedTuple):
    """refused < delta_min <= value: at `value` the game has a value, at `refused` it has none; both proved."""

    value: float
    refused: float
    reason: str

    @property
    def width(self) -> float:
        """(value - refused) / value."""
        return (self.value - self.refused) / self.value


def prove_delta_min(game: BallGame, found: DeltaMin) -> ProvedDelta | None:
    """The narrowest bracket about what was found in doubles that can be proved; None when none can.

    The δ for which the game has a value are an interval (delta_min, inf] (Basar and Bernhard, Theorem 4.11), so one
    δ with a value bounds delta_min from above, and one without it from below.
    """
    if found.value <= 0.0:
        return None
    middle = math.sqrt(found.value * found.refused)
    highs = (middle * (1.0 + distance) for distance in _DISTANCES)
    high = next((delta for delta in highs if value_is_proved(game.with_delta(delta))), None)
    lows = (middle * (1.0 - distance) for distance in _DISTANCES)
    refused = next(((delta, why) for delta in lows if (why := none_exists(game.with_delta(delta)))), None)
    return None if high is None or refused is None else _narrowed(game, ProvedDelta(high, *refused))


def _narrowed(game: BallGame, bracket: ProvedDelta) -> ProvedDelta:
    """Halved until it is as narrow as `WIDTH`, or its middle cannot be decided."""
    while bracket.width > WIDTH:
        middle = math.sqrt(bracket.value * bracket.refused)
        if value_is_proved(game.with_delta(middle)):
            bracket = bracket._replace(value=middle)
        elif reason := none_exists(game.with_delta(middle)):
            bracket = bracket._replace(refused=middle, reason=reason)
        else:
            break
    return bracket


def value_is_proved(game: BallGame) -> bool:
    """A stabilizing and positive definite solution is proved to exist."""
    try:
        return enclose_solution(game).is_value
    except NoSolutionError:
        return False


def none_exists(game: BallGame) -> str | None:
    """Why the game has no value, proved; None when it is not."""
    try:
        if enclose_solution(game).is_indefinite:
            return "the stabilizing solution has a negative eigenvalue"
    except NoSolutionError:
        pass
    if frequencies_around_axis(game):
        return "the Hamiltonian has an eigenvalue on the imaginary axis"
    return None


def frequencies_around_axis(game: BallGame) -> tuple[float, float] | None:
    """Two ω between which the Hamiltonian has an eigenvalue j ω; None when none is proved.

    det(j ω I - H) is real, because the spectrum is symmetric: it changes its sign.
    """
    own = game.scaled(balanced_units(game.game))
    values = np.linalg.eigvals(np.block([[own.game.A, -own.game.S], [-own.game.Q, -own.game.A.T]]))
    near = sorted(np.abs(values[np.argsort(np.abs(values.real))][:4].imag).tolist())
    ends = [near[0] * 0.9, *near, near[-1] * 1.1]
    A, S, Q = own.A, own.S(), own.Q()
    rows = [[*row, *other] for row, other in zip(A.tolist(), (-S).tolist(), strict=True)]
    rows += [[*row, *other] for row, other in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    H, one, found = acb_mat(rows), acb_mat(matrix(np.eye(len(rows)))), dict[bool, float]()
    for frequency in (*ends, *((a + b) / 2 for a, b in pairwise(ends))):
        value = (one * acb(0, exact(frequency)) - H).det().real
        if value > 0 or value < 0:
            found[bool(value > 0)] = frequency
    return (found[True], found[False]) if len(found) == 2 else None


@dataclass(frozen=True, eq=False)
class StatedGame:
    """The game of a statement: of the model of a family at a place, or without these of its matrices."""

    game: Game
    family: Family | None = None
    place: float | None = None

    @cached_property
    def sharp(self) -> BallGame:
        """Of the doubles."""
        return self._balls(decimals=False)

    @cached_property
    def wide(self) -> BallGame:
        """Of every decimal that reads as these doubles."""
        return self._balls(decimals=True)

    def _balls(self, *, decimals: bool) -> BallGame:
        if self.family is None or self.place is None:
            return BallGame.of(self.game)
        return BallGame(self.game, *self._branch(self.family, decimals).model_at(self.place)[:2])

    @staticmethod
    def _branch(family: Family, decimals: bool) -> TrimBranch:
        return TrimBranch(replace(family, spread={}, decimals=decimals))

    def claim(self) -> dict[str, Any]:
        """What a certificate says of the plant and the game."""
        game, delta = self.game, self.game.delta if np.isfinite(self.game.delta) else "inf"
        own = {"E": game.E, "delta": delta, "Q": (game.Q + game.Q.T) / 2, "R": (game.R + game.R.T) / 2}
        if self.family is None or self.place is None:
            return {"A": game.A, "B": game.B, "range": [0.0, 0.0], "game": own}
        return flights_claim(self.family, self.place, self.place) | {"game": own}

    def point(self, decimals: bool) -> dict[str, Any]:
        """What a certificate says of the trim, about the decimals as they were read or about the doubles."""
        own: dict[str, Any] = {"range": [0.0, 0.0]}
        if self.family is not None and self.place is not None:
            own = stated_point(self.place, self._branch(self.family, decimals))
        return {"unstable": 0, "rate": 0.0} | own


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

    about: StatedGame
    P: np.ndarray
    enclosed: Enclosed
    radius: float
    delta: ProvedDelta | None
    unstable: int | None

    @property
    def proved(self) -> bool:
        """P > 0, A - S P and A - B K Hurwitz, delta above the proved bracket of delta_min."""
        above = self.delta is not None and self.about.game.delta > self.delta.value
        return self.enclosed.is_value and self.enclosed.stable and above


@dataclass(frozen=True, eq=False, repr=False)
class CriticProof(Shown):
    """Distances of what a file holds from the exact solution, by name; whether its gain makes A - B K Hurwitz.

    given: W, P, K of the file, P of its W where there is none.
    """

    about: StatedGame
    given: dict[str, np.ndarray]
    distances: dict[str, Distance]
    stabilizes: bool | None


def prove_solution(game: Game, family: Family | None = None, place: float | None = None) -> SolutionProof:
    """Enclose the solution; of the model of a family at a place, or of a game given by its matrices.

    NoSolutionError when the game has no value, or when it cannot be enclosed.
    """
    flint_or_refusal()
    about, P = StatedGame(game, family, place), solve_game(game).P
    enclosed, around = enclose_solution(about.sharp, P), enclose_solution(about.wide, P)
    if not around.is_value:
        raise NoSolutionError("the rounding of the decimals is too much for a proof that the solution is the value")
    radius = max(distance(P, each.P).at_most for each in (enclosed, around))
    delta = prove_delta_min(about.sharp, minimum_delta(game))
    return SolutionProof(about, P, enclosed, radius, delta, unstable_modes(about.sharp.A))


def prove_critic(
    game: Game, stored: StoredCritic, basis: Basis, family: Family | None = None, place: float | None = None
) -> CriticProof:
    """How far W, P and K of a file are from the exact ones. BadInputError when a shape does not fit the game."""
    flint_or_refusal()
    about = StatedGame(game, family, place)
    sharp, exact = about.sharp, enclose_solution(about.sharp, solve_game(game).P).P
    n, m = game.B.shape
    shapes = {"W": (basis.size,), "P": (n, n), "K": (m, n)}
    given = {name: value for name in shapes if (value := getattr(stored, name)) is not None}
    for name, value in given.items():
        if value.shape != shapes[name]:
            raise BadInputError(f"{name} has shape {value.shape}; with this game it must be {shapes[name]}")
    if "W" in given:
        given.setdefault("P", basis.matrix(given["W"]))
    gain = matrix(given["K"]) if "K" in given else sharp.gain_of(matrix(given["P"]))
    values = {name: matrix(value[:, None] if name == "W" else value) for name, value in given.items()} | {"K": gain}
    targets = {"W": _weights(exact, basis), "P": exact, "K": sharp.gain_of(exact)}
    found = {name: distance(values[name], targets[name]) for name in targets if name in values}
    loop = sharp.A - sharp.B * gain
    return CriticProof(about, given, found, None if unstable_modes(loop) is None else is_hurwitz(loop))


def distance(values: np.ndarray | arb_mat, target: arb_mat) -> Distance:
    """Of balls, or of doubles taken exactly, from every matrix in the balls `target`."""
    values = matrix(values) if isinstance(values, np.ndarray) else values
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


#: The certificate states a radius and a reach this much larger than proved: the checker encloses in another way.
_WIDER = 4.0
#: Least reach, relative: far below what a statement needs, far above the rounding of the checker.
_LEAST = 1e-28
#: Part of a distance by which the certificate states it wider.
_SHARP = 1e-6
#: Decimals of an entry of P: the checker's own digits, and some.
_DIGITS = 55
Parts = tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]


def solution_claim(proof: SolutionProof) -> Parts:
    """Statement and boxes of a proved solution, with the bracket of delta_min."""
    assert proof.delta is not None
    about, wide, sharp = proof.about, proof.about.wide, proof.about.sharp
    gain = wide.gain_of(matrix(proof.P))
    claim = about.claim() | {
        "table": {"K": doubles(gain), "P": proof.P},
        "distances": {"P": [0.0, _WIDER * proof.radius]},
        "delta_min": [proof.delta.refused, proof.delta.value],
    }
    below = sharp.with_delta(proof.delta.refused)
    axis = frequencies_around_axis(below) if "axis" in proof.delta.reason else None
    decimals, point = about.point(True), about.point(False)
    return claim, {
        "solution": [decimals | _solution(wide)],
        "loop": [decimals | _modes(wide.A - wide.B * gain)],
        "modes": [point | _modes(sharp.A)],
        "value": [point | _solution(sharp.with_delta(proof.delta.value))],
        "refused": [point | ({"axis": axis} if axis else _solution(below))],
    }


def critic_claim(proof: CriticProof) -> Parts:
    """Statement and boxes of the distances of a critic. NoSolutionError when a mode of its loop may lie on the axis."""
    about, sharp, point = proof.about, proof.about.sharp, proof.about.point(False)
    given = {name: value[:, None] if name == "W" else value for name, value in proof.given.items()}
    gain = matrix(given["K"]) if "K" in given else sharp.gain_of(matrix(given["P"]))
    distances = {name: _widened(found) for name, found in proof.distances.items()}
    return about.claim() | {"table": {"K": doubles(gain)} | given, "distances": distances}, {
        "solution": [point | _solution(sharp)],
        "loop": [point | _modes(sharp.A - sharp.B * gain)],
    }


def _widened(found: Distance) -> list[float]:
    """The solution in a certificate is not as sharp as the proof's own."""
    return [max(0.0, found.at_least * (1.0 - _SHARP) - _LEAST), found.at_most * (1.0 + _SHARP) + _LEAST]


def _solution(game: BallGame) -> dict[str, Any]:
    """P in balanced units, how far about it the solution is, and what makes A - S P Hurwitz."""
    found = enclose_solution(game)
    up, own = matrix(np.diag(found.units)), game.scaled(found.units)
    P = up * found.P * up
    radii = map_entries(lambda entry: entry.rad(), P)
    reach = _WIDER * norm(radii.entries()) + _LEAST * norm(P.entries())
    middle = [[entry.mid().str(_DIGITS, radius=False) for entry in row] for row in P.tolist()]
    around = P + map_entries(lambda entry: symmetric(reach), P)
    return {"units": found.units, "P": [middle], "reach": float(reach)} | _modes(own.A - own.S() * around)


def _modes(A: arb_mat) -> dict[str, Any]:
    found = counted(A)
    if found is None:
        raise NoSolutionError("a mode may lie on the axis; there is nothing to certify")
    return {"unstable": found.unstable, "rate": 0.0, "H": found.H, "turn": found.turn}
