"""Units in the report of a linear model."""

from __future__ import annotations

from own_models import F16, NAVION, trimmed

import hfa
from hfa import Model, Signal, linearize
from hfa.paper import level_model
from trim.linear.linear_model import units_in_words


def tank(level: str, flow: str) -> Model:
    return Model(
        name="tank",
        equations=lambda x, u, p, w: ({"level": u.flow - x.level}, {}),
        states={"level": Signal(level)},
        inputs={"flow": Signal(flow)},
    )


def test_columns_in_other_units_are_named() -> None:
    """The title of a report names the columns of B in other units, such as three inputs in
    degrees.
    """
    model = linearize(F16, trimmed(F16))
    assert units_in_words(model) == "rad, ft, s, but elevator, aileron, rudder in deg"
    assert "A and B in rad, ft, s, but elevator" in model.report().title
    units = {row[:3]: row[4] for row in model.report().records.rows}
    assert units["B", "pitch_rate", "elevator"] == "(rad/s^2)/(deg)"
    assert units_in_words(level_model(hfa.aircraft(), 0.1)) == "rad, ft, s"


def test_the_navions_report_is_in_feet() -> None:
    """The report of the Navion states rad, ft and s."""
    assert units_in_words(linearize(NAVION, trimmed(NAVION))).startswith("rad, ft, s")
