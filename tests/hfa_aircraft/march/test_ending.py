"""Outcomes of flights, each at a state of its own."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from hfa_aircraft.march.ending import (
    PATIENCE,
    Endings,
    EndRule,
    Motion,
    Outcome,
    Patience,
    all_finite,
    has_decayed,
    is_at_rest,
    is_within,
    settled,
)
from hfa_aircraft.march.march import History, Rows, march

STATES = np.array(
    [[0.1, 0.0], [0.5, 0.0], [3.0, 0.0], [200.0, 0.0], [math.nan, 0.0], [0.0, math.inf]]
)
OUTCOMES = [
    Outcome.CONVERGED,
    Outcome.UNDECIDED,
    Outcome.LEFT,
    Outcome.DIVERGED,
    Outcome.DIVERGED,
    Outcome.DIVERGED,
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
    """x1' = x1, x2' = -x2: a flight with x1 = 0 converges, one with x1 > 0 leaves the limits."""
    starts = np.array([[0.0, 1.0], [0.1, 1.0], [1e-9, 1.0]])
    loop = Rows(lambda x, _: x * [1.0, -1.0], starts, 0.05)
    history, ends = march(loop, 100, over=RULE.over, keep=False)
    outcomes = RULE.outcomes(history.states[:, 0]).tolist()
    assert outcomes == [Outcome.CONVERGED, Outcome.LEFT, Outcome.CONVERGED]
    times = [math.log(5.0), math.log(20.0), math.log(5.0)]
    assert ends * history.step == pytest.approx(times, abs=0.05)


#: Motions x = start e^(growth t) cos(frequency t) + shift: start, growth, frequency, shift, outcome.
MOTIONS = [
    (1.0, -0.5, 0.0, 0.0, Outcome.CONVERGED),
    (1.0, 0.0, 6.0, 0.0, Outcome.CYCLES),
    (1.0, -0.5, 0.0, 0.5, Outcome.ELSEWHERE),
    (1.0, 0.1, 0.0, 0.0, Outcome.LEFT),
    (-1.0, 0.1, 0.0, 0.0, Outcome.LEFT),
    (1.0, -0.002, 6.0, 0.0, Outcome.UNDECIDED),
    (1.0, 0.002, 6.0, 0.0, Outcome.UNDECIDED),
]
#: Radius of the ball.
NEAR = 0.05


def ended() -> tuple[Endings, list[float]]:
    """Return the ends of `MOTIONS`, watched in windows of 1 s for 60 s, and their times, s."""
    start, growth, frequency, shift = np.array([motion[:4] for motion in MOTIONS]).T
    a = growth + 1j * frequency
    starts = np.column_stack([start, np.zeros(len(a)), a.real, a.imag, shift])

    def rate(x: np.ndarray, _: np.ndarray) -> np.ndarray:
        re, im, by, turn, _ = x.T
        return np.column_stack([by * re - turn * im, turn * re + by * im, *np.zeros((3, len(x)))])

    def motion(flown: History) -> Motion:
        x = flown.states[:, :, 0] + flown.states[:, :, 4]
        half_range = (x.max(axis=1) - x.min(axis=1)) / 2.0
        return Motion(np.abs(x).max(axis=1) / NEAR, half_range[:, None] / NEAR)

    count = len(MOTIONS)
    far = np.array([5.0, 5.0, *[np.inf] * 3])
    endings = Endings(
        (np.tile(-far, (count, 1)), np.tile(far, (count, 1))),
        motion,
        60,
        enough=np.full(count, 2),
        stays=np.ones(count, dtype=bool),
        stable=np.ones(count, dtype=bool),
        counted=1,
        patience=PATIENCE,
    )
    loop = Rows(rate, starts, 0.02)
    _, ends = march(loop, 50 * 60, over=endings.over, window=50, keep=False)
    endings.close()
    return endings, (0.02 * ends).tolist()


def test_motions_end_as_their_formulas_do() -> None:
    """Each motion of known form has its outcome, and all but the undecided end early."""
    endings, times = ended()
    outcomes = endings.outcomes.tolist()
    assert outcomes == [outcome for *_, outcome in MOTIONS]
    undecided = [outcome == Outcome.UNDECIDED for outcome in outcomes]
    assert [time == pytest.approx(60.0) for time in times] == undecided
    left = math.log(5.0) / 0.1
    assert times[3] == times[4] == math.ceil(left)
    assert endings.left_at[3:5].tolist() == [math.ceil(left / 0.02)] * 2
    np.testing.assert_allclose(endings.left_with[3:5, 0], [5.0, -5.0], atol=0.01)
    assert endings.nearest[0] <= 1.0


QUICK = Patience(
    standing=3, stands=0.1, elsewhere=2.0, block=2, cycles=3.0, same=0.1, growth=2, grown=1.02
)
#: Ten windows, more than any ending of `QUICK` needs.
WINDOWS = 10
STEADY = 4.0


def watched(
    distances: list[float], swings: list[float], *, stays: bool, stable: bool, enough: int
) -> tuple[str, int]:
    """Return how a flight with these motions ends, and the number of windows until then."""
    distances += distances[-1:] * (WINDOWS - len(distances))
    swings += swings[-1:] * (WINDOWS - len(swings))
    limit = np.ones((1, 1))
    endings = Endings(
        (-limit, limit),
        lambda flown: Motion(
            np.array(distances[flown.first :][:1]), np.array([swings[flown.first :][:1]])
        ),
        WINDOWS,
        enough=np.array([enough]),
        stays=np.array([stays]),
        stable=np.array([stable]),
        counted=1,
        patience=QUICK,
    )
    for number in range(WINDOWS):
        flown = History(1.0, number, np.zeros((1, 2, 1)), np.zeros((1, 2, 0)), np.zeros(1, int))
        if endings.over(flown).any():
            return endings.outcomes[0], number + 1
    endings.close()
    return endings.outcomes[0], WINDOWS


@pytest.mark.parametrize(
    ("distances", "swings", "options", "ends"),
    [
        # in the ball for two windows, without going out, and not farther than before
        ([5.0, 1.0], [0.0], {}, (Outcome.CONVERGED, 3)),
        ([5.0, 0.5, 0.4], [0.0], {"enough": 3}, (Outcome.CONVERGED, 4)),
        ([0.5, 1.1, 0.5, 0.4], [0.0], {}, (Outcome.CONVERGED, 4)),
        ([0.5, 0.6, 0.7, 0.6], [0.0], {}, (Outcome.CONVERGED, 4)),
        # until the full duration where nothing else ends it, also about an unstable equilibrium
        ([0.5], [0.0], {"stays": False}, (Outcome.CONVERGED, 10)),
        ([1.1], [0.0], {"stays": False}, (Outcome.UNDECIDED, 10)),
        (
            [0.1, *[0.5] * 7, 0.505],
            [0.0],
            {"stays": False, "stable": False},
            (Outcome.CONVERGED, 10),
        ),
        ([*[0.5] * 8, 0.515], [0.0], {"stays": False, "stable": False}, (Outcome.UNDECIDED, 10)),
        ([*[0.5] * 8, 0.515], [0.0], {"stays": False}, (Outcome.CONVERGED, 10)),
        # at another equilibrium for three windows
        ([3.0], [0.3], {}, (Outcome.ELSEWHERE, 3)),
        ([3.0], [0.3, 0.3, 0.31, 0.3], {}, (Outcome.ELSEWHERE, 6)),
        ([2.0], [0.0], {}, (Outcome.UNDECIDED, 10)),
        ([math.inf], [0.0], {}, (Outcome.UNDECIDED, 10)),
        # the least swings of three blocks of two windows
        ([9.0], [STEADY], {}, (Outcome.CYCLES, 6)),
        ([9.0], [9.0, STEADY, STEADY, 9.0, 9.0, STEADY], {}, (Outcome.CYCLES, 6)),
        ([9.0], [4.0, 4.0, 4.3, 4.3, 4.0], {}, (Outcome.CYCLES, 6)),
        ([9.0], [4.3, 4.3, 4.0, 4.0, 4.3], {}, (Outcome.CYCLES, 6)),
        ([9.0], [4.0, 4.0, 4.5, 4.5, 4.0], {}, (Outcome.CYCLES, 10)),
        ([9.0], [4.0, 4.0, 4.1, 4.1, 4.2, 4.2, 4.3, 4.3, 4.4], {}, (Outcome.UNDECIDED, 10)),
        ([9.0], [4.4, 4.4, 4.3, 4.3, 4.2, 4.2, 4.1, 4.1, 4.0], {}, (Outcome.UNDECIDED, 10)),
        ([9.0], [2.9], {}, (Outcome.UNDECIDED, 10)),
    ],
)
def test_each_motion_ends_in_the_first_window_that_decides(
    distances: list[float], swings: list[float], options: dict[str, Any], ends: tuple[str, int]
) -> None:
    defaults = {"stays": True, "stable": True, "enough": 2}
    assert watched(list(distances), list(swings), **{**defaults, **options}) == ends


def test_where_a_flight_left_its_limits_is_kept() -> None:
    """Flights 3 and 1 of four leave at the steps 12 and 13 with their states there."""
    limit = np.full((4, 2), 5.0)
    endings = Endings(
        (-limit, limit),
        lambda flown: Motion(np.full(3, 9.0), np.full((3, 1), 1.0)),
        9,
        enough=np.ones(4),
        stays=np.ones(4, dtype=bool),
        stable=np.ones(4, dtype=bool),
        counted=1,
        patience=QUICK,
    )
    states = np.zeros((3, 4, 3))
    states[0, 2] = [1.0, -6.0, 0.0]
    states[0, 3] = [7.0, 7.0, 7.0]
    states[1, 3, 0] = math.nan
    states[2, :, 2] = 9.0  # without limits
    over = endings.over(History(0.1, 10, states, np.zeros((3, 4, 0)), np.array([3, 1, 0])))
    assert over.tolist() == [[False] * 3 + [True]] * 2 + [[False] * 4]
    assert endings.outcomes.tolist() == [Outcome.UNDECIDED, Outcome.LEFT] * 2
    assert endings.left_at[[3, 1]].tolist() == [12, 13]
    np.testing.assert_array_equal(endings.left_with[[3, 1]], [[1.0, -6.0], [math.nan, 0.0]])


def test_flights_from_trims_end_when_all_have_settled() -> None:
    """x' = -x from 1 and 0: both flights end when the first moves by less than 1e-3 a second."""
    loop = Rows(lambda x, _: -x, np.array([[1.0], [0.0]]), 0.01)
    _, ends = march(loop, 5000, over=settled(np.array([1e-3])), window=100, keep=False)
    moved = math.log((1.0 - math.exp(-1.0)) / 1e-3)
    assert ends.tolist() == [100 * (math.ceil(moved) + 1)] * 2


@pytest.mark.parametrize("value", [0.5, 1.0, 1.5, -1.0, math.inf, math.nan])
def test_limits_are_the_same_for_arrays_and_expressions(value: float) -> None:
    """Infinite and undefined values are outside infinite limits too."""
    least, most = np.array([-0.5, -math.inf]), np.array([1.0, math.inf])
    x, low, high = (ca.SX.sym(name, 2) for name in ("x", "low", "high"))
    function = ca.Function("within", [x, low, high], [is_within(x, low, high), all_finite(x)])
    for states in ([value, 0.0], [0.0, value]):
        inside, finite = (bool(each) for each in function(states, least, most))
        assert inside == is_within(np.array([states]), least, most)[0]
        assert finite == math.isfinite(value)
        assert inside == (math.isfinite(value) and -0.5 <= states[0] <= 1.0)


def test_a_value_has_decayed_to_its_fraction() -> None:
    """The value e^(-2t) of x' = -x has decayed to 5 % from t = ln(20) / 2 on.

    Neither an infinite reference nor a value that is not a number counts.
    """
    times = np.array([1.0, 1.49, 1.50, 2.0])
    decayed = has_decayed(np.exp(-2.0 * times), np.ones(4), 0.05)
    np.testing.assert_array_equal(decayed, times >= math.log(20.0) / 2.0)
    undefined = has_decayed(np.array([math.inf, math.nan]), np.array([math.inf, 1.0]), 0.05)
    assert not undefined.any()


def test_a_flight_at_rest_hardly_moves_in_the_same_time_again() -> None:
    """A rate of .99e-3 nominal values in 10 s is at rest, a rate of 1.01e-3 is not."""
    rates = np.array([[0.99e-3, 0.0], [1.01e-3, 0.0], [0.0, -2.01e-3]])
    assert is_at_rest(rates, 10.0, np.array([1.0, 2.0])).tolist() == [True, False, False]
