"""The smallest disturbance weight for which the game has a value."""

from __future__ import annotations

import math
from typing import NamedTuple

from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError
from verification.riccati.derivations import certified_solution
from verification.riccati.existence import has_value
from verification.riccati.l2_gain import bounded_real_gain
from verification.riccati.solvability import lqr_obstacle

TOLERANCE = 1e-6
#: Closer to delta_min than this share of it, P is ill-conditioned enough to blame for a test that fails.
CLOSE = 0.01


class DeltaMin(NamedTuple):
    """delta_min = inf{δ : the game has a value}, bracketed: refused < delta_min <= value.

    value / refused <= 1 + 1e-6.  Both are 0 when the disturbance does not reach what is paid for.
    """

    value: float
    refused: float

    def margin(self, delta: float) -> float:
        """delta / delta_min: above 1 the game has a value."""
        return delta / self.value if self.value > 0.0 else math.inf

    def advice(self, delta: float) -> str:
        """Where delta stands and what to change when a solution at this delta fails a test."""
        if delta < self.value:
            return f"delta = {delta:.9g} is below delta_min = {self.value:.7g}; ask for a larger delta"
        excess = self.margin(delta) - 1.0
        if excess < CLOSE:
            above = f"{100.0 * excess:.2g} % above delta_min = {self.value:.7g}"
            return f"delta = {delta:.9g} is only {above}; ask for a larger delta"
        return f"delta = {delta:.9g} is well above delta_min = {self.value:.7g}; check the scaling of A, B, Q and R"


def minimum_delta(game: Game) -> DeltaMin:
    """Bisection of log δ on `existence.has_value`, to 1e-6 relative. The game's own delta plays no part.

    The set of good δ is an interval (delta_min, inf]: a disturbance that pays more can do less. The search
    starts above the L2 gain of the LQR policy, which is never below delta_min because that policy attains it.
    Raises NoSolutionError when already the problem without disturbance has no solution, naming the mode.
    Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11.
    """
    without_disturbance = game.with_delta(math.inf)
    try:
        P, _ = certified_solution(without_disturbance)
    except NoSolutionError as error:
        raise NoSolutionError(lqr_obstacle(game)) from error
    gain = bounded_real_gain(game, game.gain(P))
    if gain == 0.0:
        return DeltaMin(0.0, 0.0)
    upper = 2.0 * gain
    if not has_value(game.with_delta(upper)):
        raise NoSolutionError(
            f"delta = {upper:.4g} is twice the gain of the LQR policy and still without a value; "
            "check the scaling of A, B, Q and R"
        )
    lower = upper / 4.0
    while has_value(game.with_delta(lower)):
        lower, upper = lower / 4.0, lower
    while upper > lower * (1.0 + TOLERANCE):
        middle = math.sqrt(lower * upper)
        lower, upper = (lower, middle) if has_value(game.with_delta(middle)) else (middle, upper)
    return DeltaMin(upper, lower)
