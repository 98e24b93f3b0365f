"""Properties of trims and their files, for any flight condition that hypothesis draws."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from strategies import flights

import hfa
from hfa import Model, OperatingPoint
from hfa_aircraft import in_si
from trim import TrimError, trim_report, usual_condition

MODELS = [hfa.aircraft("published"), hfa.aircraft("newton")]

#: Unit of a model or of its figures -> its value in the units of a model in SI units.
FACTORS = {
    **dict.fromkeys(("1", "rad", "rad/s", "kt"), 1.0),
    **{"ft": 0.3048, "ft/s": 0.3048, "ft^2": 0.3048**2, "lbf": 4.4482216152605},
    **{"ft lbf": 1.3558179483314, "lbf/ft^2": 47.88025898, "ft/s^2": 0.3048},
    **{"hp": 0.74569987158, "ft/min": 0.00508, "1/rad": 1.0, "chord": 1.0},
}


USUAL = {"dihedral": 0.2, "speed": 68.0, "altitude": 40_000.0}


def test_the_usual_trim_is_balanced_within_limits_in_all_units() -> None:
    """As below, with its loads and performance."""
    assert_balanced_in_all_units(MODELS[0], USUAL)


@pytest.mark.slow
@given(model=st.sampled_from(MODELS), flight=flights())
def test_a_trim_is_balanced_within_limits_in_all_units(
    model: Model, flight: dict[str, float]
) -> None:
    """Any flight is balanced, or has no trim."""
    assert_balanced_in_all_units(model, flight)


def assert_balanced_in_all_units(model: Model, flight: dict[str, float]) -> None:
    """A trim balances its equations within the limits; in SI units it is the same flight.

    Loads and performance are converted, the lift of the panels adds up, and load factor 1 and the
    weight give the lift.
    """
    try:
        point = hfa.trim(model, hold=flight)
    except TrimError as error:
        assert str(error).startswith("no trim")  # noqa: PT017
        assert flight != USUAL
        return
    rates = model.rates_at(point.states, point.inputs)
    for name in model.steady:
        assert abs(rates[name]) <= 1e-8 * model.rate_scale(name)
    for margin in point.margins.values():
        assert margin.distance >= -1e-9 * (margin.scale + abs(margin.nearer_limit))
    assert [point[name] for name in flight] == pytest.approx(list(flight.values()), rel=1e-12)
    converted = in_si(model)
    in_meters = {name: value * FACTORS[model.unit(name)] for name, value in flight.items()}
    other = hfa.trim(converted, hold=in_meters)
    for name, value in dict(point).items():
        factor = FACTORS[model.unit(name)]
        scale = model.signals[name].nominal * factor
        assert other[name] == pytest.approx(value * factor, rel=1e-8, abs=1e-8 * scale), name
    if flight != USUAL:
        return
    data = trim_report(point, usual_condition(model)).data
    data_in_si = trim_report(other, usual_condition(converted)).data
    loads = {name: row for name, row in data["sheet"].items() if row["group"].split()[0] in GROUPS}
    for name, row in loads.items():
        expected = row["value"] * FACTORS[row["unit"]]
        assert data_in_si["sheet"][name]["value"] == pytest.approx(expected, rel=1e-6, abs=1e-3), (
            name
        )
    center, outer = (loads[f"lift {panel}"]["value"] for panel in ("center", "outer"))
    lift = center + 2.0 * outer * np.cos(flight["dihedral"])
    assert loads["lift"]["value"] == pytest.approx(lift, rel=0.05)


#: First words of the groups of a sheet whose units are converted.
GROUPS = ("performance", "loads")


@settings(max_examples=4)
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=12, max_size=12))
def test_a_point_survives_its_file_bit_for_bit(values: list[float]) -> None:
    """An operating point with any finite numbers is saved and loaded bit for bit."""
    point = hfa.trim(MODELS[0])
    given_point = replace(
        point,
        states=type(point.states)(*values[:7]),
        inputs=type(point.inputs)(*values[7:]),
        problem=None,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "point.json"
        given_point.save(path)
        loaded = OperatingPoint.load(path, MODELS[0])
    for kind in ("states", "inputs"):
        stored, found = (np.array(getattr(each, kind)) for each in (given_point, loaded))
        assert stored.tobytes() == found.tobytes()
    assert loaded.residuals == given_point.residuals
