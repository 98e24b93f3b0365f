"""A trim begins where it is told: the start decides how many steps it takes, and which minimum it finds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa

from hfa_model import Aircraft
from hfa_model.vectors import INPUT_SCALES
from trim import OperatingPoint, find_operating_point, level_flight, load_operating_point, release, save_operating_point

FREE = ("speed", "dihedral", "gamma")


def effort(point: OperatingPoint) -> float:
    return float(((np.array(point.inputs) / np.array(INPUT_SCALES)) ** 2).sum())


def test_the_start_decides_which_local_minimum_is_found(
    published_aircraft: Aircraft, point: OperatingPoint, tmp_path: Path
) -> None:
    """With three variables free least effort has two minima: wings a little down, and wings at their highest."""
    condition = release(level_flight(float(np.radians(10.0))), free=FREE)
    save_operating_point(point, tmp_path / "start.json")
    alone = find_operating_point(published_aircraft, condition)
    led = find_operating_point(published_aircraft, condition, load_operating_point(tmp_path / "start.json"))
    assert effort(alone) == pytest.approx(0.248, abs=1e-3)
    assert effort(led) == pytest.approx(0.0150, abs=1e-4)
    assert np.degrees([alone.states.dihedral, led.states.dihedral]) == pytest.approx([-3.7, 60.0], abs=0.01)


def test_the_command_starts_from_the_file(tmp_path: Path) -> None:
    start = tmp_path / "start.json"
    assert hfa("trim", "--dihedral", "15", "-o", str(start)).code == 0
    words = ("trim", "--dihedral", "10", *(word for name in FREE for word in ("--free", name)), "--json")
    efforts = []
    for more in ((), ("--start", str(start))):
        inputs = json.loads(hfa(*words, *more).out)["operating_point"]["inputs"]
        efforts.append(float(((np.array(list(inputs.values())) / np.array(INPUT_SCALES)) ** 2).sum()))
    assert efforts == pytest.approx([0.248, 0.0150], abs=1e-3)
