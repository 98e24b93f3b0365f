"""Units in the report of a linear model."""

from __future__ import annotations

import pytest
from own_models import F16, NAVION, trimmed

import hfa


@pytest.mark.parametrize(
    ("linear", "words"),
    [
        (trimmed(F16).linearize(), "rad, ft, s, but elevator, aileron, rudder in deg"),
        (trimmed(NAVION).linearize(), "A and B in rad, ft, s"),
        (hfa.paper.level_model(hfa.aircraft(), 0.1), "A and B in rad, ft, s;"),
    ],
)
def test_the_title_names_the_units_and_columns_in_others(
    linear: hfa.LinearModel, words: str
) -> None:
    """The F-16 has inputs in degrees, and so has the record of its B."""
    assert words in " ".join(linear.report().title.split())
    units = {row[:3]: row[4] for row in linear.report().records.rows}
    if "elevator" in words:
        assert units["B", "pitch_rate", "elevator"] == "(rad/s^2)/(deg)"
