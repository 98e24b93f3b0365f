"""Fuel, payload, wind, failed engines, and filters with states, compared with JSBSim."""

import numpy as np
import pytest
from constructs.jet import coefficient, jet, slope
from jsbsim_flights import positions
from jsbsim_reference import AXES, GRAVITY, RADIUS, responses
from scipy.integrate import solve_ivp
from small_aircraft import glider, needs_jsbsim, written

from hfa import load_model, trim

WIND = {"wind_north": 30.0, "wind_east": -20.0, "wind_down": 4.0}
JET = {"kcas": 250.0, "altitude": 5000.0}
#: Aircraft, calibrated airspeed, and throttle for which no torque limiter is active.
PROPELLERS = (
    ("c310", 110.0, 1.0),
    ("DHC6", 120.0, 0.7),
    ("Boeing314", 130.0, 1.0),
    ("B17", 130.0, 1.0),
    ("fokker50", 130.0, 0.05),
)
LIGHT = {"kcas": 90.0, "altitude": 3000.0}
#: Hands off without power: a spiral dive, far from the level flight of the default search.
DIVE = {"altitude": 7000.0, "throttle": 0.0, "elevator": 0.0, "aileron": 0.0, "rudder": 0.0}


def residual(name, held, parameters, free=()):
    """Return the largest acceleration in JSBSim at the model's trim, ft/s² or rad/s², and the
    weights of the aircraft in the model and in JSBSim, lb.

    held: values imposed on the trim
    parameters: values of parameters, such as tank contents
    free: variables that are freed
    """
    gravity = GRAVITY * (RADIUS / (RADIUS + held["altitude"])) ** 2
    model = load_model(f"jsbsim:{name}").with_parameters(gravity=gravity, **parameters)
    point = trim(model, hold=held, free=free)
    commands = point.inputs._asdict() | parameters
    held_there = positions(model, point.inputs._asdict())
    point_of_jsbsim = {"state": point.states._asdict(), "commands": commands, "held": held_there}
    (answer,) = responses([{"aircraft": name, "point": point_of_jsbsim}])
    weight = model.outputs_at(point.states, point.inputs, ["weight"])["weight"]
    return max(abs(answer[axis]) for axis in AXES), weight, answer["weight"]


@needs_jsbsim
@pytest.mark.parametrize(
    ("name", "held", "parameters", "free"),
    [
        ("737", JET, {"tank0": 300.0, **WIND}, ()),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("737", JET, {"engine1": 0.0}, ()),
                ("A320", JET, {"tank0": 300.0}, ()),
                ("f15", JET, {"tank0": 300.0}, ()),
                ("c172p", LIGHT, {"pointmass0": 120.0, "tank0": 60.0}, ()),
                ("c182", LIGHT, {"pointmass0": 120.0}, ()),
                ("pa28", LIGHT, {"pointmass0": 120.0}, ()),
                ("J3Cub", {"kcas": 60.0, "altitude": 3000.0}, {"pointmass0": 120.0}, ()),
                ("c172p", LIGHT, WIND, ()),
                ("sgs126", {"kcas": 60.0, "altitude": 3000.0}, WIND, ()),
                ("f15", JET, WIND, ()),
                ("B747", JET, {"engine1": 0.0}, ()),
                # In JSBSim, quantities that the systems of these files move are held at the values
                # of the model, and actuators start in equilibrium.
                ("X15", {"kcas": 300.0, "altitude": 20000.0}, {}, ()),
                ("f16", {"kcas": 300.0, "altitude": 20000.0}, {}, ()),
                ("p51d", {"kcas": 200.0, "altitude": 10000.0}, {}, ()),
                ("c172x", LIGHT, {}, ()),
                ("c172x", DIVE, {}, ("speed", "beta", "gamma", "turn_rate")),
                ("T38", JET, {"engine1": 0.0}, ()),
                ("F4N", JET, {"engine1": 0.0}, ()),
                *(
                    (name, {"kcas": kcas, "altitude": 3000.0, "throttle": share}, out, ("gamma",))
                    for name, kcas, share in PROPELLERS
                    for out in ({"engine1": 0.0}, {"engine1": 0.0, "feather1": 1.0})
                    # The feathered engine of the DHC6 has not settled in JSBSim after two minutes.
                    if (name, len(out)) != ("DHC6", 2)
                ),
            )
        ),
    ],
)
def test_trims_have_no_acceleration_in_jsbsim(name, held, parameters, free):
    """At the model's trims with loads, wind and failed engines, JSBSim's accelerations are below
    1e-9 ft/s² or rad/s², and the weights in both programs agree.
    """
    acceleration, weight, weight_in_jsbsim = residual(name, held, parameters, free)
    assert acceleration < 1e-9
    assert weight == pytest.approx(weight_in_jsbsim, rel=1e-14)


@needs_jsbsim
@pytest.mark.parametrize("name", ["737", pytest.param("f16", marks=pytest.mark.slow)])
def test_warm_air_is_that_of_jsbsim(name):
    """At a trim in warm air, JSBSim's accelerations are below 1e-9, with its thrust from tables over
    Mach number and density altitude.

    JSBSim is given the true altitude 5000 ft and `atmosphere/delta-T` 27 °R. It then has the pressure
    of 4752.54 ft in the standard atmosphere and the temperature 527.843473790188 °R, which is warmer
    than the standard one there by 14.509964093413366 K. The model is given this pressure altitude, and
    this excess as the parameter isa.
    """
    true_altitude, pressure_altitude, warmer = 5000.0, 4752.541346072101, 14.509964093413366
    gravity = GRAVITY * (RADIUS / (RADIUS + true_altitude)) ** 2
    model = load_model(f"jsbsim:{name}").with_parameters(gravity=gravity, isa=warmer)
    point = trim(model, speed=500.0, altitude=pressure_altitude)
    there = {
        "state": point.states._asdict() | {"altitude": true_altitude},
        "commands": point.inputs._asdict(),
        "held": positions(model, point.inputs._asdict()) | {"atmosphere/delta-T": 27.0},
    }
    (answer,) = responses([{"aircraft": name, "point": there}])
    assert max(abs(answer[axis]) for axis in AXES) < 1e-9


#: States and commands of the glider: 120 ft/s, alpha 0.1 rad, 1000 ft, all others 0. With the pitch 0
#: and the heading north, it descends at 0.1 rad.
FLIGHT = [120.0, 0.1, *[0.0] * 7, 1000.0], [0.0] * 3


def test_gusts_act_on_moments_by_the_flow_that_they_cause(tmp_path):
    """An updraft changes alpha by cos(0.1) / 120 rad and the airspeed by sin(0.1) ft/s for each ft/s, and
    acts on the pitch acceleration by both. A gust to the east changes beta by -1 / 120 rad, and acts on
    the yaw acceleration by it.
    """
    model = load_model(written(tmp_path, glider()))
    A, E = model.at(*FLIGHT).A, model.at(*FLIGHT, disturbances=("updraft", "gust_east")).E
    names = ("pitch_rate", "yaw_rate", "alpha", "beta", "speed")
    pitch, yaw, alpha, beta, speed = (list(model.states).index(name) for name in names)
    by_flow = A[pitch, alpha] * np.cos(0.1) / 120.0 + A[pitch, speed] * np.sin(0.1)
    assert E[pitch, 0] == pytest.approx(by_flow, rel=1e-9)
    assert E[yaw, 1] == pytest.approx(-A[yaw, beta] / 120.0, rel=1e-9)


DAMPERS = {
    "washout": "<washout_filter name='d'> <input>{}</input> <c1>2</c1> {} </washout_filter>",
    "lag": "<lag_filter name='d'> <input>{}</input> <c1>3</c1> {} </lag_filter>",
    "lead and lag": (
        "<lead_lag_filter name='d'> <input>{}</input> <c1>1</c1> <c2>2</c2> <c3>1</c3> <c4>5</c4>"
        " {} </lead_lag_filter>"
    ),
    "actuator": "<actuator name='d'> <input>{}</input> <lag>4</lag> {} </actuator>",
}


@needs_jsbsim
@pytest.mark.parametrize(
    "kind", ["washout", *(pytest.param(kind, marks=pytest.mark.slow) for kind in [*DAMPERS][1:])]
)
def test_a_damper_with_filter_states_agrees_with_jsbsim(tmp_path, kind):
    """After a second of flight with a yaw damper, the yaw rate with filters as states is ten times
    closer to JSBSim's than that with the static gain of the filter.
    """
    text = DAMPERS[kind].format("velocities/r-rad_sec", "<output>fcs/probe</output>")
    axis = coefficient(slope(-0.3, "fcs/probe"), slope(0.1, "aero/beta-rad"), length="bw-ft")
    slots = {
        "channels": f'<channel name="damper"> {text} </channel>',
        "axes": f'<axis name="YAW"> {axis} </axis>',
    }
    plain = jet(slots)
    # JSBSim uses only the last of two YAW axes, the jet's own: it is removed for the damper's.
    start = plain.rindex('<axis name="YAW">')
    end = plain.index("</axis>", start) + len("</axis>")
    path = written(tmp_path, plain[:start] + plain[end:], "damped")
    state = {"altitude": 5000.0, "speed": 350.0, "alpha": 0.03, "beta": 0.05, "pitch": 0.03}
    point = {"state": state, "commands": {"throttle": 0.0}, "flight": 1.0}
    (answer,) = responses([{"aircraft": "damped", "root": str(tmp_path), "point": point}])
    # Without filter states, each filter is its static gain.
    steady = states_after_a_second(load_model(path), state)
    model = states_after_a_second(load_model(f"{path}?filters=states"), state)
    miss = abs(model["yaw_rate"] - answer["yaw_rate"])  # JSBSim's components lag by one step
    assert miss < 0.1 * abs(steady["yaw_rate"] - answer["yaw_rate"])


def states_after_a_second(model, state):
    """Return the states after one second of flight with closed throttle, by name.

    state: initial state by name
    """
    x = [state.get(name, 0.0) for name in model.states]
    u = [0.0] * len(model.inputs)
    flown = solve_ivp(lambda _, at: [*model.rates_at(at, u).values()], (0.0, 1.0), x, rtol=1e-9)
    return dict(zip(model.states, flown.y[:, -1].tolist(), strict=True))
