"""A trim's margins: of the inputs, and of every limited variable that the condition leaves free; and what binds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfa_model import Aircraft
from trim import find_operating_point, level_flight, release, trim_report
from trim.point.trim_report import all_margins

BASE = level_flight(float(np.radians(10.0)))


def test_the_pitch_angle_follows_and_limits_gamma(published_aircraft: Aircraft) -> None:
    condition = release(BASE, free=("gamma",), hold={"throttle": 0.0})
    point = find_operating_point(published_aircraft, condition)
    found = all_margins(condition, point)
    assert (found["pitch"].role, found["gamma"].role) == ("follows", "free")
    np.testing.assert_allclose(np.degrees([found["gamma"].lowest, found["gamma"].highest]), (-62.8, 57.2), rtol=1e-12)
    assert found["pitch"].distance == pytest.approx(np.radians(60.0) - abs(point.states.pitch))
    assert found["gamma"].distance == pytest.approx(found["pitch"].distance, rel=1e-12)


def test_a_limit_that_binds_is_named_first(published_aircraft: Aircraft) -> None:
    """Least effort wants the outer elevator at -2.8 deg; it may go to -2 deg only, and stays there."""
    wanted = find_operating_point(published_aircraft, release(BASE, free=("aileron_center",))).inputs.elevator_outer
    limit = math.radians(-2.0)
    assert wanted < limit
    limited = level_flight(BASE.imposed["dihedral"], limits={"elevator_outer": (limit, 0.5)})
    condition = release(limited, free=("aileron_center",))
    point = find_operating_point(published_aircraft, condition)
    data, found = trim_report(published_aircraft, condition, point).data, all_margins(condition, point)
    assert (data["nearest_limits"][0], data["binding"]) == ("elevator_outer", ["elevator_outer"])
    first = found["elevator_outer"]
    assert (first.nearer, first.nearer_limit, first.at_limit) == ("lowest", limit, True)
    assert not any(found[name].at_limit for name in data["nearest_limits"][1:])
