"""Random states and inputs in wider ranges than those of trims, and equations as CasADi columns."""

from __future__ import annotations

import casadi as ca
import numpy as np

import hfa
from hfa_model import Input, Parameters, State
from hfa_model.kinematics import STILL_AIR, Winds, winds_named
from hfa_model.outputs import moment_of
from hfa_model.variants import Variant
from hfa_model.vectors import INPUT_SIGNALS, STATE_SIGNALS, Quantity

STATE_SCALES = State(*(s.nominal for s in STATE_SIGNALS))
INPUT_SCALES = Input(*(s.nominal for s in INPUT_SIGNALS))
#: Scale of each state derivative.
RATE_SCALES = State(*map(hfa.aircraft().rate_scale, hfa.aircraft().states))
_LOWEST_STATE = State(20.0, -0.35, 0.0, -1.0, -1.0, -1.2, -1.0)
_HIGHEST_STATE = State(300.0, 0.35, 65_000.0, 1.0, 1.0, 1.2, 1.0)
_LOWEST_INPUT = Input(0.0, -0.35, -0.35, -0.5, -0.5)
_HIGHEST_INPUT = Input(200.0, 0.35, 0.35, 0.5, 0.5)


def random_points(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random states (count, 7) and inputs (count, 5), uniform between fixed limits."""
    rng = np.random.default_rng(seed)
    states = rng.uniform(_LOWEST_STATE, _HIGHEST_STATE, (count, len(_LOWEST_STATE)))
    inputs = rng.uniform(_LOWEST_INPUT, _HIGHEST_INPUT, (count, len(_LOWEST_INPUT)))
    return states, inputs


def symbols() -> list[ca.SX]:
    """Return new CasADi symbols [x (7,), u (5,), p (18,)]."""
    return hfa.aircraft().layout.symbols("x", "u", "p")


def by_name(x: ca.SX, u: ca.SX, p: ca.SX) -> tuple[State, Input, Parameters]:
    """Return columns of states, inputs and parameters as named tuples."""
    return State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), Parameters(*ca.vertsplit(p))


def rising(updraft: Quantity) -> Winds:
    """Return the winds for air that rises by `updraft` ft/s at every panel."""
    return winds_named(("updraft",), (updraft,))


def rates(x: State, u: Input, p: Parameters, variant: Variant, winds: Winds = STILL_AIR) -> State:
    """Return dX/dt of the equations of a variant as a named tuple."""
    return moment_of(x, u, p, variant, winds).rates


def state_rates(x: ca.SX, u: ca.SX, p: ca.SX, variant: Variant, winds: Winds = STILL_AIR) -> ca.SX:
    """Return dX/dt of the equations of a variant as a CasADi column, (7,)."""
    return ca.vertcat(*rates(*by_name(x, u, p), variant, winds))


def rates_function(variant: Variant) -> ca.Function:
    """Return the CasADi Function (x, u, p) -> dX/dt of the equations of a variant."""
    vectors = symbols()
    return ca.Function("rates", vectors, [state_rates(*vectors, variant)])
