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
def test_the_title_names_the_units_and_columns_in_others(model, words, entry, unit):
    """The F-16 has inputs in degrees. Title and records have the unit of each column of B."""
    report = hfa.trim(model).linearize().report()
    assert words in " ".join(report.title.split())
    units = {row[:3]: row[4] for row in report.records.rows}
    assert units["B", "pitch_rate", entry] == unit
    assert units["A", "speed", "pitch_rate"] == "(ft/s^2)/(rad/s)"
