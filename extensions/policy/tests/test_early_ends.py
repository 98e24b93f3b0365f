"""A flight that is flown no further would have ended as it was judged."""

import numpy as np
import pytest
from policy_cases import aircraft, card, trims

from hfa_policy.assessment import Assessor
from hfa_policy.outcomes import _LOST, _RETURNED, HORIZON, FlownRows, seeded_starts

STARTS = 100


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("name", ["td3_gtm", "ppo_raw"])
def test_flights_that_end_early_are_classified_right(name, late):
    """The td3 policy has swings that grow by a percent in 5 s, and are lost in the end."""
    dt = card(name).dt
    deployment = card(name).changed(timing={"dt": dt, "delay": late * dt})
    assessor = Assessor(deployment.on(aircraft(name)), trims(name), STARTS, seed=77)
    flight = assessor.flight()
    places = assessor.places(flight)
    rows = []
    for place in places:
        starts, pushes = seeded_starts(place, STARTS, 77, pushed=True)
        trim = flight.deployed.trim_vector(place.point)
        rows.append(flight.rows(starts, np.tile(trim, (STARTS, 1)), pushes))
    owners = np.repeat(np.arange(len(places)), STARTS)
    flown = FlownRows(flight, places, np.vstack(rows), owners)
    window = flight.window(len(owners), HORIZON)
    flown.fly(HORIZON, window)
    is_back, is_lost = flown.status == _RETURNED, flown.status == _LOST
    is_early = ~is_lost & (flown.times < HORIZON - 0.5)
    assert is_early.sum() > 50
    assert late == 0 or (is_early & ~is_back).any()

    X, _, low, high, *_ = flight.slices
    rows, times = flown.rows.copy(), flown.times.copy()
    while (flying := np.flatnonzero(is_early & (times < HORIZON - 0.5))).size:
        going = rows[flying]
        going[:, low] = going[:, X]
        going[:, high] = going[:, X]
        rows[flying] = window(going)
        times[flying] += flight.samples_in_window * flight.dt
        lowest, highest = rows[flying][:, low], rows[flying][:, high]
        assert (lowest >= flown.least[flying]).all()
        assert (highest <= flown.most[flying]).all()
    rows = rows[is_early]
    centres, balls = flown.centres[is_early], flown.balls[is_early]
    above = rows[:, high][:, flown.linear] - centres
    below = centres - rows[:, low][:, flown.linear]
    is_in_ball = (np.maximum(above, below) <= balls).all(axis=1)
    np.testing.assert_array_equal(is_in_ball, is_back[is_early])
