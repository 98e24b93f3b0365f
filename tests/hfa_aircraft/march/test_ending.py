"""Outcomes of flights, each at a state of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfa_aircraft.march.ending import EndRule, Outcome
from hfa_aircraft.march.march import Rows, march

STATES = np.array(
    [[0.1, 0.0], [0.5, 0.0], [3.0, 0.0], [200.0, 0.0], [math.nan, 0.0], [0.0, math.inf]]
)
OUTCOMES = [
    Outcome.CONVERGED,
    Outcome.UNDECIDED,
    Outcome.LEFT,
    Outcome.LOST,
    Outcome.LOST,
    Outcome.LOST,
]
RULE = EndRule(
    np.array([100.0, 100.0]),
    inside=lambda x: np.abs(x[:, 0]) < 2.0,
    converged=lambda x: np.linalg.norm(x, axis=1) < 0.2,
)


def test_each_state_has_its_outcome() -> None:
    """A state that is not a number or far away is lost, even if it is also beyond a limit."""
    assert RULE.outcomes(STATES).tolist() == OUTCOMES


@pytest.mark.parametrize(
    "rule", [RULE, EndRule(100.0), EndRule(100.0, inside=RULE.inside)], ids=["all", "far", "limits"]
)
def test_a_flight_is_over_with_every_outcome_but_one(rule: EndRule) -> None:
    """A flight is over as soon as it is not undecided."""
    over = rule.outcomes(STATES) != Outcome.UNDECIDED
    assert 0 < over.sum() < len(STATES)
    np.testing.assert_array_equal(rule.is_over(STATES), over)


def test_flights_of_a_saddle_end_as_their_exponentials_do() -> None:
    """x1' = x1, x2' = -x2: a flight with x1 = 0 converges, one with x1 > 0 leaves the limits.

    A rule with limits that are twice as wide, planted here, ends the flight later.
    """
    starts = np.array([[0.0, 1.0], [0.1, 1.0], [1e-9, 1.0]])

    def flown(rule: EndRule) -> tuple[list[str], np.ndarray]:
        loop = Rows(lambda x, _: x * [1.0, -1.0], starts, 0.05, lambda x, _: x[:, :0])
        history, ends = march(loop, 100, over=rule.over, keep=False)
        return rule.outcomes(history.states[:, 0]).tolist(), ends * loop.step

    outcomes, times = flown(RULE)
    assert outcomes == [Outcome.CONVERGED, Outcome.LEFT, Outcome.CONVERGED]
    assert times == pytest.approx([math.log(5.0), math.log(20.0), math.log(5.0)], abs=0.05)
    _, later = flown(EndRule(100.0, lambda x: np.abs(x[:, 0]) < 4.0, RULE.converged))
    assert later[1] - times[1] == pytest.approx(math.log(2.0), abs=0.05)
