"""Figures of the trim sheet against independent calculations."""

import functools
import math

import casadi as ca
import pytest
from project import ROOT
from sheet_values import values
from standard_airspeeds import air

import hfa
from hfa import Signal

#: Unit of speed -> its value of a knot.
KNOTS = {"m/s": 1852.0 / 3600.0, "ft/s": 1852.0 / 3600.0 / 0.3048}
UAV = f"{ROOT}/examples/uav.toml"


@functools.cache
def trimmed(name):
    """Return the trim of an aircraft and the data of its report."""
    if name == "hfa":
        point = hfa.trim(hfa.aircraft(), hfa.paper.level_flight(math.radians(10.0)))
    else:
        point = hfa.trim(hfa.load_model(name))
    return point, point.report().data


@pytest.mark.parametrize("name", [UAV, f"{ROOT}/examples/uav.dml", "hfa"])
def test_lift_drag_and_thrust_balance_the_weight(name):
    """In level flight L + T sin α = W and D = T cos α.

    L/D, the lift coefficient L / (q S) and the power required T V cos α follow. The temperature is that
    of the standard atmosphere.
    """
    pytest.importorskip("hfa_daveml")
    point, data = trimmed(name)
    figures = values(data)
    thrust = figures.get("thrust force", figures.get("thrust"))
    alpha = point["alpha"]
    assert figures["drag"] == pytest.approx(thrust * math.cos(alpha), rel=1e-9)
    lift = figures["weight"] - thrust * math.sin(alpha)
    assert figures["lift"] == pytest.approx(lift, rel=1e-9)
    assert figures["L/D"] == pytest.approx(figures["lift"] / figures["drag"])
    force = figures["dynamic pressure"] * figures["S"]
    assert figures["lift coefficient"] == pytest.approx(figures["lift"] / force)
    there = air(point["altitude"] * (0.3048 if name == "hfa" else 1.0))
    assert figures["temperature"] == pytest.approx(there.sound**2 / (1.4 * 287.05287), rel=1e-4)
    power = thrust * math.cos(alpha) * point["speed"]
    shown = {"hp": 1.0 / 550.0, "kW": 1e-3}[data["sheet"]["power required"]["unit"]]
    assert figures["power required"] == pytest.approx(power * shown)


def test_the_static_margin_is_that_of_the_table():
    """The static margin is -Cm_alpha / CL_alpha, also if it is 0 or negative; CL_alpha of the file is
    3.45. Times the chord, 0.18994 m, it is the distance of the neutral point from the c.g.
    """
    model = trimmed(UAV)[0].model
    for slope in (-0.38, 0.0, 0.1):
        figures = values(hfa.trim(model.with_parameters(Cm_alpha=slope)).report().data)
        margin = -slope / 3.45
        assert figures["static margin"] == pytest.approx(margin, abs=1e-9)
        assert figures["CL_alpha"] == pytest.approx(3.45, rel=1e-9)
        assert figures["neutral point behind c.g."] == pytest.approx(0.18994 * margin, abs=1e-9)


@pytest.mark.slow
def test_thrust_of_a_propeller_whose_speed_is_a_state_is_not_invented():
    """The thrust of the Cessna follows its propeller speed rpm0, a state, and no input: the largest
    thrust is not known.
    """
    point = hfa.trim(hfa.load_model("jsbsim:c172p"))
    data = point.report().data
    assert "thrust available" not in values(data)
    assert "rpm0" in data["not_in_model"]["thrust available"]


def glider(chord=1.0, elevator=1.0, largest=True, constant_from=math.inf, drag=0.02):
    """Return a glider with the outputs that loads and performance need.

    elevator: factor on its moment
    largest: whether the largest lift coefficient, 1.4, is declared
    constant_from: alpha from which the lift is constant
    """

    def equations(x, u, p, w):
        pressure = 0.6 * x.speed**2
        lift = pressure * 10.0 * (0.2 + 5.0 * ca.fmin(x.alpha, constant_from))
        resistance = pressure * 10.0 * drag
        moment = pressure * 10.0 * (0.05 - 0.6 * x.alpha + elevator * u.elevator)
        rates = {
            "speed": (u.thrust - resistance) / 300.0 - 9.81 * (x.pitch - x.alpha),
            "alpha": x.pitch_rate + (3000.0 - lift) / (300.0 * x.speed),
            "pitch": x.pitch_rate,
            "pitch_rate": moment / 400.0 - x.pitch_rate,
        }
        outputs = {
            "lift": lift,
            "drag": resistance,
            "pitching_moment": moment,
            "dynamic_pressure": pressure,
            "reference_area": 10.0,
            "reference_chord": chord,
            "largest_lift_coefficient": 1.4,
            "load_factor": lift / 3000.0,
        }
        return rates, outputs if largest else {k: v for k, v in outputs.items() if k[:3] != "lar"}

    states = {
        "speed": Signal("m/s", 30.0, 10.0, 60.0, 25.0),
        "alpha": Signal("rad", 0.1, -0.2, 0.3),
        "pitch": Signal("rad", 0.1),
        "pitch_rate": Signal("rad/s", 0.1),
    }
    units = {"lift": "N", "drag": "N", "pitching_moment": "N m", "dynamic_pressure": "N/m^2"}
    units |= {"reference_area": "m^2", "reference_chord": "m", "load_factor": "1"}
    units |= {"largest_lift_coefficient": "1"} if largest else {}
    outputs = {name: Signal(unit) for name, unit in units.items()}
    inputs = {"elevator": Signal("rad", 0.1, -0.5, 0.5), "thrust": Signal("N", 100.0, 0.0)}
    return hfa.Model("glider", states, inputs, equations, outputs=outputs)


@pytest.mark.parametrize(
    ("changes", "figure", "reason"),
    [
        ({"chord": 0.0}, "static margin", "the reference chord is 0"),
        ({"elevator": 0.0}, "control per g", "no input pitches the aircraft"),
        ({"largest": False}, "speed / stall speed", "lift without a maximum"),
        ({"largest": False, "constant_from": 0.2}, "speed / stall speed", "lift without a maximum"),
        ({"drag": 0.0}, "L/D", " is 0"),
        ({}, "thrust available", "no upper limit of the thrust"),
    ],
)
def test_a_figure_that_does_not_exist_is_not_invented(changes, figure, reason):
    """A figure is "not in this model", with the reason, without a chord, an effect of the elevator, a
    maximum of the lift, drag, or a limit of the thrust.
    """
    model = glider(**changes)
    held = {"speed": 30.0, "thrust": 0.0}
    rates = {"alpha": 0.0, "pitch": 0.0, "speed": 0.0}
    if "elevator" in changes:  # without its effect, the elevator is held and the moment is not 0
        held["elevator"] = 0.0
    else:
        rates["pitch_rate"] = 0.0
    data = hfa.trim(model, hfa.TrimCondition(model, held, rates)).report().data
    assert reason in data["not_in_model"][figure]


@pytest.mark.parametrize("gamma", [0.0, 10.0, 30.0])
def test_the_control_per_g_is_that_of_pull_ups_at_the_flight_path(gamma):
    """The elevator per g of the F-16 is that of its own pull-ups, in which flight path and throttle are held,
    and that per knot the difference of trims 0.5 kt slower and faster.
    """
    model = hfa.load_model(f"{ROOT}/examples/f16.py")
    climb = {"gamma": f"{gamma} deg"}
    level = hfa.trim(model, **climb)
    held = {**climb, "throttle": level["throttle"], "free": ["pitch_dot", "speed_dot"]}
    low, high = (
        hfa.trim(model, **held, load_factor=level["load_factor"] + change)["elevator"]
        for change in (-1e-3, 1e-3)
    )
    per_g = level.sheet["elevator per g"].value
    assert math.degrees(per_g) == pytest.approx((high - low) / 2e-3, rel=1e-4)
    slow, fast = (
        hfa.trim(model, **climb, speed=level["speed"] + change * KNOTS["ft/s"])["elevator"]
        for change in (-0.5, 0.5)
    )
    assert math.degrees(level.sheet["elevator per knot"].value) == pytest.approx(fast - slow)


def in_body_axes(gamma):
    """Return a point mass in axes at 0.3 rad to its path, with u, w, its mass times a speed as thrust T."""
    u, w = 20.0 * math.cos(0.3), 20.0 * math.sin(0.3)

    def equations(x, c, p, _):
        rates = {"u": c.T / 9.0 - ca.sin(x.theta - 0.3 - gamma), "w": x.w - w, "theta": x.u - u}
        return rates, {}

    states = {"u": Signal("m/s", start=u), "w": Signal("m/s"), "theta": Signal("rad")}
    return hfa.Model("own", states, {"T": Signal("N")}, equations)


@pytest.mark.parametrize("gamma", [0.0, -0.1])
def test_the_airspeed_and_path_of_body_axes_are_of_all_components(gamma):
    """V = sqrt(u² + w²) = 20 m/s, 38.9 kt, and theta - atan2(w, u) is the path, which the first line states."""
    report = hfa.trim(in_body_axes(gamma), T=0.0).report()
    assert report.sheet["true airspeed"].value == pytest.approx(20.0 / KNOTS["m/s"])
    path = f"descent {math.degrees(-gamma):.3g} deg" if gamma else "level"
    assert f"trimmed: {path}, 20 m/s" in report.title


def test_a_thrust_below_0_without_a_limit_has_a_warning():
    """At theta = 0.2 rad in a descent of 0.1 rad, the thrust of the point mass is 9 sin(-0.1) N."""
    title = hfa.trim(in_body_axes(0.0), theta=0.2, free="theta_dot").report().title
    assert "T is -0.8985 N, below 0, and has no lower limit" in " ".join(title.split())
