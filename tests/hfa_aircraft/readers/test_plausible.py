"""Tables with usual mistakes are reported under the first line; right aircraft are not."""

import tomllib

import pytest
from project import ROOT

import hfa
from hfa import BadInputError


def changed(**values):
    """Return the table of examples/uav.toml with other values; None removes an entry."""
    table = tomllib.loads((ROOT / "examples/uav.toml").read_text("utf-8"))
    flat = {}
    for name, value in table.items():
        flat |= value if isinstance(value, dict) else {name: value}
    return {name: value for name, value in (flat | values).items() if value is not None}


DEGREE = 3.141592653589793 / 180.0
#: Mistake -> changed entries, and a word of its warning.
MISTAKES = {
    "mass in pounds as slugs": ({"mass": 13.5 / 32.174}, "weight"),
    "mass in slugs as kilograms": ({"mass": 13.5 * 14.594}, "weight"),
    "static instability": ({"Cm_alpha": 0.38}, "Cm_alpha"),
    "no pitch damping": ({"Cm_q": 0.0}, "Cm_q"),
    "sign of the roll damping": ({"Cl_p": 0.26}, "Cl_p"),
    "a surface without derivatives": ({"flap": ["0 deg", "30 deg"]}, "flap"),
    "rates per degree": ({"Cl_p": -0.26 * DEGREE}, "Cl_p"),
    "per degree taken as per radian": ({"CL_alpha": 3.45 * DEGREE}, "may be given per deg"),
    "per radian taken as per degree": ({"CL_alpha": 3.45 / DEGREE}, "may be given per rad"),
    "lift coefficient of another alpha": ({"CL_0": 0.1, "alpha": "3 deg"}, "alpha"),
    "chord ten times too large": ({"chord": 1.9}, "chord"),
    "drag in counts": ({"CD_0": 4.3}, "CD_0"),
    "moment per radian taken as per degree": ({"Cm_alpha": -0.38 / DEGREE}, "static margin"),
    "chord and span exchanged": ({"chord": 2.8956, "span": 0.18994}, "span"),
    "sign of the pitch damping": ({"Cm_q": 3.6}, "Cm_q"),
    "sign of the yaw damping": ({"Cn_r": 0.095}, "its sign may be wrong"),
    "sign of the side force": ({"CY_beta": 0.98}, "CY_beta"),
    "sign of the aileron": ({"Cl_aileron": -0.08}, "Cl_aileron"),
    "sign of the elevator": ({"Cm_elevator": 0.5}, "Cm_elevator"),
    "sign of the lift slope": ({"CL_alpha": -3.45}, "CL_alpha"),
    "sign of the lift": ({"CL_0": -0.28}, "CL_0"),
    "sign of the dihedral effect": ({"Cl_beta": 0.12}, "Cl_beta"),
    "elevator per degree": ({"Cm_elevator": -0.5 * DEGREE}, "Cm_elevator"),
    "elevator per radian taken as per degree": ({"Cm_elevator": -0.5 / DEGREE}, "Cm_elevator"),
    "sign of the rudder": ({"Cn_rudder": 0.032}, "Cn_rudder"),
    "sideslip per degree": (
        {"CY_beta": -0.98 * DEGREE, "Cl_beta": -0.12 * DEGREE, "Cn_beta": 0.25 * DEGREE}, "CY_beta",
    ),
    "Ixx and Izz exchanged": ({"Ixx": 1.759, "Izz": 0.8244}, "Izz"),
    "inertias in lb ft^2 taken as slug ft^2": (
        {"Ixx": 0.8244 * 32.174, "Iyy": 1.135 * 32.174, "Izz": 1.759 * 32.174}, "Ixx",
    ),
    "Iyy 23.7 times too large": ({"Iyy": 1.135 * 23.73}, "principal"),
    "Izz in slug ft^2 taken as kg m^2": ({"Izz": 1.759 * 0.7376 / 1.2}, "Izz"),
    "Ixz above the inertias": ({"Ixz": 1.19}, "principal"),
    "no roll damping": ({"Cl_p": None}, "Cl_p missing"),
    "no dihedral effect": ({"Cl_beta": None}, "Cl_beta missing"),
    "no moment of the elevator": ({"Cm_elevator": None}, "Cm_elevator missing"),
    "aileron per degree": ({"Cl_aileron": 0.08 * DEGREE}, "Cl_aileron"),
    "rudder per degree": ({"Cn_rudder": -0.032 * DEGREE}, "Cn_rudder"),
    "sign of the lift of the elevator": ({"checked": ""}, "CL_elevator"),
    "sign of the lag of the downwash": ({"Cm_alphadot": 3.0}, "Cm_alphadot"),
    "sign of the thrust by speed": ({"CT_u": 0.14}, "CT_u"),
    "sign of the drag by alpha": ({"CD_CL2": None, "CD_alpha": -0.045}, "CD_alpha"),
    "yaw damping ten times": ({"Cn_r": -3.5}, "Cn_r"),
    "dihedral effect ten times": ({"Cl_beta": -1.2}, "Cl_beta"),
    "induced drag ten times": ({"CD_CL2": 0.232}, "check it (CD_CL2"),
    "yaw damping, ten times that of its fin": ({"Cn_r": -0.7, "Cn_beta": 0.05}, "Cn_r / Cn_beta"),
    "thrust of twice the weight": ({"thrust": [0.0, 265.0]}, "thrust"),
    "Iyy and Izz exchanged": ({"Iyy": 1.759, "Izz": 1.135}, "a sign may be wrong, or entries are exchanged (Izz"),
    "density of another altitude": ({"altitude": 9000.0, "alpha": "2 deg"}, "altitude"),
}  # fmt: skip
#: Entries that are parameters of the model, which --hold can set to a wrong value.
PARAMETERS = ("Cm_alpha", "Cm_q", "Cl_p", "Cn_r", "CY_beta", "Ixx", "Iyy", "Izz", "Ixz")


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_planted_mistake_has_a_warning(mistake):
    """An entry with a usual mistake has a warning that names it, and the aircraft is still read.

    A parameter that is set to the wrong value has the same warning, and one set back has none.
    """
    values, word = MISTAKES[mistake]
    warnings = hfa.from_derivatives(changed(**values)).warnings
    assert any(word in warning for warning in warnings)
    if {*values} <= {*PARAMETERS} and None not in values.values():
        wrong = hfa.from_derivatives(changed()).with_parameters(**values)
        assert wrong.warnings == warnings
        assert wrong.with_parameters(**{name: changed()[name] for name in values}).warnings == ()


@pytest.mark.parametrize("name", ["uav.toml", "cessna182.toml", "glider.toml"])
def test_tables_of_the_examples_have_no_warning(name):
    """The tables of the examples, one of them with a file of AVL, have no warning."""
    assert hfa.load_model(f"{ROOT}/examples/{name}").warnings == ()


def test_a_checked_name_that_is_no_entry_is_refused():
    """The entry `checked` may name only entries of the table."""
    with pytest.raises(BadInputError, match="checked names 'Cl_x', which is no entry"):
        hfa.from_derivatives(changed(checked="CL_elevator, Cl_x"))


def test_a_derivative_by_speed_has_a_warning_far_from_its_speed():
    """The Cessna's CT_u is reported where the speed is more than about 10 % from that of its table,
    220.1 ft/s.
    """
    plane = hfa.load_model(f"{ROOT}/examples/cessna182.toml")
    for speed, is_far in ((195.0, True), (200.0, False), (240.0, False), (245.0, True)):
        title = hfa.trim(plane, speed=speed).report().title
        assert ("Check: CT_u" in title) == is_far
