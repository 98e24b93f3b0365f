"""Files of operating points and conditions: exact round trips, and messages on faults."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from cli import refusal
from own_models import NAVION

import hfa
from hfa import BadInputError, OperatingPoint, trim
from hfa_aircraft import in_si
from trim import load_condition


@pytest.mark.parametrize(
    ("pattern", "replacement", "words"),
    [
        (r"\A.*\Z", "not json", "is not JSON"),
        (r"operating-point/1", "operating-point/9", "is not an operating point of schema"),
        (r'"speed": [^,]*,', "", "states.speed is missing"),
        (r'"alpha": [^,]*,', '"alpha": NaN,', "states.alpha is nan; give a finite"),
        (r'"dynamics": ', '"title": ', "dynamics is missing"),
    ],
)
def test_wrong_files_are_refused(point, tmp_path, pattern, replacement, words):
    """A fault planted in a saved point is refused, and the message names the fault."""
    path = tmp_path / "point.json"
    text, count = re.subn(pattern, replacement, json.dumps(point.to_dict()), count=1, flags=re.S)
    assert count == 1
    path.write_text(text, encoding="utf-8")
    assert words in refusal(lambda file: OperatingPoint.load(file, hfa.aircraft()), path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[impose]\nspeeed = 60",
            "unknown trim variable 'speeed'; did you mean speed? choose from speed",
        ),
        ("[impose]\nspeed_deg = 60", "speed_deg is not an angle; write speed, in ft/s"),
        ("[impose]\nalpha_deg = [[0, 1], [5, 1, 2]]", "value] rows"),
        ("[impose]\nalpha_deg = [[5, 1], [5, 2]]", "give increasing breakpoints"),
        ("[limits]\nalpha_deg = 3", "limits.alpha_deg is 3; give a list of numbers"),
        ("free = ['flaps']", "unknown trim variable 'flaps'"),
        ("inpose = 3", "unknown entry inpose; did you mean impose?"),
    ],
)
def test_a_faulty_condition_file_is_refused(tmp_path, text, message):
    """A faulty condition file is refused, and the message names the fault."""
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    assert message in refusal(load_condition, path)


def test_a_point_survives_its_file_bit_for_bit(point, tmp_path):
    """Numbers of every size, from the smallest to the largest double, are stored exactly."""
    values = [5e-324, -0.0, -1.7976931348623157e308, 0.1, 2.0 / 3.0, 1e-17, 68.0, 1e300, -0.3]
    planted = replace(
        point,
        states=type(point.states)(*values[:7]),
        inputs=type(point.inputs)(*values[4:]),
        found_by=None,
    )
    planted.save(tmp_path / "point.json")
    loaded = OperatingPoint.load(tmp_path / "point.json", point.model)
    for one, other in ((loaded.states, planted.states), (loaded.inputs, planted.inputs)):
        assert np.array(one).tobytes() == np.array(other).tobytes()


def test_points_in_other_units_are_converted(tmp_path):
    """A point in SI units is read by the aircraft in feet and pounds; other units are refused.

    The report of the point has angles in degrees.
    """
    path = tmp_path / "point.json"
    trim(in_si(NAVION)).save(path)
    loaded, known = OperatingPoint.load(path, NAVION), trim(NAVION)
    for name, value in dict(known).items():
        assert loaded[name] == pytest.approx(value, rel=1e-9, abs=1e-9), name
    shown = [line.split() for line in loaded.report().text().splitlines()]
    for name in (*NAVION.states, *NAVION.inputs):
        degrees = math.degrees(known[name]) if "rad" in NAVION.unit(name) else known[name]
        (row,) = (words for words in shown if words[:1] == [name])
        assert float(row[1]) == pytest.approx(degrees, rel=5.001e-6, abs=1e-9)
    text = path.read_text("utf-8")
    for unit, name in (("m/s", "speed"), ("N", "thrust")):
        path.write_text(text.replace(f'"{unit}"', '"kg"'), encoding="utf-8")
        with pytest.raises(BadInputError, match=f"{name} is in kg; use "):
            OperatingPoint.load(path, NAVION)
