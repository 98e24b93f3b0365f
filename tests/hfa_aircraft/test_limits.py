"""Limits: single trims and sweeps use the same definition of "within"."""

from __future__ import annotations

import numpy as np
import pytest

from hfa import Model, sweep, trim
from hfa.paper import level_flight
from hfa_aircraft.limits import Limits
from trim import TrimError


@pytest.mark.parametrize(
    ("highest", "reason"),
    [
        (2.8, ""),
        (
            2.7999,
            "no trim within limits: pitch would have to be 2.8 deg, "
            "but must lie between -60 deg and 2.7999 deg",
        ),
    ],
)
def test_trim_and_sweep_agree_at_a_limit(
    published_aircraft: Model, highest: float, reason: str
) -> None:
    """A trim and a sweep agree if the pitch angle alpha + gamma is at or just beyond its limit."""
    limits = {"pitch": (float(np.radians(-60.0)), float(np.radians(highest)))}
    angles = {name: float(np.radians(value)) for name, value in (("alpha", 2.7), ("gamma", 0.1))}
    condition = level_flight(float(np.radians(5.0)), limits=limits, **angles)
    swept = sweep(published_aircraft, {"dihedral": [np.radians(5.0)]}, condition=condition)
    assert swept.reasons == (reason,)
    if reason:
        with pytest.raises(TrimError) as refusal:
            trim(published_aircraft, condition)
        assert str(refusal.value) == reason
    else:
        assert trim(published_aircraft, condition).status == "trimmed"


def test_within_allows_a_difference_by_rounding_only(published_aircraft: Model) -> None:
    """A value beyond a limit by less than 1e-9 of nominal size plus limit is within the limit, and
    at the limit within 1e-6. A value farther beyond is not within, nor is nan.
    """
    limits = Limits.of(
        published_aircraft, ("speed", "throttle", "gamma"), {"gamma": (-np.inf, 0.1)}
    )
    nominal = np.array([published_aircraft.signals[name].nominal for name in limits.names])
    for lowest, highest, side in ((1.0, 0.0, -1.0), (500.0, 200.0, 1.0)):
        ends = np.array([lowest, highest, 0.1])
        slack = side * (nominal + ends)
        assert limits.within(ends + 0.9e-9 * slack)[:2].tolist() == [True, True]
        assert limits.within(ends + 1.1e-9 * slack)[:2].tolist() == [False, False]
        at_end = (limits.at_lowest, limits.at_highest)[side > 0.0]
        other_end = (limits.at_lowest, limits.at_highest)[side < 0.0]
        assert at_end(ends - 0.9e-6 * slack)[:2].tolist() == [True, True]
        assert at_end(ends - 1.1e-6 * slack)[:2].tolist() == [False, False]
        assert not other_end(ends)[:2].any()
    assert limits.within([np.nan, 0.0, 0.1]).tolist() == [False, True, True]
    assert not limits.at_lowest([500.0, 200.0, -9e9])[2]
