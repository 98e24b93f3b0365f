"""Limits that no data of an aircraft state are marked and ranked after declared ones."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from project import ROOT

import hfa
from trim import trim_report, usual_condition


@pytest.mark.parametrize(
    "name", [f"{ROOT}/examples/uav.toml", pytest.param("jsbsim:c172p", marks=pytest.mark.slow)]
)
def test_assumed_limits_are_marked(name: str) -> None:
    """Assumed limits have stars in the table and a line below it."""
    pytest.importorskip("hfa_jsbsim")
    model = hfa.load_model(name)
    condition = usual_condition(model)
    point = hfa.trim(model, condition)
    report = trim_report(point, condition)
    margins = report.data["variables"]
    assert margins["alpha"]["assumed"]
    text = report.text()
    (row,) = [line for line in text.splitlines() if re.match(r"alpha .* free,", line)]
    assert row.count("*") >= 1
    assert "* assumed" in text


def test_a_limit_of_the_user_or_of_the_model_is_not_assumed() -> None:
    """Limits of the flexible aircraft and of a table are assumed, but for the user's."""
    for model in (hfa.aircraft(), hfa.load_model(f"{ROOT}/examples/uav.toml")):
        margins = hfa.trim(model).margins
        assert margins["alpha"].assumed
        own = replace(usual_condition(model), limits={"alpha": (-0.1, 0.2)})
        assert not hfa.trim(model, own).margins["alpha"].assumed
    gtm = hfa.trim(hfa.load_model(f"{ROOT}/examples/gtm.py:GTM")).margins
    assert [gtm[name].assumed for name in ("alpha", "pitch")] == [False, False]


@pytest.mark.slow
def test_flights_name_an_assumed_limit() -> None:
    """The table of a flight and its departure mark assumed limits."""
    pytest.importorskip("hfa_flight")
    model = hfa.load_model(f"{ROOT}/examples/uav.toml")
    point = hfa.trim(model)
    calm = hfa.fly(model, point, None, 0.1)
    assert "assumed" in calm.report().text()
    beyond = float(np.radians(17.0))
    left = hfa.fly(model, point, None, 20.0, initial={"beta": beyond, "yaw_rate": -3.0})
    assert left.departure is not None
    assert left.departure.assumed
    assert "(assumed)" in left.report().title


def test_an_output_takes_the_mark_of_the_state_that_limits_it() -> None:
    """The flight-path angle is limited by the assumed limits of the pitch, unless the user's."""
    model = hfa.aircraft()
    condition = hfa.paper.level_flight(0.1)
    assert hfa.trim(model, condition).margins_under(condition)["gamma"].assumed
    own = replace(condition, limits={"gamma": (-0.1, 0.1)})
    assert not hfa.trim(model, own).margins_under(own)["gamma"].assumed
