"""The set {W <= c} of a lower bound of the cost, and the hole around the equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cost import CostInequality
from hfa_prove.check.cover import RefutedError
from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant


def pair(x: Any, u: Any, p: Any, w: Any) -> Any:
    fast = x.fast * x.slow - x.fast + u.push
    return {"fast": fast, "slow": 0.001 * (x.fast**2 - x.slow)}, {}


def inequality_of(
    W: Polynomial, M: np.ndarray, c: float, weights: tuple[float, float]
) -> CostInequality:
    """Return the cost inequality on {W <= c} for two states with different rates, with R = 1.

    M: (2, 2), y = M z
    weights: diagonal of Q
    """
    push = {"push": Signal("1", 1.0, -1.0, 1.0)}
    model = Model("pair", {"fast": Signal(), "slow": Signal()}, push, pair, trim={})
    plant = Plant(model, {}, {"fast": 0.0, "slow": 0.0}, {"push": 0.0}, {}, {"push": (-1.0, 1.0)})
    still = Equilibrium(np.zeros(3), np.zeros(3))
    return CostInequality(plant, still, Piece(M, W, c), np.diag(weights), np.eye(1))


def test_a_set_at_a_face_is_refuted() -> None:
    """A set {W <= c} that meets a face of the cube is refuted at a point of this face.

    W = 0.5 at the centers of the faces y_1 = ±1, and c = 0.6.
    """
    W = Polynomial(2, ((0.5, (2, 0)), (0.75, (0, 2))))
    inequality = inequality_of(W, np.eye(2), 0.6, (1.0, 1.0))
    with pytest.raises(RefutedError, match="beyond the boxes") as refuted:
        inequality.proved(1000)
    y = refuted.value.place
    assert np.abs(y).max() == 1.0
    assert W.at(y[None])[0] <= 0.6


def test_skewed_coordinates_leave_the_hole_large() -> None:
    """The hole around the equilibrium stays large for coordinates y = M z with large entries of M.

    The entries cancel in the scaled Hessian.
    """
    M = np.array([[1.0, 32.0], [0.0, 1.0]])
    # W = 0.25 fast² + 2 slow², with fast = y_1 - 32 y_2
    W = Polynomial(2, ((0.25, (2, 0)), (-16.0, (1, 1)), (258.0, (0, 2))))
    inequality = inequality_of(W, M, 1.0, (1.0, 0.0078125))
    assert inequality.hole <= 10
