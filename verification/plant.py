"""Nonlinear plant in deviations from its trim, with the limits of its inputs."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.expansion.expansion import rates_about_trim
from hfa_aircraft.batch_simulation import saturated
from hfa_aircraft.limits import Limits
from trim.linear.linear_model import LinearModel


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
        return self.rates(z, self.saturated(u))

    def saturated(self, u: ca.SX) -> ca.SX:
        """Return an input u within its limits."""
        return saturated(u, ca.DM(self.lowest), ca.DM(self.highest))


def nonlinear_plant(linear: LinearModel) -> NonlinearPlant:
    """Return the nonlinear plant about the trim of a linear model, with the limits of its inputs.

    The plant has the states and inputs of the linear model. All other states and inputs keep
    their values at the trim.
    """
    trim = linear.point.inputs._asdict()
    limits = Limits.of(linear.point.model, linear.inputs)
    at_trim = np.array([trim[name] for name in linear.inputs], dtype=float)
    lowest = np.minimum(limits.lowest - at_trim, 0.0)
    highest = np.maximum(limits.highest - at_trim, 0.0)
    return NonlinearPlant(rates_about_trim(linear), lowest, highest)
