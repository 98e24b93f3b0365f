"""What the certificate of a solution, or of a critic, holds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from flint import arb_mat

from controller.game.zero_sum import Game
from hfa_support.errors import NoSolutionError
from verification.arithmetic.balls import doubles, map_entries, matrix, norm, symmetric
from verification.enclosures.game_balls import BallGame, enclose_solution
from verification.enclosures.inertia import counted
from verification.enclosures.trim_branch import TrimBranch
from verification.enclosures.trim_family import Family
from verification.proof.certificate_file import flights_claim
from verification.proof.delta_proof import frequencies_around_axis
from verification.proof.solution_proof import CriticProof, Distance, SolutionProof, games_of
from verification.proof.stated_model import stated_point

#: The certificate states a radius and a reach this much larger than proved: the checker encloses in another way.
_WIDER = 4.0
#: Least reach, relative: far below what a statement needs, far above the rounding of the checker.
_LEAST = 1e-28
#: Part of a distance by which the certificate states it wider.
_SHARP = 1e-6
#: Decimals of an entry of P: the checker's own digits, and some.
_DIGITS = 55
Parts = tuple[dict[str, Any], dict[str, list[dict[str, Any]]]]


def solution_claim(proof: SolutionProof, family: Family | None, degrees: float | None) -> Parts:
    """Statement and boxes of a proved solution, with the bracket of delta_min."""
    assert proof.delta is not None
    about = _About(proof.game, family, degrees)
    wide, sharp = about.wide, about.sharp
    claim = about.claim | {
        "table": _table(wide.gain_of(matrix(proof.P)), {"P": proof.P}),
        "distances": {"P": [0.0, _WIDER * proof.radius]},
        "delta_min": [proof.delta.refused, proof.delta.value],
    }
    below = sharp.with_delta(proof.delta.refused)
    axis = frequencies_around_axis(below) if "axis" in proof.delta.reason else None
    return claim, {
        "solution": [about.point(True) | about.solution(wide)],
        "loop": [about.point(True) | _modes(wide.A - wide.B * wide.gain_of(matrix(proof.P)))],
        "modes": [about.point(False) | _modes(sharp.A)],
        "value": [about.point(False) | about.solution(sharp.with_delta(proof.delta.value))],
        "refused": [about.point(False) | ({"axis": axis} if axis else about.solution(below))],
    }


def critic_claim(proof: CriticProof, family: Family | None, degrees: float | None) -> Parts:
    """Statement and boxes of the distances of a critic. NoSolutionError when a mode of its loop may lie on the axis."""
    about = _About(proof.game, family, degrees)
    given = {name: value[:, None] if name == "W" else value for name, value in proof.given.items()}
    gain = matrix(given["K"]) if "K" in given else about.sharp.gain_of(matrix(given["P"]))
    distances = {name: _widened(found) for name, found in proof.distances.items()}
    return about.claim | {"table": _table(gain, given), "distances": distances}, {
        "solution": [about.point(False) | about.solution(about.sharp)],
        "loop": [about.point(False) | _modes(about.sharp.A - about.sharp.B * gain)],
    }


def _table(gain: arb_mat, given: dict[str, np.ndarray]) -> dict[str, Any]:
    """What is compared with the exact solution, and u = -K x, K rounded to doubles, as a loop without memory."""
    K = doubles(gain)
    n = K.shape[1]
    return {"K": K, "M": np.zeros((n, n)), "N": np.zeros((n, n)), "X": np.zeros((n, n))} | given


def _widened(found: Distance) -> list[float]:
    """The solution in a certificate is not as sharp as the proof's own."""
    return [max(0.0, found.at_least * (1.0 - _SHARP) - _LEAST), found.at_most * (1.0 + _SHARP) + _LEAST]


class _About:
    """The game and the trim that a statement is about."""

    def __init__(self, game: Game, family: Family | None, degrees: float | None) -> None:
        self.sharp, self.wide = games_of(game, family, degrees)
        own = {"E": game.E, "delta": game.delta if np.isfinite(game.delta) else "inf"}
        own |= {"Q": (game.Q + game.Q.T) / 2, "R": (game.R + game.R.T) / 2}
        self._points: dict[bool, dict[str, Any]] = {}
        if family is None or degrees is None:
            self._points = {decimals: {"dihedral_deg": [0.0, 0.0]} for decimals in (True, False)}
            self.claim: dict[str, Any] = {"A": game.A, "B": game.B, "dihedral_deg": [0.0, 0.0], "game": own}
            return
        self.claim = flights_claim(family, degrees, degrees) | {"game": own}
        for decimals in (True, False):
            flights = replace(family, spread=None, decimals=decimals)
            self._points[decimals] = stated_point(degrees, TrimBranch(flights))

    def point(self, decimals: bool) -> dict[str, Any]:
        """The trim, about the decimals as they were read or about the doubles."""
        return {"unstable": 0, "rate": 0.0} | self._points[decimals]

    def solution(self, game: BallGame) -> dict[str, Any]:
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
