"""Outputs of an aircraft that contradict each other are doubted in the first lines of a sheet."""

from dataclasses import replace

import pytest
from project import ROOT

import hfa
from hfa_aircraft import in_si

UAV = hfa.load_model(f"{ROOT}/examples/uav.toml")
#: Output -> factor of a mistake, and a word of its doubt.
MISTAKES = {
    "weight": (1.0 / 32.174, "load factor"),
    "lift": (32.174, "load factor"),
    "dynamic_pressure": (1.0 / 47.88, "density"),
    "mach": (3.28, "Mach number"),
    "pitching_moment": (-1.0, "static margins"),
}


def altered(name, factor):
    """Return the aircraft with an output multiplied by a factor."""

    def equations(x, u, p, w):
        rates, outputs = UAV.equations(x, u, p, w)
        return rates, {**outputs, name: factor * outputs[name]}

    return replace(UAV, equations=equations)


def first_lines(model):
    """Return the first lines of the report of its trim, as one line."""
    return " ".join(hfa.trim(model).report().title.split())


@pytest.mark.parametrize("name", MISTAKES)
def test_an_output_that_contradicts_others_is_doubted(name):
    factor, word = MISTAKES[name]
    title = first_lines(altered(name, factor))
    assert "Check:" in title
    assert word in title


@pytest.mark.parametrize("units", [lambda model: model, in_si], ids=["declared", "si"])
def test_outputs_are_compared_in_the_same_units(units):
    """An aircraft in SI units has the doubt of its lift, and none without a mistake."""
    assert "load factor" in first_lines(units(altered("lift", MISTAKES["lift"][0])))
    assert "Check:" not in first_lines(units(UAV))


def test_a_weight_that_is_not_that_of_the_mass_is_doubted():
    """A mass in pounds beside a weight in newtons is doubted, with their ratio."""
    plane = replace(UAV, about=replace(UAV.about, configuration=mass_in_pounds))
    assert "Check: the weight is 0.454 times mass and gravity" in first_lines(plane)


def mass_in_pounds(x, u, p):
    return {"mass": (13.5 / 0.45359237, "kg")}


def test_inertias_of_a_held_value_are_doubted():
    """Ixz = 1.3 kg m² is above sqrt(Ixx Izz) = 1.204 kg m²."""
    title = first_lines(UAV.with_parameters(Ixz=1.3))
    assert "a principal moment of inertia is not positive" in title
