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


@pytest.mark.parametrize("units", ["si", "declared"])
@pytest.mark.parametrize("name", MISTAKES)
def test_an_output_that_contradicts_others_is_doubted(name, units):
    """The aircraft with a factor of 1 has no doubt."""
    factor, word = MISTAKES[name]
    for each in (factor, 1.0):
        model = altered(name, each)
        if units == "si":
            model = in_si(model)
        title = " ".join(hfa.trim(model).report().title.split())
        assert ("Check:" in title) == (each != 1.0)
        assert (word in title) == (each != 1.0)


def test_a_weight_that_is_not_that_of_the_mass_is_doubted():
    """A mass in pounds beside a weight in newtons."""
    plane = replace(UAV, about=replace(UAV.about, configuration=mass_in_pounds))
    title = " ".join(hfa.trim(plane).report().title.split())
    assert "Check: the weight is 0.454 times mass and gravity" in title


def mass_in_pounds(x, u, p):
    return {"mass": (13.5 / 0.45359237, "kg")}


def test_inertias_of_a_held_value_are_doubted():
    """Ixz = 1.19 kg m² is above sqrt(Ixx Izz) = 1.204 less the rest of the body."""
    title = hfa.trim(UAV.with_parameters(Ixz=1.3)).report().title
    assert "a principal moment of inertia is not positive" in " ".join(title.split())
