"""Operating points in files and in python-control."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import refusal

from hfa_model import Aircraft
from trim import OperatingPoint, find_operating_point, level_flight


@pytest.fixture(scope="module")
def point(published_aircraft: Aircraft) -> OperatingPoint:
    return find_operating_point(published_aircraft, level_flight(float(np.radians(12.0))))


def test_round_trip_is_bit_for_bit(point: OperatingPoint, tmp_path: Path) -> None:
    awkward = replace(point, inputs=point.inputs._replace(throttle=0.1 + 0.2, aileron_center=-5e-324))
    for each in (point, awkward):
        path = tmp_path / "point.json"
        each.save(path)
        assert OperatingPoint.load(path) == each
    assert [each.name for each in tmp_path.iterdir()] == ["point.json"]


@pytest.mark.parametrize(
    ("pattern", "replacement", "words"),
    [
        (r"\A.*\Z", "not json", "is not JSON"),
        (r"\A.*\Z", "[1, 2]", "is not an operating point"),
        (r"operating-point/1", "operating-point/9", "is not an operating point of schema"),
        (r'"speed": [^,]*,', "", "states.speed is missing"),
        (r'"alpha": [^,]*,', '"alpha": "much",', "states.alpha is 'much'; give a finite number"),
        (r'"alpha": [^,]*,', '"alpha": null,', "states.alpha is None; give a finite"),
        (r'"alpha": [^,]*,', '"alpha": NaN,', "states.alpha is nan; give a finite"),
        (r'"throttle": [^,]*,', '"throttle": Infinity,', "inputs.throttle is inf; give a finite"),
        (r'"residuals": \{[^}]*\}', '"residuals": 3', "residuals is 3; make it the table"),
        (r'"dynamics": [^,]*,', "", "dynamics is missing"),
    ],
)
def test_wrong_files_are_refused(
    point: OperatingPoint, tmp_path: Path, pattern: str, replacement: str, words: str
) -> None:
    path = tmp_path / "point.json"
    text, count = re.subn(pattern, replacement, json.dumps(point.to_dict()), count=1, flags=re.S)
    assert count == 1
    path.write_text(text, encoding="utf-8")
    assert words in refusal(OperatingPoint.load, path)
