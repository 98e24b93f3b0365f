"""Maneuvers that `identify` recommends. In simulations, they narrow the bands as predicted."""

from functools import cache

import numpy as np
import pytest
from flown_records import SENSORS, longitudinal, noisy_columns
from project import ROOT

import hfa
from hfa_identify.estimation import identify
from hfa_identify.records import read_record

AIRCRAFT = hfa.load_model(str(ROOT / "examples" / "uav.toml"))
UAV = longitudinal(AIRCRAFT)
FREE = ("CL_elevator", "Cm_q", "Cm_elevator")


@cache
def record():
    """Return the columns of examples/uav_record.csv without the inputs that do not move."""
    read = read_record(ROOT / "examples" / "uav_record.csv", AIRCRAFT, {})
    inputs = dict(zip(AIRCRAFT.inputs, read.inputs.T, strict=True))
    moving = {name: inputs[name] for name in UAV.inputs}
    return {"time": read.time, **moving, **{name: read.measured[name] for name in SENSORS}}


@cache
def planned():
    return identify(UAV, record(), FREE, plan=True)


def simulated_record(model, manoeuvre):
    """Return the columns of a simulated doublet or 3-2-1-1 maneuver with noise, at 25 Hz."""
    point = hfa.trim(model)
    lengths = {"doublet": (1, 1), "3-2-1-1": (3, 2, 1, 1)}[manoeuvre.kind]
    edges = 0.5 + manoeuvre.seconds * np.concatenate([[0], np.cumsum(lengths)])
    signs = [*(1.0 - 2.0 * (np.arange(len(lengths)) % 2)), 0.0]
    moves = [
        (round(float(edge), 3), sign * manoeuvre.amplitude)
        for edge, sign in zip(edges, signs, strict=True)
    ]
    flight = hfa.fly(model, point, {manoeuvre.input: moves}, seconds=15)
    return noisy_columns(model, flight, 40, seed=3)


def test_the_planned_maneuver_gives_the_predicted_band():
    """After the planned maneuver is simulated, the identified band has the predicted width within
    25 %.
    """
    before = planned()
    best = next(each for each in before.plan if each.kind != "multisine")
    assert best.input == "elevator"
    assert best.widest == "CL_elevator"
    assert best.after < 0.6 * best.before
    after = identify(UAV, [record(), simulated_record(before.model, best)], FREE)
    each = after.parameters[best.widest]
    half = 50.0 * (each.high - each.low) / abs(each.value)
    assert half == pytest.approx(best.after, rel=0.25)


def test_the_report_sorts_maneuvers_by_width():
    """The maneuvers are sorted by predicted width, and their amplitudes are about half of the way
    from the trim to the nearer limit.
    """
    found = planned()
    after = [each.after for each in found.plan]
    assert after == sorted(after)
    assert "3-2-1-1" in str(found)
    at_trim = hfa.trim(UAV).inputs._asdict()
    for each in found.plan:
        signal, value = UAV.inputs[each.input], at_trim[each.input]
        assert 0.0 < each.amplitude <= 0.51 * min(signal.max - value, value - signal.min)
