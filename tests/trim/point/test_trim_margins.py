"""A trim's margins: of the inputs, and of every limited variable that the condition leaves free; and what binds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfa_model import INPUTS, STATES, Aircraft
from hfa_model.aircraft import HFA
from trim import OperatingPoint, TrimCondition, find_operating_point, level_flight, release
from trim.point.trim_report import all_margins, margins, nearest_limits

LIMITS = {name: HFA.limits[name] for name in (*STATES, *INPUTS)}
BASE = level_flight(float(np.radians(10.0)))


def solved(aircraft: Aircraft, condition: TrimCondition) -> tuple[TrimCondition, OperatingPoint]:
    return condition, find_operating_point(aircraft, condition)


def test_the_pitch_angle_follows_and_limits_gamma(published_aircraft: Aircraft) -> None:
    condition, point = solved(published_aircraft, release(BASE, free=("gamma",), hold={"throttle": 0.0}))
    assert margins(condition, point)["pitch"].distance == pytest.approx(np.radians(60.0) - abs(point.states.pitch))
    found = all_margins(condition, point)
    assert (found["pitch"].role, found["gamma"].role) == ("follows", "free")
    np.testing.assert_allclose(np.degrees([found["gamma"].lowest, found["gamma"].highest]), (-62.8, 57.2), rtol=1e-12)
    assert margins(condition, point)["gamma"].distance == pytest.approx(
        margins(condition, point)["pitch"].distance, rel=1e-12
    )


def test_a_limit_that_binds_is_named_first(published_aircraft: Aircraft) -> None:
    """Least effort wants the outer elevator at -2.8 deg; it may go to -2 deg only, and stays there."""
    wanted = find_operating_point(published_aircraft, release(BASE, free=("aileron_center",))).inputs.elevator_outer
    limit = math.radians(-2.0)
    assert wanted < limit
    limited = level_flight(BASE.imposed["dihedral"], limits={"elevator_outer": (limit, 0.5)})
    condition, point = solved(published_aircraft, release(limited, free=("aileron_center",)))
    first, *others = nearest_limits(condition, point)
    assert (first.name, first.nearer, first.nearer_limit, first.binds) == ("elevator_outer", "lowest", limit, True)
    assert not any(each.at_limit for each in others)
