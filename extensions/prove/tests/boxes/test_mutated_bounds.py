"""Randomly changed certificates of a lower bound. No false bound is accepted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mutations import accepted_claims

from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import SCHEMA
from hfa_prove.check.cost import check_cost
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant, Subject

COUNT = 1000
ONE = np.eye(1)


def cart(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"position": u.speed}, {}


CART = Model("cart", {"position": Signal("m")}, {"speed": Signal("m/s")}, cart, trim={})


def content() -> dict[str, Any]:
    """Return a true certificate with two pieces for x' = u with Q = R = 1.

    The least cost is x².
    """
    plant = Plant(CART, {}, {"position": 0.0}, {"speed": 0.0}, {}, {})
    pieces = (
        Piece(ONE, Polynomial(1, ((1.0 - 1e-13, (2,)),)), 0.5),
        Piece(2.0 * ONE, Polynomial(1, ((0.125, (2,)), (0.0625, (4,)))), 0.125),
    )
    statement = CostStatement(plant, {"position": 0.0, "speed": 0.0}, ONE, ONE, pieces)
    return {
        **{"schema": SCHEMA, "toolchain": "", "digest": "", "provenance": {}, "checksum": ""},
        "kind": "cost",
        "statement": statement.content(),
        "witness": {"solved": ["speed"], "boxes": [2000, 2000]},
    }


def is_true(statement: CostStatement) -> bool:
    """Return whether the bound of a statement is at most the least cost sqrt(Q R) z² on a fine
    grid.

    z is the deviation from the stated equilibrium, which may differ from the trim by 1e-6.
    """
    z = np.linspace(-3.0, 3.0, 20_001)[:, None]
    least = np.sqrt(statement.Q[0, 0] * statement.R[0, 0]) * z[:, 0] ** 2
    bound = np.max([piece.bound(z) for piece in statement.pieces], axis=0)
    return bool(np.all(bound <= least * (1.0 + 1e-15)))


@pytest.mark.slow
def test_no_false_bound_of_1000_is_accepted() -> None:
    """Every changed certificate that is accepted states a bound of at most the least cost.

    Less than a third of the changed certificates are accepted.
    """
    accepted = accepted_claims(content(), Subject(CART), check_cost, is_true, COUNT)
    assert accepted < COUNT / 3
