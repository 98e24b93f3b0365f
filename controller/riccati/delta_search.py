"""Search for the smallest δ with a solution."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Largest and smallest δ of the search, as multiples of the first one.
MOST = 1e12
LEAST = 1e-12
#: Relative distances from the smallest δ at which a clearly positive excess is searched for,
CLEAR_STEPS = (1e-4, 1e-3, 1e-2, 0.1, 1.0)
#: and the excess that is clearly positive, because it is not rounding.
ROUNDED = 2e-12


class Answer(NamedTuple):
    """Answer to the question whether the game has a solution at one δ.

    exists: whether it has one
    reason: why not
    condition: name of the violated condition, if several conditions are examined, otherwise ""
    excess: number that passes through 0 at the smallest δ, or nan if none is known
    is_rounding: whether arithmetic failed, so that existence is not known
    """

    exists: bool
    reason: str = ""
    condition: str = ""
    excess: float = math.nan
    is_rounding: bool = False

    @property
    def is_refused(self) -> bool:
        """Whether no solution exists, as a fact of the game and not of the arithmetic."""
        return not (self.exists or self.is_rounding)


class Bracket(NamedTuple):
    """Bounds of the smallest δ with a solution: refused < inf{δ : a solution exists} <= value.

    value: smallest δ found to have a solution, or 0 if a solution exists at every evaluated δ
    refused: largest δ without a solution, or 0
    ending: answer at `refused`
    """

    value: float
    refused: float
    ending: Answer


def smallest_delta(
    existence_at: Callable[[float], Answer],
    begin: float,
    tolerance: float,
    progress: Progress | None = None,
) -> Bracket:
    """Return bounds of the smallest δ with a solution, by bisection of log δ.

    existence_at: function δ -> existence. The set of δ with a solution is an interval (δ_min, inf].
    begin: a δ that should have a solution
    tolerance: relative width of the bounds

    Raises NoSolutionError if no δ up to `MOST` times `begin` has a solution.
    """
    high = begin
    while not (answer := existence_at(high)).exists:
        high *= 4.0
        if high > begin * MOST:
            raise NoSolutionError(
                f"the game has no solution for any delta up to {high / 4.0:.4g}: {answer.reason}; "
                "check the scaling of A, B, E, Q and R"
            )
    accepted = answer
    low = high / 4.0
    while (answer := existence_at(low)).exists:
        accepted = answer
        high, low = low, low / 4.0
        if low < begin * LEAST:
            return Bracket(0.0, 0.0, answer)
    while high > low * (1.0 + tolerance):
        middle = math.sqrt(low * high)
        found = existence_at(middle)
        if found.exists:
            high, accepted = middle, found
        else:
            low, answer = middle, found
        if progress is not None:
            progress(min(1.0, tolerance / math.log(high / low)), 1.0)
    if accepted.excess < 0.0:
        high = _zero_of_excess(existence_at, high, tolerance)
    if answer.is_rounding:
        low, answer = _largest_refused(existence_at, low, answer, tolerance)
    return Bracket(high, low, answer)


def _largest_refused(
    existence_at: Callable[[float], Answer], undecided: float, answer: Answer, tolerance: float
) -> tuple[float, Answer]:
    """Return the largest δ shown to have no solution below an undecided one, and its answer.

    Without one down to half the undecided δ, 0 and the answer at the undecided δ are returned.
    """
    high, low = undecided, 0.0
    for step in CLEAR_STEPS:
        found = existence_at(undecided / (1.0 + step))
        if found.is_refused:
            low, answer = undecided / (1.0 + step), found
            break
    while low > 0.0 and high > low * (1.0 + tolerance):
        middle = math.sqrt(low * high)
        found = existence_at(middle)
        if found.is_refused:
            low, answer = middle, found
        else:
            high = middle
    return low, answer


def _zero_of_excess(
    existence_at: Callable[[float], Answer], smallest: float, tolerance: float
) -> float:
    """Return the δ >= smallest above which the excess is positive, by bisection of log δ.

    The sign of the excess is more accurate than the rounding that `existence_at` permits, unless it
    is rounding at every δ, as in a game whose P is singular. Then `smallest` is returned.
    """
    low = smallest
    clear = (smallest * (1.0 + step) for step in CLEAR_STEPS)
    high = next((delta for delta in clear if existence_at(delta).excess > ROUNDED), smallest)
    while high > low * (1.0 + tolerance):
        middle = math.sqrt(low * high)
        if existence_at(middle).excess < 0.0:
            low = middle
        else:
            high = middle
    return high
