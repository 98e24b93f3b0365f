"""Learning in flight: the baseline, then the last certified gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from known_models import SMALL, FlownCase

from controller import Scenario, fly, gain_law
from controller.laws.certified import learned_value
from studies.section5.learning_in_flight import certified_gains
from studies.update_law.integral_rl import baseline_gain


def test_learning_in_flight_flies_the_baseline_then_certified_gains_and_knows_nothing_of_the_future(
    newton: FlownCase,
) -> None:
    learned = learned_value(newton.game, "certified", 0, predefined_time=2.0)
    gains, certified_from = certified_gains(newton.game, learned, 0.01)
    assert 0.0 < certified_from < 2.0
    first = round(certified_from / 0.01)
    baseline = baseline_gain(newton.game)
    assert all(np.array_equal(gain, baseline) for gain in gains[:first])
    assert not np.array_equal(gains[first], baseline)
    for gain in gains:
        assert np.linalg.eigvals(newton.game.A - newton.game.B @ gain).real.max() < 0.0
    np.testing.assert_array_equal(gains[-1], learned.K)
    cut = replace(learned, times=learned.times[:120], weights=learned.weights[:120])
    assert np.array_equal(certified_gains(newton.game, cut, 0.01)[0][:119], gains[:119])
    law = gain_law("learning", gains)
    result = fly(newton.aircraft, newton.point, law, Scenario(duration=3.0, initial=0.5 * SMALL), newton.envelope)
    assert result.departure is None
    np.testing.assert_allclose(result.flight.inputs[0], -baseline @ result.flight.errors[0], rtol=1e-12)
