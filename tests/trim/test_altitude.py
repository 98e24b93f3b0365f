"""An altitude that nobody holds keeps its initial value, in trims and sweeps."""

from dataclasses import replace

import pytest
from project import ROOT

import hfa
from hfa import sweep, trim

UAV = hfa.load_model(f"{ROOT}/examples/uav.toml")
FREE = replace(UAV, trim={name: each for name, each in UAV.trim.items() if name != "altitude"})


def test_a_trim_keeps_the_start_value_of_the_altitude():
    """The trim and its modes are those with the altitude held there, and the report says so."""
    free = trim(FREE)
    held = trim(FREE, hold={"altitude": UAV.states["altitude"].start})
    assert dict(free) == pytest.approx(dict(held), rel=1e-9, abs=1e-12)
    said = "At its start value, as the trim does not determine it: altitude"
    assert (said in str(free.report()), said in str(held.report())) == (True, False)


def test_a_sweep_keeps_the_altitude():
    """Each point of a sweep is at the initial altitude."""
    points = [linear.point for linear in sweep(FREE, speed=[30.0, 35.0, 40.0])]
    assert [point["altitude"] for point in points] == [UAV.states["altitude"].start] * 3


def test_an_altitude_that_the_equations_determine_is_found():
    """With the thrust held, level flight determines the altitude."""
    thrust = trim(FREE, hold={"altitude": 2000.0})["thrust"]
    assert trim(FREE, hold={"thrust": thrust})["altitude"] == pytest.approx(2000.0, rel=1e-6)
