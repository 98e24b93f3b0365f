"""Search for the smallest δ with a solution.

Existence at a δ may be undecided because of rounding. Non-existence is reported only if it is
shown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Largest δ of the search, as a multiple of the first one.
MOST = 1e12
#: Smallest δ of the search, as a fraction of the first one.
LEAST = 1e-12
#: Distance of an interpolated δ from the zero of the line, toward the middle of the interval:
#: this times the square of the width of the interval, as a difference of log δ.
INWARD = 0.2
#: Before a δ is reported to have no solution, these fractions of it are tried. A solution there
#: shows that the refusal was rounding.
BELOW = (0.9, 0.5, 0.1, 0.01)


class Answer(NamedTuple):
    """Answer to the question whether the game has a solution at one δ.

    exists: True or False if shown, None if rounding leaves the existence undecided
    reason: reason why no solution exists or why existence is undecided; "" if a solution exists
    condition: name of the condition that fails or is undecided, if several conditions are examined;
        otherwise ""
    gain: lower bound of the smallest δ with a solution, or 0 if none is known
    excess: number that increases continuously through 0 at the smallest δ, or nan if none is known
    """

    exists: bool | None
    reason: str = ""
    condition: str = ""
    gain: float = 0.0
    excess: float = math.nan


class Bracket(NamedTuple):
    """Bounds of the smallest δ with a solution: refused < inf{δ : a solution exists} <= value.

    value: smallest δ found to have a solution, or 0 if a solution exists at every evaluated δ
    refused: largest δ below `value` shown to have no solution, or 0 if there is none
    ending: existence at the next evaluated δ below `value`
    """

    value: float
    refused: float
    ending: Answer


class _Answers:
    """Cache of the existence of a solution at each δ that a search has evaluated."""

    def __init__(self, existence_at: Callable[[float], Answer]) -> None:
        self._existence_at = existence_at
        self._known: dict[float, Answer] = {}

    def at(self, delta: float) -> Answer:
        """Return whether a solution exists at δ = delta. Each δ is evaluated only once."""
        if delta not in self._known:
            self._known[delta] = self._existence_at(delta)
        return self._known[delta]

    @property
    def good(self) -> float:
        """Smallest δ found to have a solution, or inf if there is none."""
        return min(self._deltas(True), default=math.inf)

    @property
    def refused(self) -> float:
        """Largest δ below `good` shown to have no solution, or 0 if there is none."""
        return max((delta for delta in self._deltas(False) if delta < self.good), default=0.0)

    @property
    def next_to_good(self) -> float:
        """Largest δ below `good` that was evaluated, or 0 if there is none."""
        return max((delta for delta in self._known if delta < self.good), default=0.0)

    @property
    def next_to_refused(self) -> float:
        """Smallest δ above `refused` that was evaluated."""
        return min(delta for delta in self._known if delta > self.refused)

    def _deltas(self, exists: bool) -> list[float]:
        return [delta for delta, answer in self._known.items() if answer.exists is exists]


def smallest_delta(
    existence_at: Callable[[float], Answer],
    begin: float,
    tolerance: float,
    progress: Progress | None = None,
) -> Bracket:
    """Return bounds of the smallest δ with a solution, by bisection and interpolation of log δ.

    Both bounds are 0 if a solution exists at every evaluated δ down to `LEAST` times `begin`.

    existence_at: function δ -> existence. The set of δ with a solution must be an interval
        (δ_min, inf].
    begin: a δ that should have a solution
    tolerance: relative width of the bounds, if no δ is undecided
    progress: called during the search, or None

    Raises NoSolutionError if no δ up to `MOST` times `begin` is found to have a solution.
    """
    report = progress or (lambda *_: None)
    answers = _Answers(existence_at)
    _climb(answers, begin)
    while True:
        least = answers.good
        _descend(answers, begin * LEAST)
        if not answers.next_to_good:
            return Bracket(0.0, 0.0, Answer(True))
        steps = math.ceil(math.log2(math.log(4.0) / math.log1p(tolerance)))
        _narrow(answers, lambda: (answers.next_to_good, answers.good), tolerance)
        report(steps // 2, steps)
        if answers.refused:
            _narrow(answers, lambda: (answers.refused, answers.next_to_refused), tolerance)
        value = answers.good
        for part in BELOW:
            answers.at(part * (answers.refused or answers.next_to_good))
        report(steps, steps)
        if answers.good == value:
            return Bracket(value, answers.refused, answers.at(answers.next_to_good))
        assert answers.good < least  # each round begins with a smaller δ


def _climb(answers: _Answers, begin: float) -> None:
    """Evaluate `begin`, 4 `begin`, 16 `begin` and so on, until a δ has a solution."""
    delta = begin
    while not answers.at(delta).exists:
        last = answers.at(delta)
        delta *= 4.0
        if delta > begin * MOST:
            most = f"delta up to {delta / 4.0:.4g}"
            if last.exists is None:
                raise NoSolutionError(
                    f"rounding hides whether any {most} has a solution: {last.reason}; check the "
                    "scaling of A, B, Q and R"
                )
            raise NoSolutionError(
                f"the game has no solution for any {most}: {last.reason}; check the scaling of "
                "A, B, E, Q and R"
            )


def _descend(answers: _Answers, least: float) -> None:
    """Evaluate smaller δ, each 1/4 of the one before, until one has no solution."""
    delta = answers.good / 4.0
    while delta >= least and answers.at(delta).exists is not False:
        delta /= 4.0


def _narrow(answers: _Answers, ends: Callable[[], tuple[float, float]], tolerance: float) -> None:
    """Divide the interval of δ until the ratio of its ends is at most 1 + tolerance."""
    low, high = ends()
    bisects = False
    while low and high > low * (1.0 + tolerance):
        width = math.log(high / low)
        share = 0.5 if bisects else _share(answers.at(low), answers.at(high), width, tolerance)
        answers.at(low * math.exp(share * width))
        low, high = ends()
        bisects = not bisects and low > 0.0 and math.log(high / low) > 0.5 * width


def _share(low: Answer, high: Answer, width: float, tolerance: float) -> float:
    """Return where to divide an interval of log δ, from 0 at its lower end to 1."""
    # The interval is divided near the zero of the line through the excess at both ends. The excess
    # of the next δ then probably has the sign of that of the nearer end, so that the interval
    # becomes much shorter. Without an excess, the interval is halved.
    # Source: Oliveira and Takahashi, ACM Transactions on Mathematical Software 47 (2020), 5.
    if not low.excess < 0.0 < high.excess:
        return 0.5
    zero = low.excess / (low.excess - high.excess)
    inward = max(INWARD * width, 0.4 * tolerance / width)
    return min(zero + inward, 0.5) if zero < 0.5 else max(zero - inward, 0.5)
