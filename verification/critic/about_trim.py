"""Nonlinear plant in deviations from its trim, and box of states in which critics are compared."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.game.linear_game import widths_within_limits
from hfa_aircraft.limits import Limits
from trim.linear.linear_model import LinearModel
from verification.critic.critic_errors import Box, limited_box


class NonlinearPlant(NamedTuple):
    """Nonlinear plant in deviations z and u of state and input from its trim.

    rates: CasADi Function (z, u) -> z'
    lowest, highest: (m,), limits of u, which include 0
    """

    rates: ca.Function
    lowest: np.ndarray
    highest: np.ndarray

    def closed(self, z: ca.SX, u: ca.SX) -> ca.SX:
        """Return the rate z' for a state z and an input u, which is saturated at its limits."""
        return self.rates(z, ca.fmin(ca.fmax(u, ca.DM(self.lowest)), ca.DM(self.highest)))


def nonlinear_plant(linear: LinearModel) -> NonlinearPlant:
    """Return the nonlinear plant about the trim of a linear model, with the limits of its inputs.

    The plant has the states and inputs of the linear model. All other states and inputs keep
    their values at the trim.
    """
    point = linear.point
    model = point.model
    z = ca.SX.sym("z", len(linear.states))
    u = ca.SX.sym("u", len(linear.inputs))
    deviations = dict(zip(linear.states, ca.vertsplit(z), strict=True))
    deviations |= dict(zip(linear.inputs, ca.vertsplit(u), strict=True))
    states = [value + deviations.get(name, 0.0) for name, value in point.states._asdict().items()]
    trim = point.inputs._asdict()
    inputs = [value + deviations.get(name, 0.0) for name, value in trim.items()]
    rates, _ = model.layout.expressions((states, inputs, model.p.tolist()), ())
    rows = [list(model.states).index(name) for name in linear.states]
    limits = Limits.of(model, linear.inputs)
    at_trim = np.array([trim[name] for name in linear.inputs], dtype=float)
    lowest = np.minimum(limits.lowest - at_trim, 0.0)
    highest = np.maximum(limits.highest - at_trim, 0.0)
    return NonlinearPlant(ca.Function("plant", [z, u], [rates[rows]]), lowest, highest)


def box_within_limits(linear: LinearModel) -> Box | None:
    """Return the box of `widths_within_limits`, or None."""
    half_widths = widths_within_limits(linear)
    return None if half_widths is None else limited_box(half_widths)
