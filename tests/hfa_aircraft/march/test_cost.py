"""The cost of a flight as a further state of the simulation."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from hfa_aircraft.march.cost import Cost
from hfa_aircraft.march.steppers import rk4

# A stable linear loop v = -K z.
A = np.array([[0.0, 1.0], [-2.0, -0.3]])
B = np.array([[0.0], [1.0]])
K = np.array([[0.7, 0.4]])
COST = Cost(np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([[3.0]]))
LOOP = A - B @ K
START = np.array([1.0, -0.5])
SECONDS = 4.0


def exact_cost(cost: Cost) -> float:
    """Return the cost of the linear loop until `SECONDS`, by its Lyapunov equation."""
    crossed = np.zeros((2, 2)) if cost.N is None else cost.N @ K
    weight = cost.Q - crossed - crossed.T + K.T @ cost.R @ K
    X = solve_continuous_lyapunov(LOOP.T, -weight)
    end = expm(LOOP * SECONDS) @ START
    return float(START @ X @ START - end @ X @ end)


def integrated(cost: Cost, steps: int) -> float:
    """Return the cost of the linear loop until `SECONDS` as a further state of the simulation."""

    def rates(y: np.ndarray, _: float) -> np.ndarray:
        z = y[:, :2]
        v = -z @ K.T
        return np.column_stack([z @ A.T + v @ B.T, cost.rate(z, v)])

    y = np.append(START, 0.0)[None]
    for _ in range(steps):
        y = rk4(rates, y, SECONDS / steps)
    return float(y[0, 2])


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_the_running_cost_of_expressions_equals_that_of_arrays(kind: type[ca.SX]) -> None:
    """The expression of the running cost has the values of its rows."""
    z, v = kind.sym("z", 2), kind.sym("v", 1)
    of_expressions = ca.Function("rate", [z, v], [COST.rate(z, v)])
    rows = np.random.default_rng(0).normal(size=(5, 3))
    for row, value in zip(rows, COST.rate(rows[:, :2], rows[:, 2:]), strict=True):
        assert float(of_expressions(row[:2], row[2:])) == pytest.approx(value)


def test_cross_weights_have_their_exact_cost_and_expression() -> None:
    """The cost with N follows the Lyapunov equation of Q - N K - K'N' + K'R K."""
    crossed = Cost(COST.Q, COST.R, np.array([[0.4], [-0.2]]))
    assert integrated(crossed, 400) == pytest.approx(exact_cost(crossed), rel=1e-8)
    assert abs(exact_cost(crossed) / exact_cost(COST) - 1.0) > 0.01
    z, v = ca.SX.sym("z", 2), ca.SX.sym("v", 1)
    rate = ca.Function("rate", [z, v], [crossed.rate(z, v)])
    at = np.array([[0.3, -0.7]]), np.array([[1.2]])
    assert float(rate(at[0].T, at[1])) == pytest.approx(crossed.rate(*at)[0], rel=1e-12)
