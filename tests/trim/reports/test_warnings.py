"""Outputs of an aircraft that contradict each other are reported in the first lines of a sheet."""

from dataclasses import replace

import pytest
from project import ROOT

import hfa
from hfa_aircraft import in_si

UAV = hfa.load_model(f"{ROOT}/examples/uav.toml")
#: Output or rate, factor of a mistake, and words of its warning.
MISTAKES = (
    ("weight", 1.0 / 9.80665, "a mass as weight?"),
    ("lift", 4.448, "force across the path"),
    ("thrust_force", 4.4482216, "force along the path"),
    ("drag", 0.5, "force along the path"),
    ("dynamic_pressure", 1.0 / 47.880259, "dynamic_pressure in psf?"),
    ("dynamic_pressure", 2.0, "dynamic_pressure twice?"),
    ("mach", 3.28, "pressure of the air"),
    ("pitching_moment", -1.0, "the sign of pitching_moment?"),
    ("reference_area", 1.0 / 10.76, "CL_alpha"),
    ("gamma", -1.0, "the sign of gamma?"),
    ("turn_rate", -1.0, "the sign of turn_rate?"),
    ("load_factor", -1.0, "the sign of load_factor?"),
    ("altitude", -1.0, "the sign of altitude_dot?"),
    ("altitude", 3.28, "rate of altitude"),
    ("pitch", 57.3, "rate of pitch: pitch_dot is 57.3 deg/s per deg/s of pitch_rate"),
    ("roll", -1.0, "the sign of roll_dot?"),
    ("alpha", 57.3, "load factor"),
)


def altered(name, factor):
    """Return the aircraft with an output or a rate multiplied by a factor."""

    def equations(x, u, p, w):
        rates, outputs = map(dict, UAV.equations(x, u, p, w))
        changed = rates if name in rates else outputs
        changed[name] *= factor
        return rates, outputs

    return replace(UAV, equations=equations)


def first_lines(model):
    """Return the first lines of the report of its trim, as one line."""
    return " ".join(hfa.trim(model).report().title.split())


@pytest.mark.parametrize(("name", "factor", "word"), MISTAKES)
def test_an_output_or_rate_that_contradicts_others_has_a_warning(name, factor, word):
    """An output or a rate that is multiplied by the factor of a usual mistake, a wrong unit or sign, is
    reported in the first lines: `MISTAKES` has name, factor and a word of the warning.
    """
    title = first_lines(altered(name, factor))
    assert "Check:" in title
    assert word in title


@pytest.mark.parametrize("convert", [lambda model: model, in_si], ids=["declared", "si"])
def test_outputs_are_compared_in_the_same_units(convert):
    """A lift 32.174 times too large, as of pounds taken for slugs, has a warning of the load factor; the
    correct aircraft has none. Both hold in the declared units and after conversion to SI units.
    """
    assert "force across the path" in first_lines(convert(altered("lift", 32.174)))
    assert "Check:" not in first_lines(convert(UAV))


def test_a_weight_that_is_not_that_of_the_mass_has_a_warning():
    """A mass in pounds beside a weight in newtons is reported, with both sides and the unit."""
    plane = replace(UAV, about=replace(UAV.about, configuration=mass_in_pounds))
    assert "Check: weight: weight is 132.4 N, mass*gravity is 291.9 N; mass in lbm?" in first_lines(
        plane
    )


def mass_in_pounds(x, u, p):
    return {"mass": (13.5 / 0.45359237, "kg")}


def test_a_parameter_that_makes_the_inertias_impossible_has_a_warning():
    """Ixz = 1.3 kg m², set as a parameter, is above sqrt(Ixx Izz) = 1.204 kg m² of uav.toml."""
    title = first_lines(UAV.with_parameters(Ixz=1.3))
    assert "a principal moment of inertia is not positive" in title


def test_the_flight_path_in_a_wind_is_not_compared():
    """gamma may be relative to the ground: with a steady wind, its sign has no warning."""
    planted = altered("gamma", -1.0)
    wind = {"wind_north": hfa.Signal("m/s", start=5.0)}
    assert "Check:" not in first_lines(replace(planted, parameters={**planted.parameters, **wind}))
