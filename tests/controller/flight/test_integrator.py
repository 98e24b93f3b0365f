"""Steps of Runge-Kutta: what leaves every bound is said."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from controller.flight.integrator import integrate
from hfa_support import NoSolutionError


def test_a_flight_that_leaves_every_bound_is_said() -> None:
    t, y, p = ca.SX.sym("t"), ca.SX.sym("y"), ca.SX.sym("p", 0)
    rate = ca.Function("rate", [t, y, p], [y**3])
    with pytest.raises(NoSolutionError, match="left every bound at t = "):
        integrate(rate, np.array([10.0]), lambda tick: np.zeros(0), step=0.1, steps_per_tick=10, ticks=2)
