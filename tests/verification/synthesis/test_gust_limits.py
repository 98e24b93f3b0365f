"""The gusts that a controller stands, and those that could be stood: at both ends of its angles, up and down."""

from __future__ import annotations

import math
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from known_models import model_at
from servo_cases import measured_servo

from hfa_model import Aircraft
from hfa_model.support.errors import BadInputError, NoSolutionError
from verification.synthesis import gust_limits as module
from verification.synthesis.controllers import design_controller
from verification.synthesis.gust_limits import LENGTH, gust_limits
from verification.synthesis.moving_air import gust_share
from verification.synthesis.tuning import InGust


def best(*given: Any, found: float = 150.0) -> SimpleNamespace:
    """In place of IPOPT; downward it finds nothing."""
    *_, length, sign, bandwidth = given
    assert (length, bandwidth) == (LENGTH, 2.0)
    if sign < 0.0:
        raise NoSolutionError("none")
    return SimpleNamespace(peak=found)


def test_both_ends_of_the_angles_both_ways(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "best_inputs", partial(best, found=120.0))
    controller = design_controller(published_aircraft, measured_servo(feedforward=None), np.radians([10.0, 11.0]))
    told: list[tuple[int, int]] = []
    limits = gust_limits(published_aircraft, controller, lambda *done: told.append(done)).limits
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [round(math.degrees(each.dihedral)) for each in limits] == [10, 10, 11, 11]
    assert [math.copysign(1.0, each.held) for each in limits] == [1.0, -1.0, 1.0, -1.0]
    assert [each.best for each in limits[::2]] == [120.0, 120.0]
    assert math.isnan(limits[1].best)
    for each in limits[2:]:
        gust = InGust(each.dihedral, module.Actuator(), LENGTH, each.held)
        assert gust_share(published_aircraft, model_at(11.0), controller, gust) <= 1.0
    with pytest.raises(BadInputError, match="was designed for published dynamics"):
        gust_limits(Aircraft(dynamics="newton"), controller)
