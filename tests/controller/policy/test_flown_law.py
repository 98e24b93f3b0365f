"""A gain, or one for each tick, as what flies."""

from __future__ import annotations

import numpy as np
import pytest

from controller import gain_law
from hfa_support import BadInputError

GAINS = np.random.default_rng(1).normal(size=(3, 5, 6))


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
