"""Masses, tanks and units of files, from the formulas of solid bodies and the definitions of units."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy import constants as si

from hfa import BadInputError
from hfa_jsbsim.airframe import mass_in_file, read_empty, read_point_masses, read_tanks
from hfa_jsbsim.xml_file import parsed

#: lb in a slug, as in JSBSim, and in a gallon of water.
SLUG = 32.174049


def at(x, y, z):
    return f'<location unit="IN"><x>{x}</x><y>{y}</y><z>{z}</z></location>'


def point_mass(form):
    text = f'<m><pointmass><weight unit="LBS">64.348098</weight>{at(1, 2, 3)}{form}</pointmass></m>'
    (point,) = read_point_masses(parsed(text.encode(), "f.xml"))
    return point


@pytest.mark.parametrize(
    ("shape", "along", "across"),
    [
        ("tube", 3.0**2, 3.0**2 / 2 + 4.0**2 / 12),
        ("cylinder", 3.0**2 / 2, 3.0**2 / 4 + 4.0**2 / 12),
        ("sphere", 3.0**2 * 2 / 3, 3.0**2 * 2 / 3),
        ("ball", 3.0**2 * 2 / 5, 3.0**2 * 2 / 5),
    ],
)
def test_point_masses_have_the_inertia_of_their_shape(shape, along, across):
    """Two slugs of radius 3 ft and length 4 ft; with another weight in proportion."""
    lengths = '<radius unit="FT">3</radius><length unit="IN">48</length>'
    point = point_mass(f'<form shape="{shape}">{lengths}</form>')
    np.testing.assert_allclose(point.inertia, 2.0 * np.diag([along, across, across]))
    half = np.array(ca.DM(point.inertia_at(0.5 * point.weight)))
    np.testing.assert_allclose(half, np.diag([along, across, across]))
    with pytest.raises(BadInputError, match="the shape 'cone' is unknown"):
        point_mass('<form shape="cone"/>')


def test_point_masses_without_a_shape_have_constant_inertia():
    point = point_mass('<ixx unit="KG*M2">1.35594</ixx><iyy>2</iyy><izz>3</izz><ixz>0.5</ixz>')
    assert point.inertia.tolist() == [[1.0, 0.0, 0.5], [0.0, 2.0, 0.0], [0.5, 0.0, 3.0]]
    np.testing.assert_array_equal(np.array(ca.DM(point.inertia_at(1.0))), point.inertia)


TANK = (
    '<tank type="FUEL"><location unit="FT"><x>2</x></location><drain_location unit="IN"><x>0</x>'
    '<z>-12</z></drain_location><capacity unit="LBS">200</capacity><contents>50</contents>{}</tank>'
)


def tank_of(more):
    (tank,) = read_tanks(parsed(f"<p>{TANK.format(more)}</p>".encode(), "f.xml"))
    return tank


def test_tanks_fill_from_their_drain_and_turn_as_balls_or_grains():
    """A ball of fuel; a hollow cylinder that burns from its bore; a cylinder that burns at its end."""
    tank = tank_of('<radius unit="IN">24</radius><inertia_factor>0.5</inertia_factor>')
    assert [float(each) for each in tank.place(50.0)] == [6.0, 0.0, -9.0]
    assert tank.inertia(2.0 * SLUG) == pytest.approx([2.0 * 0.5 * 0.4 * 2.0**2] * 3, rel=1e-6)
    grain = '<grain_config type="{}"><length unit="FT">3</length><bore_diameter unit="IN">{}</bore_diameter></grain_config>'
    radius = '<radius unit="FT">2</radius>'
    hollow = tank_of(radius + grain.format("CYLINDRICAL", 24))
    mass, bore = 100.0 / SLUG, math.sqrt(2.0**2 - 0.5 * (2.0**2 - 1.0**2))
    across = mass * (3.0 * (2.0**2 + bore**2) + 3.0**2) / 12.0
    along = 0.5 * mass * (2.0**2 + bore**2)
    assert hollow.inertia(100.0) == pytest.approx([along, across, across], rel=1e-6)
    end = tank_of(radius + grain.format("ENDBURNING", 24))
    across = mass * (3.0 * 2.0**2 + 1.5**2) / 12.0
    assert end.inertia(100.0) == pytest.approx([0.5 * mass * 4.0, across, across], rel=1e-6)
    for text, said in (
        (radius + grain.format("STAR", 24), "a grain of type 'STAR' is not supported"),
        (radius + grain.format("CYLINDRICAL", 48), "the grain has no volume"),
        (
            "<unusable-volume>40</unusable-volume>",
            "the unusable contents of the tank, 264 lb, exceed",
        ),
    ):
        with pytest.raises(BadInputError, match=said):
            tank_of(text)
    with pytest.raises(BadInputError, match="the contents of the tank, 50 lb, exceed"):
        read_tanks(parsed(f"<p>{TANK.replace('200', '40').format('')}</p>".encode(), "f.xml"))
    jet = tank_of("<type>JET-A</type><unusable-volume>2</unusable-volume>")
    assert (jet.density, jet.unusable, jet.usable) == (6.74, 13.48, True)
    (none,) = read_tanks(
        parsed(b"<p><tank><capacity>0</capacity><contents>9</contents></tank></p>", "f")
    )
    assert none.contents == 0.0


def balance(more="", weight=1000.0):
    text = (
        f'<m><ixx>10</ixx><iyy>20</iyy><izz>30</izz><ixz>4</ixz><emptywt unit="LBS">{weight}</emptywt>'
        f'<location name="CG" unit="IN"><x>12</x></location>{more}</m>'
    )
    return parsed(text.encode(), "f.xml")


def test_the_mass_of_an_aircraft_is_that_of_its_bodies():
    """Weight, center and inertia about it by the parallel axes, x to the tail and z up in inches."""
    load = f'<pointmass><weight unit="LBS">500</weight>{at(48, 24, 36)}</pointmass>'
    element = balance(load)
    tank = tank_of("")
    mass = mass_in_file(element, [tank], read_point_masses(element))
    weights = np.array([1000.0, 500.0, 50.0])
    places = np.array([[12.0, 0.0, 0.0], [48.0, 24.0, 36.0], [6.0, 0.0, -9.0]])
    center = weights @ places / 1550.0
    assert float(mass.weight) == 1550.0
    np.testing.assert_allclose(mass.center, center)
    assert float(mass.slugs) == pytest.approx(1550.0 / SLUG, rel=1e-6)
    arms = (places - center) * [-1.0, 1.0, -1.0] / 12.0
    inertia = np.array([[10.0, 0.0, 4.0], [0.0, 20.0, 0.0], [4.0, 0.0, 30.0]])
    for weight, arm in zip(weights / SLUG, arms, strict=True):
        inertia += weight * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(mass.inertia, inertia, rtol=1e-6)
    assert read_empty(element).location.tolist() == [12.0, 0.0, 0.0]


FAR = f"<pointmass><weight>1e300</weight>{at(1e300, 0, 0)}</pointmass>"


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (balance(weight=-1000.0), "the weight of the aircraft is -1000 lb; give a positive"),
        (balance("<ixy>90</ixy>"), "not positive definite"),
        (balance(FAR), "is not finite"),
    ],
)
def test_impossible_masses_are_refused(element, said):
    with np.errstate(all="ignore"), pytest.raises(BadInputError, match=said):
        mass_in_file(element, [], read_point_masses(element))


#: Unit of a file -> SI.
UNITS = {
    **{"FT": si.foot, "IN": si.inch, "M": 1.0, "CM": 0.01, "KM": 1000.0},
    **{"FT2": si.foot**2, "IN2": si.inch**2, "M2": 1.0, "CM2": 1e-4},
    **{"FT3": si.foot**3, "IN3": si.inch**3, "M3": 1.0, "CC": 1e-6, "LTR": 1e-3},
    **{"LBS": si.lb, "KG": 1.0, "SLUG": si.slug},
    **{"SLUG*FT2": si.slug * si.foot**2, "KG*M2": 1.0, "RAD": 1.0, "DEG": si.degree},
    **{"WATTS": 1.0, "HP": si.hp, "ATM": si.atm, "PSI": si.psi, "INHG": 3386.389, "PA": 1.0},
    **{"PSF": si.lbf / si.foot**2, "LBS/FT2": si.lbf / si.foot**2, "N/M2": 1.0},
    **{"KG/SEC": 1.0, "KG/MIN": 1.0, "LBS/SEC": si.lb, "LBS/MIN": si.lb},
    **{"LBS/HP*HR": si.lb / si.hp, "KG/KW*HR": 1e-3, "KG/L": 1e3, "LBS/GAL": si.lb / si.gallon},
}


@pytest.mark.parametrize(
    ("own", "unit"),
    [
        *[(own, "FT") for own in ("M", "CM", "KM", "IN")],
        *[("M", "IN"), ("M2", "FT2"), ("CM2", "FT2"), ("FT2", "IN2"), ("IN2", "FT2")],
        *[("IN3", "CC"), ("FT3", "IN3"), ("M3", "FT3"), ("LTR", "IN3"), ("LBS", "KG")],
        *[("KG", "LBS"), ("SLUG", "KG"), ("SLUG", "LBS"), ("SLUG*FT2", "KG*M2")],
        *[("KG*M2", "SLUG*FT2"), ("RAD", "DEG"), ("DEG", "RAD"), ("WATTS", "HP")],
        *[("ATM", "INHG"), ("PSI", "INHG"), ("INHG", "PSF"), ("INHG", "PA"), ("PSF", "INHG")],
        *[("LBS/FT2", "PA"), ("N/M2", "PA"), ("KG/SEC", "LBS/SEC"), ("LBS/HP*HR", "KG/KW*HR")],
        *[("KG/KW*HR", "LBS/HP*HR"), ("KG/L", "LBS/GAL")],
    ],
)
def test_units_are_converted_by_their_definition(own, unit):
    """JSBSim's factors are rounded to about 2e-4."""
    value = parsed(f'<x unit="{own}">3</x>'.encode(), "f.xml").number(unit)
    assert value == pytest.approx(3.0 * UNITS[own] / UNITS[unit], rel=3e-4)


def test_vectors_are_converted_and_missing_components_are_zero():
    text = b'<v unit="M"><pitch>2</pitch><z>3</z></v>'
    vector = parsed(text, "f.xml").vector("IN")
    np.testing.assert_allclose(vector, [0.0, 2.0 / si.inch, 3.0 / si.inch], rtol=1e-6)
