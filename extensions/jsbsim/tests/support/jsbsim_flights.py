"""Flights from random states, for comparison with JSBSim.

Throttle, elevator, aileron and rudder are moved in steps. Lags of engines and filters are states of
the model. JSBSim's earth is replaced by a sphere without rotation that is large enough to be flat.
"""

import re

import casadi as ca
import numpy as np
from jsbsim_reference import GRAVITY
from scipy.optimize import root

from hfa import trim
from hfa_aircraft.batch_simulation import rk4
from hfa_jsbsim.reader import read_model

CONDITIONS = {"737": (250.0, 10000.0), "c172p": (90.0, 3000.0), "DHC6": (110.0, 3000.0)}
#: Radius of the sphere, ft. The flights cover less than 1e-6 rad of it.
RADIUS = 1e10
_REST = 6.0
#: Number of integration steps in a second.
_OURS = 480
_COMPARED = ("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate", "roll", "pitch")


def trimmed(name):
    """Return an aircraft over a flat earth and its trim at the condition in `CONDITIONS`.

    name: value of the option `--aircraft`, such as "jsbsim:737?filters=states"
    """
    model = read_model(name).with_parameters(gravity=GRAVITY)
    condition = CONDITIONS[name.removeprefix("jsbsim:").partition("?")[0]]
    held = dict(zip(("kcas", "altitude"), condition, strict=True))
    return model, trim(model, hold=held)


def drawn(point, seconds, seed):
    """Return a request for `responses`: a random flight that begins near a trim.

    It has steps of the throttle, and later pulses of elevator, aileron and rudder.
    """
    rng = np.random.default_rng(seed)
    state = point.states._asdict()
    inputs = point.inputs._asdict()
    start = {name: state[name] for name in (*_COMPARED, "altitude", "yaw")}
    start["speed"] *= rng.uniform(0.95, 1.05)
    for name, size in (("alpha", 0.01), ("beta", 0.01), ("roll", 0.1), ("pitch", 0.03)):
        start[name] += rng.uniform(-size, size)
    for name in ("roll_rate", "pitch_rate", "yaw_rate"):
        start[name] += rng.uniform(-0.02, 0.02)
    stick = inputs.get("elevator", 0.0) + rng.uniform(-0.05, 0.05)
    changes = [
        [1.0, {"throttle": rng.uniform(0.2, 0.9)}],
        [3.0, {"elevator": stick}],
        [4.0, {"elevator": inputs.get("elevator", 0.0)}],
        [5.0, {"aileron": inputs.get("aileron", 0.0) + rng.uniform(-0.1, 0.1)}],
    ]
    flight = {"state": start, "commands": inputs, "changes": changes, "flight": seconds}
    return flight | {"rest": _REST, "radius": RADIUS}


def difference(model, flight, answer):
    """Return the largest difference of a compared state from JSBSim, divided by its nominal value.

    The states are compared once per second.

    flight: the request
    answer: JSBSim's response to the request
    """
    ours = simulated(model, flight, answer["start"])
    worst = 0.0
    for name in _COMPARED:
        theirs = np.array([state[name] for state in answer["states"]])
        column = ours[:, list(model.states).index(name)]
        worst = max(worst, float(np.abs(column - theirs).max()) / model.signals[name].nominal)
    return worst


def simulated(model, flight, start):
    """Return the states of a flight after each second, (seconds, n), by the classical Runge-Kutta
    method.

    flight: request with commands and their changes
    start: JSBSim's states at the start of the flight
    """
    x = _settled(model, flight, start)
    step = _second(model)
    commands = dict(flight["commands"])
    changes = list(flight["changes"])
    rows = []
    for time in range(int(flight["flight"])):
        while changes and changes[0][0] <= time:
            commands |= changes.pop(0)[1]
        held = ca.repmat(ca.DM([commands[name] for name in model.inputs]), 1, _OURS)
        x = step(x, held)[:, -1]
        rows.append(np.array(x).ravel())
    return np.array(rows)


def _settled(model, flight, start):
    """Return the initial state of a flight, (n,)."""
    u = [flight["commands"][name] for name in model.inputs]
    names = list(model.states)
    x = np.array([start.get(name, 0.0) for name in names])
    inner = [number for number, name in enumerate(names) if name not in start]
    if not inner:
        return x

    def rates(values):
        there = x.copy()
        there[inner] = values
        found = model.rates_at(there.tolist(), u)
        return np.array([found[names[number]] for number in inner])

    x[inner] = root(rates, x[inner]).x
    return x


def _second(model):
    """Return the function (x, u of each step) -> states after each step of one second."""
    x = ca.SX.sym("x", len(model.states))
    u = ca.SX.sym("u", len(model.inputs))
    p = [signal.start for signal in model.parameters.values()]
    equations = model.equations
    function = equations.still
    h = 1.0 / _OURS

    after = rk4(lambda x, _: function(x, u, ca.DM(p))[0], x, h)
    return ca.Function("step", [x, u], [after], {"cse": True}).mapaccum("second", _OURS)


def positions(model, inputs):
    """Return the values of JSBSim properties for the inputs of a model that are positions.

    JSBSim normally computes these positions from the pilot's commands.

    inputs: name of an input -> value
    """
    held = {}
    for name, signal in model.inputs.items():
        if signal.unit == "rad":
            sides = {"left-": 1.0, "right-": -1.0} if name == "aileron" else {"": 1.0}
            for side, sign in sides.items():
                held[f"fcs/{side}{name}-pos-rad"] = sign * inputs[name]
    for note in model.about.notes:
        if not note.startswith("the input is the throttle position"):
            continue
        for number in re.findall(r"engine (\d+)", note):
            index = "" if number == "0" else f"[{number}]"
            held[f"fcs/throttle-cmd-norm{index}"] = inputs["throttle"]
            held[f"fcs/throttle-pos-norm{index}"] = inputs["throttle"]
    return held
