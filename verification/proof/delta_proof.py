"""A proved bracket of delta_min, the smallest disturbance weight for which the game has a value."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from flint import acb, acb_mat, arb

from controller.riccati.balancing import balanced_units
from controller.riccati.smallest_delta import DeltaMin
from hfa_support.errors import NoSolutionError
from verification.arithmetic.balls import exact
from verification.enclosures.game_balls import BallGame, enclose_solution

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
    places = [*ends, *((a + b) / 2 for a, b in pairwise(ends))]
    hamiltonian = _hamiltonian(own)
    found = {_sign(_determinant(hamiltonian, frequency)): frequency for frequency in places}
    return (found[1], found[-1]) if {1, -1} <= set(found) else None


def _hamiltonian(game: BallGame) -> list[list[arb]]:
    """H = [[A, -S], [-Q, -A']]."""
    A, S, Q = game.A, game.S(), game.Q()
    top = [[*row, *other] for row, other in zip(A.tolist(), (-S).tolist(), strict=True)]
    low = [[*row, *other] for row, other in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    return top + low


def _determinant(hamiltonian: list[list[arb]], frequency: float) -> arb:
    """The real part of det(j ω I - H); its imaginary part is 0."""
    rows = [[acb(-entry) for entry in row] for row in hamiltonian]
    for i, row in enumerate(rows):
        row[i] += acb(0, exact(frequency))
    return acb_mat(rows).det().real


def _sign(value: arb) -> int:
    return 1 if value > 0 else -1 if value < 0 else 0
