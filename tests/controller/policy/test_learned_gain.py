"""Which gain flies: a given one, one for each tick, a frozen learned one, or one that is being learned."""

from __future__ import annotations

import numpy as np
import pytest
from flight_cases import FlownCase

from controller import Scenario, fly, gain_law
from controller.policy.learned_gain import learned_value
from hfa_support import BadInputError

GAINS = np.random.default_rng(1).normal(size=(3, 5, 6))


def test_a_frozen_learned_gain_is_the_exact_one(newton: FlownCase) -> None:
    learned = learned_value(newton.game, "certified", 0)
    np.testing.assert_allclose(learned.K, newton.law.gains[0], rtol=1e-8, atol=1e-10)


def test_one_gain_stays_and_several_follow_each_other_and_the_last_stays() -> None:
    one, several = gain_law("one", GAINS[0]), gain_law("several", GAINS)
    np.testing.assert_array_equal(one.gains, GAINS[:1])
    np.testing.assert_array_equal(several.gains, GAINS)
    for tick, gain in ((0, 0), (1, 1), (2, 2), (3, 2), (99, 2)):
        np.testing.assert_array_equal(several.constants(tick), GAINS[gain].ravel(order="F"))
    assert one.memory.size == 0


@pytest.mark.parametrize("gains", [GAINS[0, 0], GAINS[None], np.full((5, 6), np.nan)])
def test_another_shape_is_refused(newton: FlownCase, gains: np.ndarray) -> None:
    with pytest.raises(BadInputError, match=r"the gain has shape .*; give inputs x states finite numbers"):
        gain_law("bad", gains)
    with pytest.raises(BadInputError, match=r"shape \(6, 5\); this aircraft takes 5 x 6"):
        fly(newton.aircraft, newton.point, gain_law("bad", GAINS[0].T), Scenario(duration=0.1), newton.envelope)
