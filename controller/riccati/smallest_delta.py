"""Smallest delta for which a game has a value, and reasons why no delta has one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from controller.game.zero_sum import Game
from controller.riccati.certificate import certified_solution, form_of
from controller.riccati.form import Answer, Form
from controller.riccati.frequency_response import loop_gain
from controller.riccati.meaning import closed_loop
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Relative accuracy of delta_min.
TOLERANCE = 1e-6
#: The search is made in states in which the eigenvalues of the X without disturbance, the smallest
#: X of all, are between this and its inverse.
LEVEL = 4.0
#: Largest and smallest δ of the search, as multiples of the first one.
MOST = 1e12
LEAST = 1e-12
#: Relative distances from the smallest δ at which a clearly positive excess is searched for,
CLEAR_STEPS = (1e-4, 1e-3, 1e-2, 0.1, 1.0)
#: and the excess that is clearly positive, because it is not rounding.
ROUNDED = 2e-12
#: If delta exceeds delta_min by a smaller fraction, the poor conditioning of P may be the reason
#: why a test fails.
CLOSE = 0.01


class ModeError(NoSolutionError):
    """Raised if a mode that no input reaches, or an undamped mode without cost, is the reason why
    no delta has a solution.
    """


class DeltaMin(NamedTuple):
    """Bounds of delta_min = inf{δ : a solution exists}: refused < delta_min <= value.

    value / refused is at most 1 + 1e-6, or more if rounding hides the minimum (`uncertain`). Both
    are 0 if the disturbance does not affect the cost.

    value: smallest delta found to have a solution
    refused: largest delta below `value` shown to have no solution, or 0 if there is none
    """

    value: float
    refused: float

    def margin(self, delta: float) -> float:
        """Return the ratio delta / delta_min, or inf if delta_min is 0.

        If the ratio is above 1, the game with this delta has a value.
        """
        return delta / self.value if self.value > 0.0 else math.inf

    @property
    def uncertain(self) -> bool:
        """True if rounding leaves delta_min uncertain by more than the tolerance of the search.

        The result is also True if delta_min is not 0 and no delta was shown to have no solution.
        """
        return self.value > self.refused * (1.0 + 2.0 * TOLERANCE)

    def advice(self, delta: float) -> str:
        """Return a clause for an error message that compares a delta with delta_min.

        The clause recommends a larger delta unless delta exceeds delta_min by at least `CLOSE`
        (relative).
        """
        what = "; choose a larger delta"
        excess = self.margin(delta) - 1.0
        if self.refused < delta < self.value:  # a value may or may not exist
            verb = "rounding leaves" if self.uncertain else "lies"
            between = f"between {self.refused:.9g} and {self.value:.9g}"
            where = f"too close to delta_min, which {verb} {between}"
        elif delta < self.value:
            where = f"below delta_min = {self.value:.7g}"
        elif excess < CLOSE:
            where = f"only {100.0 * excess:.2g} % above delta_min = {self.value:.7g}"
        else:
            where = f"well above delta_min = {self.value:.7g}"
            what = ""
        return f"delta = {delta:.9g} is {where}{what}"


def minimum_delta(game: Game) -> DeltaMin:
    """Return bounds of the smallest δ for which a game has a value.

    The bounds differ by 1e-6 relative, or by more if rounding hides the minimum.

    The delta of the game itself does not affect the result.

    Raises NoSolutionError if no δ has a solution. The message names the responsible mode if one is
    found.

    >>> import hfa
    >>> from controller import minimum_delta
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> round(minimum_delta(game).value, 4)
    1.0
    """
    return smallest_delta_of(form_of(game))


def smallest_delta_of(form: Form, progress: Progress | None = None) -> DeltaMin:
    """Return bounds of the smallest δ for which a game has a value, by bisection of log δ on
    `existence`.

    The search begins at twice the L2 gain of the policy without disturbance, which is at least
    delta_min. Both bounds are 0 if the disturbance does not affect the cost.

    form: form of the game
    progress: called during the search, or None

    Source: Basar and Bernhard, H-infinity Optimal Control, Theorems 4.11 and 3.7.

    Raises NoSolutionError if no δ has a solution, and ModeError if a mode is the reason.
    """
    try:
        lqr = certified_solution(form.with_delta(math.inf).balanced())
    except NoSolutionError as failure:
        if cause := form.obstacle():
            raise ModeError(cause) from failure
        raise NoSolutionError(
            f"the problem without disturbance (delta = inf) is not certified: {failure}"
        ) from failure
    K, _ = lqr.form.gains(lqr.X)
    bound = loop_gain(closed_loop(lqr.form, K), is_discrete=form.is_discrete).high
    if bound == 0.0:
        return DeltaMin(0.0, 0.0)
    turn = lqr.form.levelling(lqr.X, LEVEL)
    level = lqr.form.turned(turn) if turn else lqr.form
    return _smallest_delta(lambda delta: level.with_delta(delta).existence(), 2.0 * bound, progress)


def _smallest_delta(
    existence_at: Callable[[float], Answer], begin: float, progress: Progress | None
) -> DeltaMin:
    """Return bounds of the smallest δ with a solution, by bisection of log δ.

    existence_at: function δ -> existence. The set of δ with a solution is an interval (δ_min, inf].
    begin: a δ that should have a solution

    Raises NoSolutionError if no δ up to `MOST` times `begin` has a solution.
    """
    high = begin
    while not (accepted := existence_at(high)).exists:
        high *= 4.0
        if high > begin * MOST:
            raise NoSolutionError(
                f"the game has no solution for any delta up to {high / 4.0:.4g}: {accepted.reason};"
                " check the scaling of A, B, E, Q and R"
            )
    low = high / 4.0
    while (found := existence_at(low)).exists:
        accepted = found
        high, low = low, low / 4.0
        if low < begin * LEAST:
            return DeltaMin(0.0, 0.0)
    while high > low * (1.0 + TOLERANCE):
        middle = math.sqrt(low * high)
        found = existence_at(middle)
        if found.exists:
            high, accepted = middle, found
        else:
            low = middle
        if progress is not None:
            progress(min(1.0, TOLERANCE / math.log(high / low)), 1.0)
    if accepted.excess < 0.0:
        high = _zero_of_excess(existence_at, high)
    return DeltaMin(high, low)


def _zero_of_excess(existence_at: Callable[[float], Answer], smallest: float) -> float:
    """Return the δ >= smallest above which the excess is positive, by bisection of log δ.

    The sign of the excess is more accurate than the rounding that `existence_at` permits, unless it
    is rounding at every δ, as in a game whose P is singular. Then `smallest` is returned.
    """
    low = smallest
    clear = (smallest * (1.0 + step) for step in CLEAR_STEPS)
    high = next((delta for delta in clear if existence_at(delta).excess > ROUNDED), smallest)
    while high > low * (1.0 + TOLERANCE):
        middle = math.sqrt(low * high)
        if existence_at(middle).excess < 0.0:
            low = middle
        else:
            high = middle
    return high


def why_refused(form: Form, failure: str, progress: Progress | None = None) -> str:
    """Return the reason why a game has no certified solution, and what to change, as one sentence.

    form: form of the game
    failure: text of the failed test of the certificate
    progress: called by the search for delta_min, or None

    Raises NoSolutionError if no delta has a solution.
    """
    smallest = smallest_delta_of(form, progress)
    verdict = f"not certified: {failure}"
    if form.delta <= smallest.refused:
        verdict = f"no value of the game: {form.existence().reason or failure}"
    return f"{verdict}; {smallest.advice(form.delta)}"
