"""Proofs by boxes of equations with tables, kinks away from the trim and far bells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import pytest

import hfa
from hfa import Model, Signal
from hfa.extend import Table

KNOTS = [[-4.0, -1.0, 0.0, 1.0, 4.0]]
#: Name -> moment of an angle.
MOMENTS: dict[str, Callable[[Any], Any]] = {
    "linear table": ca.interpolant("moment", "linear", KNOTS, [-0.6, -0.5, 0.0, 0.5, 0.6]),
    "smooth table": ca.interpolant("smooth", "bspline", KNOTS, [-0.6, -0.5, 0.0, 0.5, 0.6]),
    "bell": lambda angle: 0.5 * angle + 0.1 * ca.exp(-(((angle - 9.0) / 0.2) ** 2)),
    "dead zone": lambda angle: angle - ca.fmax(0, ca.fabs(angle) - 0.6),
}


#: Kinds whose pieces the dead zone has, too.
SLOW = ("linear table", "smooth table", "bell")


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
    found = hfa.prove_region(model, hfa.trim(model), [[2.0, 1.5]], seconds=2.0)
    assert found.set.size() > 0.0


def test_a_set_reaches_a_limit() -> None:
    """x' = -2 x is stable everywhere, so that x <= 1 bounds the set. Ends are rounded outward."""
    model = Model(
        "lag",
        {"x": Signal(max=1.0)},
        {"u": Signal()},
        lambda x, u, p, w: ({"x": u.u - x.x}, {}),
        trim={"x": 0.0},
    )
    found = hfa.prove_region(model, hfa.trim(model), [[1.0]], seconds=1.0)
    table = next(part for part in found.report().parts if isinstance(part, Table))
    ((low, high),) = found.extents.values()
    shown = [float(cell.split()[0]) for cell in table.rows[0][1:3]]
    assert shown[0] <= low < -0.9
    assert 0.9 < high <= shown[1] <= 1.0
