"""A trim begins where it is told: the start decides how many steps it takes, and which minimum it finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hfa_model import Aircraft
from hfa_model.vectors import INPUT_SCALES
from trim import OperatingPoint, find_operating_point, level_flight, load_operating_point, release, save_operating_point

FREE = ("speed", "dihedral", "gamma")


def effort(point: OperatingPoint) -> float:
    return float(((np.array(point.inputs) / np.array(INPUT_SCALES)) ** 2).sum())


def test_the_cheaper_of_two_minima_is_found(
    published_aircraft: Aircraft, point: OperatingPoint, tmp_path: Path
) -> None:
    """With three variables free least effort has two minima: wings a little down (0.248), and at their highest."""
    condition = release(level_flight(float(np.radians(10.0))), free=FREE)
    save_operating_point(point, tmp_path / "start.json")
    start = load_operating_point(tmp_path / "start.json")
    for found in (
        find_operating_point(published_aircraft, condition),
        find_operating_point(published_aircraft, condition, start),
    ):
        assert effort(found) == pytest.approx(0.0150, abs=1e-4)
        assert np.degrees(found.states.dihedral) == pytest.approx(60.0, abs=0.01)
