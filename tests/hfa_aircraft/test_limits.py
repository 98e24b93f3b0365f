"""Limits: single trims and sweeps use the same definition of "within"."""

from __future__ import annotations

import numpy as np
import pytest

from hfa import Model, sweep, trim
from hfa.paper import level_flight
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
