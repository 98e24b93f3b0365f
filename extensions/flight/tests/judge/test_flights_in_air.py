"""Flights in noise and moving air: `hfa.fly` with samples, of any policy, also behind a filter."""

import numpy as np
import pytest
from policy_cases import SENSORS, aircraft, stored_deployment, trims

import hfa
from hfa_flight import Uncertainty

NOISE = Uncertainty(noise={"pitch_rate": 0.02})


def test_flights_of_a_deployment_behind_a_filter_have_its_sensors():
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]  # the GTM at 45 m/s
    kalman = hfa.filter(point.linearize(), SENSORS, dt=0.02)
    noisy = hfa.Scenario(0.5, uncertainty=Uncertainty(noise=SENSORS))
    policy = kalman.policy(stored_deployment("ppo_gtm"))
    flown = hfa.fly(model, point, policy, scenario=noisy, samples=1)
    assert flown.ok
    assert flown.report().data["filter"]["noise"] == pytest.approx(SENSORS)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "not drawn; .* or add samples=N"),
        ({"samples": 2, "weights": (np.eye(4), np.eye(2))}, "weights are of .* a single flight"),
        ({"seed": 2}, "add samples=N"),
        ({"samples": 2, "share": 1.2}, r"share is 1\.2"),
    ],
)
def test_wrong_arguments_of_many_flights_are_refused(options, said):
    """A scenario with noise that is not drawn requires samples; what applies to one flight only, or
    to several only, is refused with the others.
    """
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    with pytest.raises(hfa.BadInputError, match=said):
        hfa.fly(model, point, scenario=hfa.Scenario(0.1, uncertainty=NOISE), **options)
