"""Proofs by boxes of equations with tables, kinks away from the trim and far bells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from hfa_aircraft.model import Model, Signal
from hfa_prove.search.clock import Clock
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import Region, RegionProblem, Settings
from hfa_prove.statements.loop import Gain, Loop

KNOTS = [[-4.0, -1.0, 0.0, 1.0, 4.0]]
#: Name -> moment of an angle.
MOMENTS: dict[str, Callable[[Any], Any]] = {
    "linear table": ca.interpolant("moment", "linear", KNOTS, [-0.6, -0.5, 0.0, 0.5, 0.6]),
    "smooth table": ca.interpolant("smooth", "bspline", KNOTS, [-0.6, -0.5, 0.0, 0.5, 0.6]),
    "bell": lambda angle: 0.5 * angle + 0.1 * ca.exp(-(((angle - 9.0) / 0.2) ** 2)),
    "dead zone": lambda angle: angle - ca.fmax(0, ca.fabs(angle) - 0.6),
}


#: Kinds whose pieces the other two have, too.
SLOW = ("linear table", "bell")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in MOMENTS],
)
def test_a_region_about_the_trim_is_proved(name: str) -> None:
    """Tables, kinks away from the trim and far bells do not prevent a proof by boxes."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"angle": x.rate, "rate": u.torque + MOMENTS[name](x.angle) - 0.5 * x.rate}, {}

    states = {"angle": Signal("rad"), "rate": Signal("rad/s")}
    at = dict.fromkeys(states, 0.0)
    torque = Signal("N m", nominal=1.0, min=-0.7, max=0.7)
    model = Model(name, states, {"torque": torque}, equations, trim=at)
    limits = {"torque": (-0.7, 0.7)}
    loop = Loop(model, {}, at, {"torque": 0.0}, {}, limits, Gain(np.array([[2.0, 1.5]])))
    found: list[Region] = []

    def stop(region: Region) -> None:
        found.append(region)
        raise KeyboardInterrupt

    BoxesSearch(RegionProblem(loop), Settings(2, Clock(60.0), stop)).found()
    assert found[0].size > 0
