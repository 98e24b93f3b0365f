"""Verdicts on equivalent copies of a critic, which must not differ from the verdict on the critic.

The copies differ in last bits, order, units or axes of the states.
"""

from __future__ import annotations

import numpy as np
import pytest
from copies import copies
from game_samples import game_models

from controller.critic.critic import from_gain, from_value
from hfa import solve, verify


@pytest.mark.parametrize(
    ("error", "passes", "count"),
    [
        (0.0, True, 3),
        (1e-4, False, 1),
        pytest.param(0.0, True, 400, marks=pytest.mark.slow),
        pytest.param(1e-4, False, 400, marks=pytest.mark.slow),
    ],
)
def test_every_copy_has_the_same_verdict(error: float, passes: bool, count: int) -> None:
    """All copies of an exact critic pass, and all copies of a critic with an error fail.

    The error of P is in a random direction.
    """
    game = game_models()["published-15"]
    exact = solve(game)
    direction = np.random.default_rng(0).standard_normal(exact.P.shape)
    P = exact.P + error * np.abs(exact.P).max() * (direction + direction.T)
    critic = {"P": P, "K": exact.K * (1.0 + error)}
    for copy in copies(game, 5, count, critic):
        of_value = from_value(copy.problem, copy.critic["P"])
        of_gain = from_gain(copy.problem, copy.critic["K"])
        verdicts = [verify(copy.problem, candidate).ok for candidate in (of_value, of_gain)]
        assert verdicts == [passes, passes], copy.kind
