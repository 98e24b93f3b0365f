"""Records of simulated flights with sensor noise."""

from functools import cache
from types import SimpleNamespace

import numpy as np
from project import ROOT
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

import hfa

#: Measured state -> standard deviation of its noise.
SENSORS = {"speed": 0.3, "alpha": 0.003, "pitch_rate": 0.01, "pitch": 0.003}
FREE = ("CL_0", "CL_alpha", "CD_0", "Cm_0", "Cm_alpha", "Cm_q", "Cm_elevator")
UAV = str(ROOT / "examples" / "uav.toml")
AIRCRAFT = hfa.from_derivatives(UAV)
#: Duration of a record and time between samples, s.
SECONDS = 8.0
STEP = 0.04
#: States of the longitudinal motion, and the inputs that affect them.
_STATES = ("speed", "alpha", "pitch_rate", "pitch")
_INPUTS = ("thrust", "elevator")


def longitudinal(aircraft):
    """Return the longitudinal motion of a rigid aircraft at constant altitude, as a model."""
    states, inputs = list(aircraft.states), list(aircraft.inputs)
    held = {name: aircraft.trim.get(name, 0.0) for name in (*states, *inputs)}

    def equations(x, u, p, w):
        at = held | {name: getattr(x, name) for name in _STATES}
        at |= {name: getattr(u, name) for name in _INPUTS}
        full_x = SimpleNamespace(**{name: at[name] for name in states})
        full_u = SimpleNamespace(**{name: at[name] for name in inputs})
        rates, outputs = aircraft.equations(full_x, full_u, p, w)
        return {name: rates[name] for name in _STATES}, {"gamma": outputs["gamma"]}

    return hfa.Model(
        name=aircraft.name,
        states={name: aircraft.states[name] for name in _STATES},
        inputs={name: aircraft.inputs[name] for name in _INPUTS},
        equations=equations,
        parameters=aircraft.parameters,
        outputs={"gamma": aircraft.outputs["gamma"]},
        trim={name: aircraft.trim[name] for name in ("speed", "gamma")},
    )


LONGITUDINAL = longitudinal(AIRCRAFT)


def begun(factor):
    """Return the longitudinal aircraft with every free parameter multiplied by `factor`."""
    return LONGITUDINAL.with_parameters(**{name: factor * true_value(name) for name in FREE})


def true_value(name):
    return float(AIRCRAFT.parameters[name].start)


@cache
def _maneuver(model):
    """Return the columns of a 3-2-1-1 elevator maneuver (2 deg, unit 0.4 s), by SciPy."""
    point = hfa.trim(model)
    time = np.arange(0.0, SECONDS, STEP)
    inputs = np.tile(np.array(point.inputs), (len(time), 1))
    place = np.searchsorted([0.5, 1.7, 2.5, 2.9, 3.3], time, side="right")
    moves = np.radians(2.0) * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[place]
    inputs[:, list(model.inputs).index("elevator")] += moves
    f = model.functions()

    def rates(at, x):
        u = [np.interp(at, time, column) for column in inputs.T]
        return np.asarray(f(x, u, model.p)[0].full().ravel())

    ends, begin = (0.0, time[-1]), list(point.states)
    flown = solve_ivp(rates, ends, begin, t_eval=time, rtol=1e-6, atol=1e-8, max_step=STEP)
    states = dict(zip(model.states, flown.y, strict=True))
    measured = {name: states[name] for name in SENSORS}
    return {"time": time, **dict(zip(model.inputs, inputs.T, strict=True)), **measured}


def record(
    seed=0,
    pole=0.0,
    model=LONGITUDINAL,
    sensors=SENSORS,
):
    """Return the columns of the maneuver with sensor noise.

    pole: pole of the noise, 0 for white noise
    sensors: state -> standard deviation of its noise
    """
    generator = np.random.default_rng(seed)
    columns = dict(_maneuver(model))
    for name, size in sensors.items():
        white = generator.standard_normal(len(columns["time"]) + 500)
        noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white)[500:]
        columns[name] = columns[name] + size * noise
    return columns
