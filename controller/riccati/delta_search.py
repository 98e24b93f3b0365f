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
#: Relative distance of the two δ from which the excess is extrapolated to 0.
ZERO_STEP = 1e-4
#: A smaller excess may be rounding.
ROUNDED = 1e-11


class Answer(NamedTuple):
    """Answer to the question whether the game has a solution at one δ.

    exists: whether it has one
    reason: why not
    condition: name of the violated condition, if several conditions are examined, otherwise ""
    excess: number that passes through 0 at the smallest δ, or nan if none is known
    """

    exists: bool
    reason: str = ""
    condition: str = ""
    excess: float = math.nan


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
        high = _zero_of_excess(existence_at, high)
    return Bracket(high, low, answer)


def _zero_of_excess(existence_at: Callable[[float], Answer], smallest: float) -> float:
    """Return the δ at which the excess passes through 0, by a line through two larger δ.

    If the excess is rounding there also, as in a game whose P is singular at every δ, `smallest` is
    returned, at which its sign is rounding.
    """
    near, far = smallest * (1.0 + ZERO_STEP), smallest * (1.0 + 2.0 * ZERO_STEP)
    excess, excess_far = existence_at(near).excess, existence_at(far).excess
    if not ROUNDED < excess < excess_far:
        return smallest
    zero = near - excess * (far - near) / (excess_far - excess)
    return max(smallest, zero)
