"""Quadratic program for the change of a plan, solved with PIQP.

The unknowns of hold i are the changes of the states and inputs at its start, and the slacks of the
soft limits at its end. The last unknowns are the changes of the states at the end.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hfa_support.native.bound import BoundFunction

#: The number of iterations bounds the time of a sample. Ten to twenty solve a program. A flight
#: decides on its inputs.
_OPTIONS: dict[str, Any] = {
    "error_on_fail": False,
    "print_time": False,
    "piqp": {"max_iter": 60, "eps_rel": 1e-5, "eps_duality_gap_rel": 1e-5},
}


class PlanProgram:
    """Quadratic model of a plan's cost about the plan, with the equations linearized along it.

    count: number N of holds
    n, m: numbers of states and inputs
    soft: indices of the states with soft limits, (S,)
    fast: indices in `soft` of the states whose limits hold at the middle of a hold too, (F,)
    """

    def __init__(self, count: int, n: int, m: int, soft: np.ndarray, fast: np.ndarray) -> None:
        slacks = len(soft)
        size = n + m
        width = size + slacks
        height = n + 2 * (slacks + len(fast))
        # unknowns and rows of each hold
        unknowns = width * np.arange(count)[:, None]
        rows = height * np.arange(count)[:, None]
        self._z = unknowns + np.arange(n)
        self._v = unknowns + n + np.arange(m)
        self._slacks = unknowns + size + np.arange(slacks)
        self._end = width * count + np.arange(n)
        self._moves = rows + np.arange(n)
        self._above = rows + n + np.arange(slacks)
        self._below = rows + n + slacks + np.arange(slacks)
        self._middle_above = rows + n + 2 * slacks + np.arange(len(fast))
        self._middle_below = rows + n + 2 * slacks + len(fast) + np.arange(len(fast))
        self._soft, self._fast = soft, fast
        self._shape = height * count, width * count + n
        self._prepare()

    def _prepare(self) -> None:
        """Store the patterns and the constant entries of the matrices, and make the solver."""
        following = np.vstack([self._z[1:], self._end])
        values = np.zeros(self._shape)
        used = np.zeros(self._shape, dtype=bool)
        both = np.hstack([self._z, self._v])
        used[self._moves[:, :, None], both[:, None, :]] = True
        values[self._moves, following] = -1.0
        for rows, sign in ((self._above, -1.0), (self._below, 1.0)):
            values[rows, following[:, self._soft]] = 1.0
            values[rows, self._slacks] = sign
        for rows, sign in ((self._middle_above, -1.0), (self._middle_below, 1.0)):
            used[rows[:, :, None], both[:, None, :]] = True
            values[rows, self._slacks[:, self._fast]] = sign
        used |= values != 0.0
        curved = np.zeros((self._shape[1],) * 2, dtype=bool)
        curved[both[:, :, None], both[:, None, :]] = True
        curved[self._slacks, self._slacks] = True
        curved[self._end[:, None], self._end[None]] = True
        matrix, places, self._entries = _sparse(used, values)
        self._slopes_at = places[self._moves[:, :, None], both[:, None, :]]
        middle = np.stack([self._middle_above, self._middle_below])
        self._middle_at = places[middle[:, :, :, None], both[None, :, None, :]]
        curvature, places, self._curvature = _sparse(curved, np.zeros(curved.shape))
        self._weights_at = places[both[:, :, None], both[:, None, :]]
        self._slacks_at = places[self._slacks, self._slacks]
        self._end_at = places[self._end[:, None], self._end[None]]
        self._solve = BoundFunction(_of_entries(curvature, matrix))

    def step(
        self,
        z: np.ndarray,
        v: np.ndarray,
        weights: np.ndarray,
        P: np.ndarray,
        prices: tuple[np.ndarray, np.ndarray],
        slopes: np.ndarray,
        middle_slopes: np.ndarray,
        room: tuple[np.ndarray, np.ndarray],
        middle: tuple[np.ndarray, np.ndarray],
        inputs: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the changes of the inputs (N, m) and states (N + 1, n) that minimize the model,
        and the change of the cost, with the whole price of slacks.

        The result may contain values that are not finite.

        z: states at the nodes of the plan minus those of the target, (N + 1, n)
        v: inputs of the plan minus those of the target, (N, m)
        weights: W of each hold, (N, n + m, n + m); the cost of a hold is [z; v]' W [z; v]
        P: matrix of the cost at the end, (n, n)
        prices: slope and curvature of the cost of a slack s >= 0 of each soft limit of each hold,
            (N, S) each; a slack costs slope s + curvature s²/2
        slopes: derivatives of the states after each hold by those before it and by the inputs,
            (N, n, n + m)
        middle_slopes: derivatives of the fast states at the middle of each hold, (N, F, n + m)
        room: least and largest changes within the soft limits at the end of each hold, (N, S)
        middle: those at the middle of each hold, (N, F)
        inputs: least and largest changes of the inputs, (N, m)
        """
        n = self._z.shape[1]
        self._entries[self._slopes_at] = slopes
        self._entries[self._middle_at] = middle_slopes
        self._curvature[self._weights_at] = 2.0 * weights
        self._curvature[self._slacks_at] = prices[1]
        self._curvature[self._end_at] = 2.0 * P
        gradient = np.zeros(self._shape[1])
        pull = 2.0 * np.einsum("kij,kj->ki", weights, np.hstack([z[:-1], v]))
        gradient[self._z], gradient[self._v] = pull[:, :n], pull[:, n:]
        gradient[self._slacks] = prices[0]
        gradient[self._end] = 2.0 * P @ z[-1]
        least, most = np.zeros(self._shape[0]), np.zeros(self._shape[0])
        least[self._above], most[self._above] = -np.inf, room[1]
        least[self._below], most[self._below] = room[0], np.inf
        least[self._middle_above], most[self._middle_above] = -np.inf, middle[1]
        least[self._middle_below], most[self._middle_below] = middle[0], np.inf
        lowest = np.full(self._shape[1], -np.inf)
        highest = np.full(self._shape[1], np.inf)
        lowest[self._z[0]] = highest[self._z[0]] = 0.0
        lowest[self._v], highest[self._v] = inputs
        lowest[self._slacks] = 0.0
        changes, cost = self._solve.at(
            self._curvature, self._entries, gradient, least, most, lowest, highest
        )
        return changes[self._v], np.vstack([changes[self._z], changes[self._end]]), float(cost[0])


def _of_entries(curvature: ca.Sparsity, matrix: ca.Sparsity) -> ca.Function:
    """Return the solver as a function of the entries of the Hessian and of the constraints, and of
    dense columns.
    """
    height, width = matrix.shape
    sizes = {
        "h": curvature.nnz(), "a": matrix.nnz(), "g": width,
        "lba": height, "uba": height, "lbx": width, "ubx": width,
    }  # fmt: skip
    given = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    arguments = {**given, "h": ca.MX(curvature, given["h"]), "a": ca.MX(matrix, given["a"])}
    solved = ca.conic("plan", "piqp", {"h": curvature, "a": matrix}, _OPTIONS)(**arguments)
    return ca.Function("changes", list(given.values()), [solved["x"], solved["cost"]])


def _sparse(used: np.ndarray, values: np.ndarray) -> tuple[ca.Sparsity, np.ndarray, np.ndarray]:
    """Return a pattern, the place of each entry in its list of values or -1, and these values."""
    height, width = used.shape
    columns, rows = np.nonzero(used.T)
    pattern = ca.Sparsity.triplet(height, width, rows.tolist(), columns.tolist())
    places = np.full(used.shape, -1)
    places[rows, columns] = np.arange(len(rows))
    return pattern, places, values[rows, columns]
