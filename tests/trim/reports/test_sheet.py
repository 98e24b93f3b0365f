"""The sheet of a trim: first lines, configuration, airspeeds, climb and warnings."""

import functools
import json
import math
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import hfa as command
from project import ROOT
from scipy.optimize import brentq
from sheet_values import values

import hfa
from hfa import Model, Signal
from trim import release, usual_condition

EXAMPLES = ROOT / "examples"
KNOT = 1852.0 / 3600.0


@functools.cache
def sheet(name, **hold):
    """Return the trim of an aircraft and the data of its sheet."""
    model = hfa.aircraft() if name == "hfa" else hfa.load_model(name)
    point = hfa.trim(model, hold=hold)
    return point, point.report().data


def two_engines(*throttles):
    """Return an aircraft with engines of 100 N, left and right, and a drag of 2 N per m/s.

    throttles: names of the inputs, 0 to 1; engine1 and engine2 are switches, 1 or 0
    """

    def equations(x, u, p, w):
        left, right = (100.0 * getattr(u, name) for name in throttles)
        left, right = left * p.engine1, right * p.engine2
        return {
            "speed": left + right - 2.0 * x.speed,
            "alpha": -x.alpha,
            "yaw_rate": u.rudder + left - right - x.yaw_rate,
        }, {}

    states = {"speed": Signal("m/s"), "alpha": Signal("rad"), "yaw_rate": Signal("rad/s")}
    inputs = {name: Signal(min=0.0, max=1.0) for name in throttles} | {"rudder": Signal("rad")}
    switches = {name: Signal(start=1.0) for name in ("engine1", "engine2")}
    trim = {"speed": 30.0, "yaw_rate": 0.0}
    return Model("twin", states, inputs, equations, parameters=switches, trim=trim)


def test_engines_are_alike_where_a_trim_permits_it():
    """A yaw rate of 0.3 rad/s is that of the rudder, and of the throttles only beyond its limit."""
    model = two_engines("throttle1", "throttle2")
    point = hfa.trim(model, yaw_rate=0.3)
    assert point["throttle1"] == pytest.approx(point["throttle2"], abs=1e-9)
    assert point["rudder"] == pytest.approx(0.3)
    condition = release(
        usual_condition(model), hold={"yaw_rate": 0.3}, limits={"rudder": (-0.1, 0.1)}
    )
    limited = hfa.trim(model, condition)
    difference = limited["throttle1"] - limited["throttle2"]
    assert 100.0 * difference == pytest.approx(0.3 - limited["rudder"])


SLED = """
import casadi as ca
from hfa import Model, Signal

def equations(x, u, p, w):
    speed = ca.sqrt(x.vx**2 + x.vy**2)
    return {"vx": u.fx - speed * x.vx, "vy": u.fy - speed * x.vy}, {}

STATES = {"vx": Signal("m/s", min=-9, max=9), "vy": Signal("m/s", min=-9, max=9)}
INPUTS = {"fx": Signal("N", min=-99, max=99), "fy": Signal("N", min=-99, max=99)}
SLED = Model("sled", STATES, INPUTS, equations, trim={"vx": 0.0, "vy": 0.0})
"""


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("trim", 0),
        ("linearize", 1),
        ("sweep --hold vx=0,0", 1),
        ("solve --Q 1,1 --R 1,1 --delta inf", 1),
    ],
)
def test_a_derivative_that_is_not_a_number_is_reported_in_one_line(words, code, folder):
    """The sled has the drag |v| v, whose derivative by CasADi at v = 0 is not a number. Commands exit with
    1 and one line on stderr; `trim` exits with 0 and prints this line in place of the modes.
    """
    Path("sled.py").write_text(SLED, "utf-8")
    verb, *options = words.split()
    result = command(verb, "--aircraft", "sled.py:SLED", *options)
    assert result.code == code
    # `sweep` prints the line as the reason of its points without a linear model.
    said = " ".join(result.out.split()) if verb in ("trim", "sweep") else result.err
    assert ("no modes: sled: " if verb == "trim" else "") + "a derivative is not a number" in said
    assert result.err.count("\n") <= 1


# Stability with lags, stall, limits, load factor.


def two_peaks(alpha):
    """Return a wing whose lift over alpha has a first maximum at .2 rad and a larger one at .6."""

    def equations(x, u, p, w):
        peaks = ca.exp(-(((x.alpha - 0.2) / 0.12) ** 2))
        peaks += 1.5 * ca.exp(-(((x.alpha - 0.6) / 0.12) ** 2))
        lift = 1000.0 * peaks
        rates = {"speed": u.thrust - 10.0, "alpha": x.q, "q": u.elevator - x.alpha - x.q}
        return rates, {"lift": lift, "dynamic_pressure": 500.0, "reference_area": 2.0}

    states = {
        "speed": Signal("m/s", 10.0, 1.0, 60.0, 30.0),
        "alpha": Signal("rad", 0.1, -0.2, 0.9),
        "q": Signal("rad/s", 0.1),
    }
    inputs = {"elevator": Signal("rad", 0.1, -1.0, 1.0), "thrust": Signal("N", 10.0, 0.0, 20.0)}
    units = {"lift": "N", "dynamic_pressure": "N/m^2", "reference_area": "m^2"}
    outputs = {name: Signal(unit) for name, unit in units.items()}
    held = {"speed": 30.0, "alpha": alpha}
    return Model("two peaks", states, inputs, equations, outputs=outputs), held


@pytest.mark.parametrize(("alpha", "stalled"), [(0.05, False), (0.3, True)])
def test_the_stall_is_the_first_maximum_of_the_lift(alpha, stalled):
    """The lift coefficient is exp(-((α - 0.2)/0.12)²) + 1.5 exp(-((α - 0.6)/0.12)²), α in rad. The largest
    one in the sheet is that of the first maximum, at 0.2 rad, to 1e-6.

    A trim at 0.3 rad is beyond it: the third line says so, and there is no ratio to the stall speed.
    """
    model, held = two_peaks(alpha)
    report = hfa.trim(model, hfa.TrimCondition(model, held)).report()
    data = report.data
    peak = 1.0 + 1.5 * math.exp(-((0.4 / 0.12) ** 2))
    found = data["sheet"]["largest lift coefficient"]["value"]
    assert found == pytest.approx(peak, rel=1e-6)
    assert ("stalled" in data) == stalled
    assert report.title.splitlines()[2].startswith("STALLED: beyond") == stalled
    assert ("speed / stall speed" in values(data)) != stalled


def test_a_lift_coefficient_above_the_declared_largest_is_a_stall():
    """A trim with CL = (W - T sin α) / (q S), about .32, is called stalled if CL_max is .3.

    Mass and wing area of uav.toml are 13.5 kg and 0.55 m².
    """
    table = tomllib.loads((EXAMPLES / "uav.toml").read_text("utf-8"))
    table["geometry"]["CL_max"] = 0.3
    point = hfa.trim(hfa.from_derivatives(table))
    lift = 13.5 * 9.80665 - point["thrust"] * math.sin(point["alpha"])
    coefficient = lift / (point["dynamic_pressure"] * 0.55)
    assert f"\nSTALLED: CL {coefficient:.4g} is above CL_max 0.3" in point.report().title


# Configuration, air, performance.


#: Rows of a sheet that an engineer signs, or the ends of the names of their figures.
ROWS = (
    *("calibrated airspeed", "L/D", "power required", "thrust available", "rate of climb left"),
    *("speed / stall speed", "static margin", "neutral point behind c.g."),
    *("control per g", "control per knot"),
)


def bare():
    """Return a trim of the UAV without its outputs and configuration, as of a bare FMU."""
    uav = hfa.load_model(f"{EXAMPLES}/uav.toml")

    def equations(x, u, p, w):
        rates = uav.layout.expressions([[*x], [*u], [ca.DM(v) for v in uav.p]], ())[0]
        return dict(zip(uav.states, ca.vertsplit(rates), strict=True)), {}

    model = Model("bare", dict(uav.states), dict(uav.inputs), equations)
    point = hfa.trim(uav)
    return hfa.trim(model, hfa.TrimCondition(model, {n: point[n] for n in ("speed", "yaw")}))


def test_every_row_has_a_figure_or_is_not_in_this_model():
    """Each of `ROWS` of the sheet has a figure or a reason why it is "not in this model", for the flexible
    aircraft and for a model without outputs. "control per g" has the name of a control in a sheet.
    """
    for point, is_bare in ((sheet("hfa")[0], False), (bare(), True)):
        data = point.report().data
        for row in ROWS:
            figures = [each for each in values(data) if each.endswith(row.removeprefix("control"))]
            assert (row in data["not_in_model"]) != bool(figures), row
        for row in ("L/D", "atmosphere", "CAP"):
            assert (row in data["not_in_model"]) == is_bare


def test_beyond_mach_1_the_calibrated_airspeed_has_the_pitot_pressure_of_rayleigh():
    """The calibrated airspeed at M 1.3 and 80 kPa is the speed at sea level with as large an impact
    pressure behind a normal shock, after Rayleigh.
    """
    p, mach = 80e3, 1.3

    def impact(m, pressure):
        shock = (6.0 * m**2 / 5.0) ** 3.5 * (6.0 / (7.0 * m**2 - 1.0)) ** 2.5
        return pressure * (shock - 1.0)

    plane = Model(
        "plane",
        {"speed": Signal("m/s"), "alpha": Signal("rad")},
        {"throttle": Signal("1")},
        lambda x, u, p_, w: (
            {"speed": u.throttle - x.speed, "alpha": -x.alpha},
            {"mach": mach, "dynamic_pressure": 0.7 * p * mach**2},
        ),
        outputs={"mach": Signal("1"), "dynamic_pressure": Signal("N/m^2")},
        trim={"speed": 430.0},
    )
    found = hfa.trim(plane).report().data["sheet"]["calibrated airspeed"]["value"]
    calibrated = brentq(lambda m: impact(m, 101325.0) - impact(mach, p), 1.0, 1.3)
    assert found == pytest.approx(calibrated * 340.294 / KNOT, rel=1e-4)


# Levels of flying qualities and modes.


# Warnings, advice, several sheets.


@pytest.mark.parametrize("sign", [1.0, 0.0, -1.0])
def test_the_warning_of_yaw_stability_depends_on_the_sign_of_cn_beta_alone(sign):
    """The warning "out of the wind" is given if Cn_beta < 0, and not if it is positive or 0.

    The yaw acceleration by beta does not decide: with the planted Ixz and Cl_beta, it has the sign of
    -Ixz, opposite to that of Cn_beta.
    """
    Ixz = 0.3 * (sign or -1.0)
    uav = hfa.load_model(f"{EXAMPLES}/uav.toml")
    point = hfa.trim(uav.with_parameters(Ixz=Ixz, Cn_beta=0.06 * sign, Cl_beta=-0.4))
    assert point.linearize().A["yaw_rate", "beta"] * Ixz < 0.0
    assert ("out of the wind" in point.report().title) == (sign < 0.0)


def test_a_sheet_names_parameters_that_differ_from_the_file():
    """A parameter of --hold or `with_parameters` has the file's value beside it: in the text, in JSON, and in
    the head of the report. A parameter that is set to the file's value has not.
    """
    words = ("trim", "--aircraft", f"{EXAMPLES}/uav.toml", "--hold", "Cl_beta=-0.2")
    assert "Cl_beta -0.2 (as loaded: -0.12)" in command(*words).out
    changed = json.loads(command(*words, "--json").out)["provenance"]["changed"]
    assert changed == {"Cl_beta": {"value": -0.2, "usual": -0.12, "unit": "1"}}
    model = hfa.load_model(f"{EXAMPLES}/uav.toml").with_parameters(mass=14.0)
    report = hfa.trim(model).report()
    assert "mass 14 kg (as loaded: 13.5 kg)" in report.head["data"]
    assert report.data["sheet"]["mass"]["note"] == "as loaded: 13.5"
    assert hfa.trim(model.with_parameters(Cl_beta=-0.1)).sheet["Cl_beta"].value == -0.1
    as_loaded = hfa.trim(model.with_parameters(mass=13.5))
    assert "as loaded:" not in as_loaded.report().head["data"]


@pytest.mark.parametrize("name", ["cessna182.toml", "uav.toml"])
def test_the_anticipation_parameter_is_that_by_hand(name):
    """CAP = ω² / (n/α), with n/α = V q / (g α) of the steady response to elevator at constant V."""
    model = hfa.load_model(EXAMPLES / name)
    point = hfa.trim(model)
    linear = point.linearize()
    rows = [linear.states.index(name) for name in ("alpha", "pitch_rate")]
    B = np.array(linear.B)[rows, linear.inputs.index("elevator")]
    alpha, pitch_rate = -np.linalg.solve(np.array(linear.A)[np.ix_(rows, rows)], B)
    gravity = 9.80665 if model.unit("speed") == "m/s" else 32.174
    found = {row.name: row.value for row in point.sheet}
    by_alpha = point["speed"] * pitch_rate / alpha / gravity
    assert found["n/alpha"] == pytest.approx(by_alpha, rel=1e-5)
    assert found["CAP"] == pytest.approx(found["short period frequency"] ** 2 / by_alpha, rel=1e-5)


def test_a_trim_without_air_has_a_warning():
    """With the held controls, a search finds a trim at 40 km, where the density is 0."""

    def equations(x, u, p, w):
        density = 1.0 - x.altitude / 40e3
        rates = {
            "speed": u.thrust * ca.cos(x.alpha) - 1e-3 * density * x.speed**2,
            "alpha": density * (u.elevator - x.alpha),
            "altitude": x.speed * density * (x.alpha - 0.1),
        }
        return rates, {"density": density}

    states = {"speed": Signal("m/s", start=50.0), "alpha": Signal("rad", 0.1)}
    states["altitude"] = Signal("m", 1e3, start=1e3)
    inputs = {"elevator": Signal("rad", 0.1), "thrust": Signal("N")}
    outputs, trim = {"density": Signal("kg/m^3")}, {"elevator": -0.05, "thrust": 1.0}
    model = Model("kite", states, inputs, equations, outputs=outputs, trim=trim)
    point = hfa.trim(model, start={"altitude": 39e3, "alpha": -1.5})
    title = " ".join(point.report().title.split())
    assert "Check: alpha -90 deg: hardly a flight" in title
    assert "degrees without a unit" not in title  # which alpha is not taken for
