"""Proofs by boxes of equations with tables, kinks away from the trim and far bells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from proofs import decided

import hfa
from hfa import Model, Signal
from hfa_prove.check.region_boxes import check_region
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.region import RegionStatement, RegionWitness

KNOTS = [[-4.0, -1.0, 0.0, 1.0, 4.0]]
#: Name -> moment of an angle.
MOMENTS: dict[str, Callable[[Any], Any]] = {
    "linear table": ca.interpolant("moment", "linear", KNOTS, [-0.6, -0.5, 0.0, 0.5, 0.6]),
    "smooth table": ca.interpolant("smooth", "bspline", KNOTS, [-0.6, -0.5, 0.0, 0.5, 0.6]),
    "bell": lambda angle: 0.5 * angle + 0.1 * ca.exp(-(((angle - 9.0) / 0.2) ** 2)),
    "dead zone": lambda angle: angle - ca.fmax(0, angle - 0.6) + ca.fmax(0, -angle - 0.6),
}


@pytest.mark.parametrize(("factor", "is_proved"), [(1.0, True), (2.0, False)])
@pytest.mark.parametrize("name", MOMENTS)
def test_a_set_is_proved_only_where_the_torque_exceeds_the_moment(
    name: str, factor: float, is_proved: bool
) -> None:
    """angle' = sat(-4 angle) + factor m(angle), saturated at 0.7: m(0.9) is 0.4 to 0.6."""
    moment = MOMENTS[name]
    model = Model(
        name,
        {"angle": Signal("rad")},
        {"torque": Signal("N m", 1.0, -0.7, 0.7)},
        lambda x, u, p, w: ({"angle": u.torque + factor * moment(x.angle)}, {}),
        trim={"angle": 0.0},
    )
    still = {"angle": 0.0}
    gain = Gain(np.array([[4.0]]), {})
    loop = Loop(model, {}, still, {"torque": 0.0}, {}, {"torque": (-0.7, 0.7)}, gain)
    piece = Piece(np.eye(1), Polynomial(1, ((1.0, (2,)),)), 0.81)
    statement = RegionStatement(loop, still, piece, {"angle": (-0.91, 0.91)})
    with decided(is_proved):
        assert check_region(statement, RegionWitness(np.full((1, 2), 0.55), 10**4)) > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", MOMENTS)
def test_a_region_about_the_trim_is_found(name: str) -> None:
    """Tables, kinks away from the trim and far bells do not prevent a search."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"angle": x.rate, "rate": u.torque + MOMENTS[name](x.angle) - 0.5 * x.rate}, {}

    states = {"angle": Signal("rad"), "rate": Signal("rad/s")}
    at = dict.fromkeys(states, 0.0)
    torque = Signal("N m", nominal=1.0, min=-0.7, max=0.7)
    model = Model(name, states, {"torque": torque}, equations, trim=at)
    found = hfa.prove_region(model, hfa.trim(model), [[2.0, 1.5]], seconds=2.0)
    assert found.set.size() > 0.0


SLOW_LIMITED = [pytest.param(name, marks=pytest.mark.slow) for name in ("torque", "angle")]


@pytest.mark.parametrize("limited", ["", *SLOW_LIMITED])
def test_a_linear_loop_has_a_region_only_with_limits(limited: str) -> None:
    """angle' = angle - 3 angle is stable from every angle; a limit of .5 bounds its region.

    An input without limits is not called saturated.
    """
    limits = {limited: (-0.5, 0.5)}
    unlimited = (-np.inf, np.inf)
    model = Model(
        "linear",
        {"angle": Signal("rad", 1.0, *limits.get("angle", unlimited))},
        {"torque": Signal("N m", 1.0, *limits.get("torque", unlimited))},
        lambda x, u, p, w: ({"angle": u.torque + x.angle}, {}),
        trim={"angle": 0.0},
    )
    point = hfa.trim(model)
    if not limited:
        with pytest.raises(hfa.BadInputError, match="stable from every state"):
            hfa.prove_region(model, point, [[3.0]], seconds=0.2)
        return
    found = hfa.prove_region(model, point, [[3.0]], seconds=1.0)
    assert 0.1 < found.statement.extents["angle"][1] <= 0.5
    assert ("saturated: torque" in found.report().text()) == (limited == "torque")
