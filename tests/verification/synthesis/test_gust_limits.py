"""The gusts that a controller stands, and those that could be stood: at both ends of its angles, up and down."""

from __future__ import annotations

import math
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
from controllers import small_controller

from controller import ScheduledController
from hfa_model import Aircraft
from hfa_support.errors import BadInputError, NoSolutionError
from trim import LinearModel
from verification.synthesis import gust_limits as module
from verification.synthesis.gust_limits import LENGTH, gust_limits
from verification.synthesis.tuning import InGust


def best(*given: Any, found: float = 150.0) -> SimpleNamespace:
    """In place of IPOPT; downward it finds nothing."""
    *_, length, sign, bandwidth = given
    assert (length, bandwidth) == (LENGTH, 2.0)
    if sign < 0.0:
        raise NoSolutionError("none")
    return SimpleNamespace(peak=found)


def held(aircraft: Aircraft, model: LinearModel, controller: ScheduledController, gust: InGust) -> float:
    """In place of the search of test_moving_air.py: another size at each end and each way."""
    assert gust == InGust(model.point.states.dihedral, module.Actuator(), LENGTH, gust.peak)
    return math.degrees(gust.dihedral) + 10.0 * gust.peak


def test_both_ends_of_the_angles_both_ways(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "best_inputs", partial(best, found=120.0))
    monkeypatch.setattr(module, "gust_held", held)
    controller = small_controller(published_aircraft)
    told: list[tuple[int, int]] = []
    limits = gust_limits(published_aircraft, controller, lambda *done: told.append(done)).limits
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [round(math.degrees(each.dihedral)) for each in limits] == [5, 5, 20, 20]
    assert [round(each.held) for each in limits] == [15, -5, 30, -10]
    assert [each.best for each in limits[::2]] == [120.0, 120.0]
    assert math.isnan(limits[1].best)
    assert math.isnan(limits[3].best)
    with pytest.raises(BadInputError, match="was designed for published dynamics"):
        gust_limits(Aircraft(dynamics="newton"), controller)
