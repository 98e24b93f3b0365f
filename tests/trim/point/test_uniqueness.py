"""A trim does not depend on where its search begins.

What no equation determines has its start value.
"""

from dataclasses import replace

import casadi as ca
import pytest
from project import ROOT

import hfa
from hfa import Model, Signal

ANGLE = Signal("rad", nominal=0.1)
GRAVITY = 9.80665


def plane(x, u, p, w):
    """A small airplane in the vertical plane, in an exponential atmosphere."""
    force = 0.5 * 1.225 * ca.exp(-x.h / 9000.0) * x.V**2 * 17.0
    CL = 0.3 + 4.4 * x.a + 0.4 * u.flap
    drag = force * (0.03 + 0.05 * CL**2)
    gamma = x.nose - x.a
    climb = x.V * ca.sin(gamma)
    return {
        "V": (u.T * ca.cos(x.a) - drag) / 1250.0 - GRAVITY * ca.sin(gamma),
        "a": x.q
        - (force * CL + u.T * ca.sin(x.a)) / (1250.0 * x.V)
        + GRAVITY * ca.cos(gamma) / x.V,
        "nose": x.q,
        "q": 3e-4 * force * (0.02 - 0.7 * x.a - 0.9 * u.stick - 8.0 * x.q / x.V),
        "h": climb,
    }, {"gamma": gamma}


#: Its trim imposes gamma, from which the rate of the altitude follows: an equation too few.
PLANE = Model(
    "plane",
    {"V": Signal("m/s", start=55.0, nominal=55.0), "a": ANGLE, "nose": ANGLE, "q": ANGLE,
     "h": Signal("m", start=500.0, nominal=1000.0)},
    {"T": Signal("N", start=1500.0, nominal=1500.0, min=0.0, max=4000.0), "stick": ANGLE,
     "flap": ANGLE},
    plane,
    outputs={"gamma": ANGLE},
    trim={"V": 55.0, "gamma": 0.0, "flap": 0.1},
)  # fmt: skip
OF_FILES = ("uav.toml", "uav.dml", "f16.py:F16", "gtm.py:GTM")
#: Aircraft of kinds that others have too.
OTHERS = (
    *("cessna182.toml", "glider.toml"),
    *(f"jsbsim:{name}" for name in ("737", "SGS", "T38", "A4", "MD11", "J3Cub", "B747", "X15")),
)


def aircraft(name):
    """Return an aircraft by its name in `AIRCRAFT`."""
    if name == "plane":
        return PLANE
    if name in ("published", "newton", "unsteady"):
        return hfa.aircraft(name)
    if name.startswith("jsbsim"):
        pytest.importorskip("hfa_jsbsim")
        return hfa.load_model(name)
    if name.endswith(".dml"):
        pytest.importorskip("hfa_daveml")
    return hfa.load_model(f"{ROOT}/examples/{name}")


AIRCRAFT = (
    *("plane", "published", "newton", "unsteady", "navion.py:NAVION", "pendulum.py:PENDULUM"),
    *OF_FILES,
    "jsbsim:c172p",
    *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS),
)


@pytest.mark.parametrize("name", AIRCRAFT)
def test_a_search_that_begins_elsewhere_ends_at_the_same_trim(name):
    """The trim does not change if the search begins 0.2 nominal values below or above each start value,
    with and without an altitude in the trim that the model declares.
    """
    model = aircraft(name)
    for omitted in ("", "altitude"):
        declared = {key: value for key, value in model.trim.items() if key != omitted}
        flown = replace(model, trim=declared)
        hold = {"dihedral": 0.2} if "dihedral" in model.states else {}
        expected = hfa.trim(flown, hold=hold)
        for step in (-0.2, 0.2):
            begin = {}
            for each in flown.variables:
                lowest, highest = flown.limits[each]
                aside = flown.signals[each].start + step * flown.signals[each].nominal
                begin[each] = min(max(aside, lowest), highest)
            found = hfa.trim(flown, hold=hold, start=begin)
            for each in flown.variables:
                scale = flown.signals[each].nominal
                assert found[each] / scale == pytest.approx(expected[each] / scale, abs=1e-9)


def test_a_state_that_no_equation_determines_keeps_its_start_value():
    """The altitude of PLANE is 500 m in a trim, whose first lines name it, and in a sweep."""
    point = hfa.trim(PLANE)
    assert point["h"] == 500.0
    first = str(point.report()).partition("\n\n")[0]
    assert "At its start value, as the trim does not determine it: h 500 m" in first
    swept = hfa.sweep(PLANE, V=[50.0, 60.0])
    assert swept["h"].tolist() == [500.0, 500.0]


def test_a_trim_with_every_state_set_free_is_one_of_many():
    """No state that the user set free keeps its start value, so that the trim is one of many. The report
    names an option --hold that makes it unique.
    """
    free = {"V", "a", "nose"}
    released = hfa.trim(PLANE, hold={"h": 500.0}, free=[*free])
    first = str(released.report()).partition("\n\n")[0]
    assert "One of many" in first
    name = first.partition("(--hold ")[2].partition("=")[0]
    held = hfa.trim(PLANE, hold={"h": 500.0, name: released[name]}, free=[*free - {name}])
    assert "One of many" not in str(held.report())
