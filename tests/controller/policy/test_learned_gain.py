"""Which gain flies: a given one, one for each tick, a frozen learned one, or one that is being learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flight_cases import SMALL, FlownCase
from reference_riccati import reference_solution, relative_error

from controller import Game, Scenario, fly, gain_law, learn
from controller.policy.learned_gain import baseline_gain, certified_gains, frozen_law, learned_value, online_law
from hfa_support import BadInputError, NoSolutionError

GAINS = np.random.default_rng(1).normal(size=(3, 5, 6))


def test_a_frozen_learned_gain_is_the_exact_one(newton: FlownCase) -> None:
    law = frozen_law("certified", learned_value(newton.game, "certified", 0))
    assert not law.online
    np.testing.assert_allclose(law.gains[0], newton.law.gains[0], rtol=1e-8, atol=1e-10)


def test_learning_in_flight_flies_the_baseline_then_certified_gains_and_knows_nothing_of_the_future(
    newton: FlownCase,
) -> None:
    learned = learned_value(newton.game, "certified", 0, predefined_time=2.0)
    law = online_law(newton.game, "certified", learned, 0.01)
    assert 0.0 < law.certified_from < 2.0
    first = round(law.certified_from / 0.01)
    baseline = baseline_gain(newton.game)
    assert all(np.array_equal(gain, baseline) for gain in law.gains[:first])
    assert not np.array_equal(law.gains[first], baseline)
    for gain in law.gains:
        assert np.linalg.eigvals(newton.game.A - newton.game.B @ gain).real.max() < 0.0
    np.testing.assert_array_equal(law.gains[-1], learned.K)
    cut = replace(learned, times=learned.times[:120], weights=learned.weights[:120])
    assert np.array_equal(online_law(newton.game, "certified", cut, 0.01).gains[:119], law.gains[:119])
    result = fly(newton.aircraft, newton.point, law, Scenario(duration=3.0, initial=0.5 * SMALL), newton.envelope)
    assert result.departure is None
    np.testing.assert_allclose(result.flight.inputs[0], -baseline @ result.flight.errors[0], rtol=1e-12)


def test_the_integral_law_flies_from_the_baseline(newton: FlownCase) -> None:
    """At 15 degrees the aircraft alone is unstable: the law starts from the policy that keeps it flying."""
    law = frozen_law("irl", learned_value(newton.game, "irl", 0))
    np.testing.assert_allclose(law.gains[0], newton.law.gains[0], rtol=1e-4, atol=1e-5)
    with pytest.raises(NoSolutionError, match="not certified here"):
        learned_value(newton.game, "irl", 0, iterations=1)


def test_a_value_that_is_zero_for_a_state_without_cost_takes_over_too() -> None:
    """P is singular where Q is; rounding makes its smallest eigenvalue negative in one case of two."""
    rng = np.random.default_rng(18)
    for _ in range(6):
        T = rng.standard_normal((3, 3))
        C = np.linalg.inv(T)[1:]
        A, Q = T @ np.diag([-1.0, -2.0, 0.5]) @ np.linalg.inv(T), C.T @ C
        game = Game(A, rng.standard_normal((3, 1)), np.zeros((3, 1)), (Q + Q.T) / 2.0, [[1.0]], np.inf)
        learned = learn(game, tick=0.1)
        gains, first = certified_gains(game, learned, 0.1)
        assert first <= 10.0
        K = game.gain(reference_solution(game).P)
        assert relative_error(gains[-1], K) < 1e-9


def test_one_gain_stays_and_several_follow_each_other_and_the_last_stays() -> None:
    one, several = gain_law("one", GAINS[0]), gain_law("several", GAINS)
    assert (one.online, several.online) == (False, True)
    np.testing.assert_array_equal(one.gains, GAINS[:1])
    np.testing.assert_array_equal(several.gains, GAINS)
    for tick, gain in ((0, 0), (1, 1), (2, 2), (3, 2), (99, 2)):
        np.testing.assert_array_equal(several.constants(tick), GAINS[gain].ravel(order="F"))
    assert one.memory.size == 0


@pytest.mark.parametrize("gains", [GAINS[0].T, GAINS[0, 0], GAINS[None], np.full((5, 6), np.nan)])
def test_another_shape_is_refused(gains: np.ndarray) -> None:
    with pytest.raises(BadInputError, match=r"the gain has shape .*; give 5 x 6 finite numbers"):
        gain_law("bad", gains)
