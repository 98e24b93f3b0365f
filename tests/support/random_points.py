"""Random states and inputs in wider ranges than those of trims, and equations as CasADi functions."""

import casadi as ca
import numpy as np

import hfa
from hfa_aircraft.signals import record
from hfa_model import Input, State

_AIRCRAFT = hfa.aircraft()
#: Names of the disturbances: a component of the wind at all panels, at the center or outside.
WINDS = tuple(_AIRCRAFT.disturbances)
STATE_SCALES = State(*(signal.nominal for signal in _AIRCRAFT.states.values()))
INPUT_SCALES = Input(*(signal.nominal for signal in _AIRCRAFT.inputs.values()))
#: Scale of each state derivative.
RATE_SCALES = State(*map(_AIRCRAFT.rate_scale, _AIRCRAFT.states))


def random_points(count, seed):
    """Return random states (count, 7) and inputs (count, 5) of the HFA, uniform between limits that
    are wider than those of trims.
    """
    rng = np.random.default_rng(seed)
    lowest = State(20.0, -0.35, 0.0, -1.0, -1.0, -1.2, -1.0)
    highest = State(300.0, 0.35, 65_000.0, 1.0, 1.0, 1.2, 1.0)
    states = rng.uniform(lowest, highest, (count, 7))
    lowest, highest = Input(0.0, -0.35, -0.35, -0.5, -0.5), Input(200.0, 0.35, 0.35, 0.5, 0.5)
    return states, rng.uniform(lowest, highest, (count, 5))


def wind_of(values=(), **named):
    """Return a record of all winds, ft/s: values in the order of `WINDS`, or named ones."""
    values = [*values] or [named.get(name, 0.0) for name in WINDS]
    return record(WINDS)(*values)


def equations(x, u, p, dynamics, wind=None):
    """Return the rates and outputs of these dynamics, each by name."""
    return hfa.aircraft(dynamics).equations(x, u, p, wind_of() if wind is None else wind)


def rates_function(layout, rates_of):
    """Return the CasADi Function (x, u, p, w) -> dX/dt of equations of an aircraft.

    layout: names of the vectors of the aircraft
    rates_of: function of the named x, u, p and w that returns the rates by name
    """
    vectors = layout.symbols(*"xupw")
    named = zip(layout.names[:4], vectors, strict=True)
    x, *rest = [record(names)(*ca.vertsplit(vector)) for names, vector in named]
    found = rates_of(x, *rest)
    return ca.Function("rates", vectors, [ca.vertcat(*map(found.get, x._fields))])
