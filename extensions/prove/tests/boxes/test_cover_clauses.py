"""Clauses of the cover by boxes, of the enclosed equilibrium, and of policies in a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from proofs import decided

from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cover import (
    Boxes,
    Question,
    RefutedError,
    SmallestBoxError,
    cover,
)
from hfa_prove.check.equilibrium import equilibrium_near
from hfa_prove.check.region_boxes import check_region
from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.taylor import TaylorProgram, lowest
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.region import RegionStatement, RegionWitness


@dataclass(frozen=True, eq=False)
class Positive(Question):
    """The property that a function of y is positive in the cube, to be proved by branch and bound."""

    taylor: TaylorProgram

    @property
    def n(self) -> int:
        return self.taylor.n

    @property
    def at_once(self) -> int:
        return self.taylor.at_once

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        return np.zeros(len(boxes.centres), dtype=bool)

    def edges(self, boxes: Boxes) -> np.ndarray:
        models = self.taylor.over(boxes.centres, boxes.half_widths)
        return np.where(lowest(models, self.n)[0] > 0.0, -1, np.argmin(boxes.depths, axis=1))


def programmed(expression: ca.SX, y: ca.SX) -> TaylorProgram:
    return TaylorProgram(Program(ca.Function("f", [y], [expression]), "f"), y.numel())


@pytest.mark.parametrize("at_once", [1, 3])
def test_boxes_that_wait_for_another_batch_are_examined(at_once: int) -> None:
    """The decided boxes fill the cube if no more than a few boxes are evaluated at a time."""
    decided = []

    class Few(Positive):
        @property
        def at_once(self) -> int:
            return at_once

        def edges(self, boxes: Boxes) -> np.ndarray:
            edges = super().edges(boxes)
            decided.append(np.ldexp(1.0, -boxes.depths.sum(axis=1))[edges < 0].sum())
            return edges

    y = ca.SX.sym("y", 2)
    program = programmed(1.1 + ca.sin(4 * y[0]) * ca.cos(3 * y[1]), y)
    assert cover(Few(program), 10**4) > 8
    assert sum(decided) == 1.0


def test_no_edge_is_halved_beyond_double_precision() -> None:
    """No edge of a box is halved more than 53 times.

    The function is 0 at y_0 = 0.3, near which the first edge is halved again and again.
    """
    depths = []

    class Deep(Positive):
        def edges(self, boxes: Boxes) -> np.ndarray:
            depths.append(int(boxes.depths.max()))
            return np.where(super().edges(boxes) >= 0, 0, -1)

    y = ca.SX.sym("y", 2)
    with pytest.raises(SmallestBoxError):
        cover(Deep(programmed((y[0] - 0.3) ** 2, y)), 10**4)
    assert max(depths) == 53


@pytest.mark.parametrize("margin", [1e-13, -1e-13])
def test_a_margin_of_1e13_decides_a_network(margin: float) -> None:
    """A region of a network is proved if the margin of V' is 1e-13, and refused if it is -1e-13.

    For x' = -x (x - 1/2)² + u with u = -margin x, V' at x = 1/2 consists of the margin alone.
    """
    z = ca.SX.sym("z", 1)
    hidden = ca.fmax(ca.vertcat(z, -z), 0)
    network = ca.Function("u", [z], [ca.DM([[-margin, margin]]) @ hidden])
    model = Model(
        "tank",
        {"level": Signal("m")},
        {"valve": Signal("m/s")},
        lambda x, u, p, w: ({"level": u.valve - x.level * (x.level - 0.5) ** 2}, {}),
        trim={"level": 0.0},
    )
    loop = Loop(model, {}, {"level": 0.0}, {"valve": 0.0}, {}, {}, network)
    piece = Piece(np.eye(1), Polynomial(1, ((1.0, (2,)),)), 0.81)
    statement = RegionStatement(loop, {"level": 0.0}, piece, {"level": (-0.91, 0.91)})
    witness = RegionWitness(np.full((1, 2), 0.55), 10**6)
    with decided(margin > 0.0, error=RefutedError):
        assert check_region(statement, witness) > 0


def _still(rates: ca.Function) -> Any:
    """Return a plant with given rates of its states, whose nominal values are 1."""
    return SimpleNamespace(
        rate_function=rates,
        program=Program(rates, "f"),
        nominal=np.ones(rates.numel_in(0)),
        model=SimpleNamespace(name="f"),
    )


@pytest.mark.parametrize(
    ("rates", "root"),
    [
        (lambda x: ca.vertcat(x[0] ** 2 - 1, x[1]), [1.0, 0.0]),
        (lambda x: ca.vertcat(x[0] ** 2 + 1, x[1]), None),
        (lambda x: ca.vertcat(x[0] - 1, x[1] ** 2 + 1), None),
    ],
)
def test_an_equilibrium_is_enclosed_in_every_coordinate(
    rates: Callable[[ca.SX], ca.SX], root: list[float] | None
) -> None:
    """A root is enclosed; rates of which the first or the second entry has none are refused."""
    x = ca.SX.sym("x", 2)
    loop = _still(ca.Function("f", [x], [rates(x)]))
    with decided(root is not None, "no equilibrium is enclosed"):
        assert equilibrium_near(loop, np.array([0.7, 0.2])).x == pytest.approx(root)


def _bump(x: Any) -> Any:
    """Return an odd function: 0 to 0.13, up to 0.28 at 0.2, and below 0 from 0.2175 on."""
    parts = [4.0 * ca.fmax(t - 0.13, 0.0) - 20.0 * ca.fmax(t - 0.2, 0.0) for t in (x, -x)]
    return parts[0] - parts[1]


@pytest.mark.parametrize(("height", "is_proved"), [(0.2, True), (1.0, False)])
def test_increase_beside_the_hole_is_refused(height: float, is_proved: bool) -> None:
    """The higher bump increases |x| between 0.18 and 0.21, beyond the hole |x| <= 1/8."""
    model = Model(
        "rings",
        {"angle": Signal("rad")},
        {},
        lambda x, u, p, w: ({"angle": height * _bump(x.angle) - x.angle}, {}),
        trim={},
    )
    none = ca.Function("u", [ca.SX.sym("z", 1)], [ca.SX(0, 1)])
    loop = Loop(model, {}, {"angle": 0.0}, {}, {}, {}, none)
    piece = Piece(np.eye(1), Polynomial(1, ((1.0, (2,)),)), 0.9)
    statement = RegionStatement(loop, {"angle": 0.0}, piece, {"angle": (-1.1, 1.1)})
    with decided(is_proved, error=RefutedError):
        assert check_region(statement, RegionWitness(np.zeros((1, 2)), 10**4)) > 0


def test_the_exact_equilibrium_is_enclosed() -> None:
    """Rounding displaces the computed root of 1.5 x = 0.3, by most of the radius of its box."""
    level = 0.3
    x = ca.SX.sym("x")
    rate = ca.sqrt((x + 1e6) ** 2) - 1e6 + 0.5 * x - level
    found = equilibrium_near(_still(ca.Function("f", [x], [rate])), np.array([0.3]))
    off = abs(Fraction(float(found.x[0])) - Fraction(level) / Fraction(1.5))
    radius = Fraction(float(found.radius[0]))
    assert radius / 2 < off <= radius < 1e-9
