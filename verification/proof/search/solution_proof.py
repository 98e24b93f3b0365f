"""The exact solution of the game, proved; and how far somebody's W, P or K is from it, from below
and from above."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, arb_mat

from controller.critic.critic import Critic
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units
from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import DeltaMin, minimum_delta
from hfa_support.errors import BadInputError, NoSolutionError
from verification.proof.arithmetic.balls import doubles, exact, matrix, norm, symmetric
from verification.proof.enclosures.matrix_balls import (
    BallGame,
    Enclosed,
    counted,
    enclose_solution,
    unstable_modes,
)
from verification.proof.enclosures.trim_branch import Family, TrimBranch
from verification.proof.search.certificate import FINEST, Content, Proof, flights_claim
from verification.proof.search.proof_report import SCHEMA

#: Relative width of the bracket, where the middle of a wider one can be decided.
WIDTH = 1e-6
#: Distances from the middle of what was found, relative, that are tried on either side.
_DISTANCES = (1e-7, 2e-7, 5e-7, 1e-6, 1e-5, 1e-4, 1e-3)
#: The certificate states a radius and a reach this much larger than proved: the checker encloses in
#: another way.
_WIDER = 4.0
#: Least reach, relative: far below what a statement needs, far above the rounding of the checker.
_LEAST = 1e-28
#: Part of a distance by which the certificate states it wider.
_SHARP = 1e-6
#: Decimals of an entry of P or of a trim: the checker's own digits, and some.
_DIGITS = 55


class ProvedDelta(NamedTuple):
    """refused < delta_min <= value: at `value` the game has a value, at `refused` it has none; both
    proved."""

    value: float
    refused: float
    why: Enclosed | tuple[float, float]


def prove_delta_min(game: BallGame, found: DeltaMin) -> ProvedDelta | None:
    """The narrowest bracket about what was found in doubles that can be proved; None when none can.

    The δ for which the game has a value are an interval (delta_min, inf] (Basar and Bernhard,
    Theorem 4.11), so one δ with a value bounds delta_min from above, and one without it from below.
    """
    if found.value <= 0.0:
        return None
    middle = math.sqrt(found.value * found.refused)
    highs = (middle * (1.0 + distance) for distance in _DISTANCES)
    high = next((delta for delta in highs if value_is_proved(game.with_delta(delta))), None)
    lows = (middle * (1.0 - distance) for distance in _DISTANCES)
    refused = next(
        ((delta, why) for delta in lows if (why := none_exists(game.with_delta(delta)))), None
    )
    if high is None or refused is None:
        return None
    bracket = ProvedDelta(high, *refused)
    while bracket.value - bracket.refused > WIDTH * bracket.value:
        middle = math.sqrt(bracket.value * bracket.refused)
        if value_is_proved(game.with_delta(middle)):
            bracket = bracket._replace(value=middle)
        elif why := none_exists(game.with_delta(middle)):
            bracket = bracket._replace(refused=middle, why=why)
        else:
            break
    return bracket


def value_is_proved(game: BallGame) -> bool:
    """A stabilizing and positive definite solution is proved to exist."""
    try:
        return enclose_solution(game).is_value
    except NoSolutionError:
        return False


def none_exists(game: BallGame) -> Enclosed | tuple[float, float] | None:
    """Why the game has no value, proved; None when it is not: a stabilizing solution with a
    negative eigenvalue, or two ω between which the Hamiltonian has an eigenvalue j ω.

    det(j ω I - H) is real, because the spectrum is symmetric: there it changes its sign.
    """
    with suppress(NoSolutionError):
        found = enclose_solution(game)
        if found.stabilizing and found.lowest < 0:
            return found
    own = game.scaled(balanced_units(game.game))
    values = np.linalg.eigvals(np.block([[own.game.A, -own.game.S], [-own.game.Q, -own.game.A.T]]))
    near = sorted(np.abs(values[np.argsort(np.abs(values.real))][:4].imag).tolist())
    ends = [near[0] * 0.9, *near, near[-1] * 1.1]
    A, S, Q = own.A, own.S(), own.Q()
    rows = [[*row, *other] for row, other in zip(A.tolist(), (-S).tolist(), strict=True)]
    rows += [
        [*row, *other] for row, other in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)
    ]
    H, one, signs = acb_mat(rows), acb_mat(matrix(np.eye(len(rows)))), dict[bool, float]()
    for frequency in (*ends, *((a + b) / 2 for a, b in pairwise(ends))):
        value = (one * acb(0, exact(frequency)) - H).det().real
        if value > 0 or value < 0:
            signs[bool(value > 0)] = frequency
    return (signs[True], signs[False]) if len(signs) == 2 else None


class StatedGame(NamedTuple):
    """The game of a statement: of the model of a family at a place, or without these of its
    matrices."""

    game: Game
    family: Family | None = None
    place: float | None = None

    def balls(self, *, decimals: bool) -> tuple[BallGame, Content]:
        """About the doubles, or about every decimal that reads as them; and what a certificate has
        of the trim."""
        modes: Content = {"unstable": 0, "rate": 0.0}
        if self.family is None or self.place is None:
            return BallGame.of(self.game), modes | {"range": [0.0, 0.0]}
        branch, trim = TrimBranch(replace(self.family, spread={}, decimals=decimals)), Content()
        for name, value in zip(branch.free, branch.trim_at(self.place), strict=True):
            radius = 2 * float(value.rad()) + FINEST * self.family.model.signals[name].nominal
            trim[name] = [value.mid().str(_DIGITS, radius=False), 0.0, 0.0, radius]
        point = {"range": [self.place, self.place], "decimals": decimals, "trim": trim}
        return BallGame(self.game, *branch.model_at(self.place)), modes | point

    def proof(
        self,
        data: Content,
        table: Content,
        distances: Content,
        boxes: dict[str, Content],
        **more: Any,
    ) -> Proof:
        """With the statement of the plant and of the game. data: what JSON has, beside which game
        it is."""
        game, delta = self.game, self.game.delta if np.isfinite(self.game.delta) else "inf"
        claim: Content = {"A": game.A, "B": game.B, "range": [0.0, 0.0]}
        model = None if self.family is None else self.family.model
        if self.family is not None and self.place is not None:
            claim = flights_claim(self.family, self.place, self.place)
        own = {
            "E": game.E,
            "delta": delta,
            "Q": (game.Q + game.Q.T) / 2,
            "R": (game.R + game.R.T) / 2,
        }
        claim |= {"game": own, "table": table, "distances": distances} | more
        lists = {name: [box] for name, box in boxes.items()}
        return Proof("game", claim, lists, model, data={"schema": SCHEMA} | data)


def prove_solution(game: Game, family: Family | None = None, place: float | None = None) -> Proof:
    """The stabilizing solution, enclosed, of the model of a family at a place or of a game given by
    its matrices.

    data: P, the printed one; relative_radius: the exact solution lies within it, Frobenius, also
    for every parameter that reads as the same decimal where the game is the aircraft's. Proved: P >
    0, A - S P and A - B K Hurwitz, delta above the proved bracket of delta_min. NoSolutionError
    when the game has no value, or when it cannot be enclosed."""
    about, P = StatedGame(game, family, place), solve_game(game).P
    (sharp, point), (wide, decimals) = about.balls(decimals=False), about.balls(decimals=True)
    enclosed, around = enclose_solution(sharp, P), enclose_solution(wide, P)
    if not around.is_value:
        raise NoSolutionError(
            "the rounding of the decimals is too much for a proof that the solution is the value"
        )
    radius = max(distance(P, each.P).at_most for each in (enclosed, around))
    delta, above = prove_delta_min(sharp, minimum_delta(game)), math.inf
    if delta is not None:
        above = delta.value
    data = {
        "statement": "solution",
        "proved": enclosed.is_value and enclosed.stable and game.delta > above,
        "P": P,
        "relative_radius": radius,
        "positive_definite": enclosed.is_value,
        "worst_case_hurwitz": enclosed.stabilizing,
        "closed_loop_hurwitz": enclosed.stable,
        "delta": game.delta if math.isfinite(game.delta) else None,
        "delta_min_above": None if delta is None else delta.refused,
        "delta_min_at_most": None if delta is None else delta.value,
        "unstable_modes": unstable_modes(sharp.A),
    }
    if delta is None or not data["proved"]:
        return about.proof(data, {}, {}, {})
    gain, why, below = wide.gain() * matrix(P), delta.why, sharp.with_delta(delta.refused)
    boxes = {
        "solution": decimals | _solution(wide, around),
        "loop": decimals | _modes(wide.A - wide.B * gain),
        "modes": point | _modes(sharp.A),
        "value": point | _solution(sharp.with_delta(delta.value)),
        "refused": point | (_solution(below, why) if isinstance(why, Enclosed) else {"axis": why}),
    }
    distances = {"P": [0.0, _WIDER * radius]}
    bracket = [delta.refused, delta.value]
    return about.proof(data, {"K": doubles(gain), "P": P}, distances, boxes, delta_min=bracket)


def prove_critic(
    game: Game,
    critic: Critic,
    family: Family | None = None,
    place: float | None = None,
) -> Proof:
    """How far W, P and K of a critic are from the exact ones, and whether its gain makes A - B K
    Hurwitz.

    The gain of a critic that is a value is taken from P in ball arithmetic. BadInputError for a
    network, about which nothing is proved.
    """
    if critic.network:
        raise BadInputError("a network has no proof here; give its W, P or K")
    about = StatedGame(game, family, place)
    sharp, point = about.balls(decimals=False)
    enclosed = enclose_solution(sharp, solve_game(game).P)
    given = {}
    if critic.weights is not None:
        given["W"] = critic.weights[:, None]
    if critic.P is not None:
        given["P"] = critic.P
    if critic.feedback is None:
        given["K"] = critic.K
    gain = matrix(given["K"]) if "K" in given else sharp.gain() * matrix(given["P"])
    values = {name: matrix(value) for name, value in given.items()} | {"K": gain}
    targets = {"P": enclosed.P, "K": sharp.gain() * enclosed.P}
    if critic.basis is not None:
        targets["W"] = _weights(enclosed.P, critic.basis)
    found = {name: distance(values[name], targets[name]) for name in targets if name in values}
    loop = sharp.A - sharp.B * gain
    count = unstable_modes(loop)
    boxes = (
        {}
        if count is None
        else {"solution": point | _solution(sharp, enclosed), "loop": point | _modes(loop)}
    )
    # The solution in a certificate is not as sharp as the proof's own.
    wider = {
        name: [max(0.0, low * (1.0 - _SHARP) - _LEAST), high * (1.0 + _SHARP) + _LEAST]
        for name, (low, high) in found.items()
    }
    data = {
        "statement": "critic",
        "distances": {name: each._asdict() for name, each in found.items()},
        "closed_loop_hurwitz": None if count is None else count == 0,
    }
    return about.proof(data, {"K": doubles(gain)} | given, wider, boxes)


class Distance(NamedTuple):
    """|X - X*| / |X*|, Frobenius, lies between the two; rounded outward."""

    at_least: float
    at_most: float


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
    entries = [
        P[i, j] if i == j else 2 * P[i, j]
        for i, j in zip(row.tolist(), column.tolist(), strict=True)
    ]
    return arb_mat([[entry] for entry in [*entries, *[arb(0)] * (basis.size - len(entries))]])


def _solution(game: BallGame, found: Enclosed | None = None) -> Content:
    """P in balanced units, how far about it the solution is, and what makes A - S P Hurwitz."""
    found = found or enclose_solution(game)
    up, own, n = matrix(np.diag(found.units)), game.scaled(found.units), len(found.units)
    P = up * found.P * up
    reach = _WIDER * norm(entry.rad() for entry in P.entries()) + _LEAST * norm(P.entries())
    middle = [[entry.mid().str(_DIGITS, radius=False) for entry in row] for row in P.tolist()]
    around = P + arb_mat(n, n, [symmetric(reach)] * n**2)
    return {"units": found.units, "P": [middle], "reach": float(reach)} | _modes(
        own.A - own.S() * around
    )


def _modes(A: arb_mat) -> Content:
    found = counted(A)
    if found is None:
        raise NoSolutionError("a mode may lie on the axis; there is nothing to certify")
    return {"unstable": found.unstable, "rate": 0.0, "H": found.H, "turn": found.turn}
