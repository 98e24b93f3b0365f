"""Units in the report of a linear model."""

import pytest
from own_models import F16

import hfa


@pytest.mark.parametrize(
    ("model", "words", "entry", "unit"),
    [
        (F16, "rad, ft, s, but elevator, aileron, rudder in deg", "elevator", "(rad/s^2)/(deg)"),
        (hfa.aircraft(), "A and B in rad, ft, s;", "throttle", "(rad/s^2)/(1)"),
    ],
)
def test_the_title_names_the_units_and_inputs_in_other_units(model, words, entry, unit):
    """The title of the report of a linear model names the units of A and B, and inputs in other units, as
    those of the F-16 in degrees. The records have the unit of each entry.
    """
    report = hfa.trim(model).linearize().report()
    assert words in " ".join(report.title.split())
    units = {row[:3]: row[4] for row in report.records.rows}
    assert units["B", "pitch_rate", entry] == unit
    assert units["A", "speed", "pitch_rate"] == "(ft/s^2)/(rad/s)"
