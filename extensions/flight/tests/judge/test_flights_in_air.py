"""Flights in noise and moving air: `hfa.fly` with samples, of any policy, also behind a filter."""

import numpy as np
import pytest
from policy_cases import aircraft, trims

import hfa
from hfa_flight import Uncertainty

NOISE = Uncertainty(noise={"pitch_rate": 0.02})


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
