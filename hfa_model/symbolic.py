"""f(x, u, p) in columns, as CasADi takes it: built here for whatever compiles, differentiates or solves it."""

from __future__ import annotations

import casadi as ca

from hfa_model.dynamics import rates
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import INPUTS, STATES, Input, Quantity, State
from hfa_model.winds import Air


def state_rates(x: ca.SX, u: ca.SX, p: ca.SX | Parameters[Quantity], variant: Variant, air: Air = 0.0) -> ca.SX:
    """dX/dt, a column (7,) in the order of `STATES`: `dynamics.rates` of columns.

    x: (7,), u: (5,). p: (18,) in the order of `Parameters`, or a `Parameters`. air: a uniform updraft,
    ft/s, positive up, or the wind at each panel.
    """
    return ca.vertcat(*rates(*by_name(x, u, p), variant, air))


def by_name(
    x: ca.SX, u: ca.SX, p: ca.SX | Parameters[Quantity]
) -> tuple[State[Quantity], Input[Quantity], Parameters[Quantity]]:
    """The components of columns as `dynamics` and `aerodynamics` name them; a `Parameters` stays what it is."""
    parameters = p if isinstance(p, Parameters) else Parameters(*ca.vertsplit(p))
    return State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), parameters


def symbols() -> tuple[ca.SX, ca.SX, ca.SX]:
    """New symbols x (7,), u (5,), p (18,)."""
    sizes = {"x": len(STATES), "u": len(INPUTS), "p": len(Parameters._fields)}
    x, u, p = (ca.SX.sym(name, size) for name, size in sizes.items())
    return x, u, p
