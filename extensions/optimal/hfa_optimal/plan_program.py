"""Quadratic program for the change of a plan, solved with PIQP."""

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
_ARGUMENTS = "p", "lbg", "ubg", "lbx", "ubx"


class PlanProgram:
    """Quadratic model of a plan's cost about the plan, with the equations linearized along it.

    The unknowns of a hold are the changes of the states and inputs at its start, and the slacks of
    the soft limits at its end. The last unknowns are the changes of the states at the end.

    count: number N of holds
    n, m: numbers of states and inputs
    soft: indices of the states with soft limits, (S,)
    fast: indices in `soft` of the states whose limits hold at the middle of a hold too, (F,)
    """

    def __init__(self, count: int, n: int, m: int, soft: np.ndarray, fast: np.ndarray) -> None:
        both, slacks = ca.SX.sym("both", n + m, count), ca.SX.sym("slacks", len(soft), count)
        end = ca.SX.sym("end", n)
        sizes = [n + m, (n + m) ** 2, n * (n + m), len(fast) * (n + m), len(soft), len(soft)]
        given = [ca.SX.sym("given", size, count) for size in sizes]
        P, end_about = ca.SX.sym("P", n, n), ca.SX.sym("end_about", n)
        cost = ca.bilin(P, end, end + 2.0 * end_about)
        rows = []
        for k in range(count):
            about, W, slopes, middle, price, curvature = (each[:, k] for each in given)
            change, slack = both[:, k], slacks[:, k]
            cost += ca.bilin(ca.reshape(W, n + m, n + m), change, change + 2.0 * about)
            cost += ca.dot(price, slack) + 0.5 * ca.dot(curvature, slack**2)
            after = both[:n, k + 1] if k + 1 < count else end
            moved = ca.reshape(slopes, n + m, n).T @ change
            between = ca.reshape(middle, n + m, len(fast)).T @ change
            limited = after[soft.tolist()], between
            exceeding = slack, slack[fast.tolist()]
            rows += [moved - after]
            for value, beyond in zip(limited, exceeding, strict=True):
                rows += [ca.vec(value) - ca.vec(beyond), ca.vec(value) + ca.vec(beyond)]
        program = {
            "x": ca.vertcat(ca.vec(ca.vertcat(both, slacks)), end),
            "f": cost,
            "g": ca.vertcat(*rows),
            "p": ca.vertcat(ca.vec(ca.vertcat(*given)), ca.vec(P), end_about),
        }
        solved = ca.qpsol("plan", "piqp", program, _OPTIONS)
        arguments = [ca.MX.sym(name, solved.size_in(name)) for name in _ARGUMENTS]
        found = solved(**dict(zip(_ARGUMENTS, arguments, strict=True)))
        self._solve = BoundFunction(ca.Function("change", arguments, [found["x"], found["f"]]))
        self._n, self._m, self.fast = n, m, fast

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
        count, n, m = len(v), self._n, self._m
        of_holds = np.hstack(
            [z[:-1], v, *(each.reshape(count, -1) for each in (weights, slopes, middle_slopes)),
             *prices]
        )  # fmt: skip
        given = np.concatenate([of_holds.ravel(), P.ravel(), z[-1]])
        none, free = np.zeros((count, n)), np.full(room[0].shape, np.inf)
        unmoved = np.full(middle[0].shape, np.inf)
        least = np.hstack([none, -free, room[0], -unmoved, middle[0]]).ravel()
        most = np.hstack([none, room[1], free, middle[1], unmoved]).ravel()
        anywhere = np.full((count, n), np.inf)
        anywhere[0] = 0.0  # the states now
        last = np.full(n, np.inf)
        lowest = np.append(np.hstack([-anywhere, inputs[0], np.zeros(free.shape)]).ravel(), -last)
        highest = np.append(np.hstack([anywhere, inputs[1], free]).ravel(), last)
        changes, cost = self._solve.at(given, least, most, lowest, highest)
        of_holds = changes[:-n].reshape(count, -1)
        moved = np.vstack([of_holds[:, :n], changes[-n:]])
        return of_holds[:, n : n + m], moved, float(cost[0])
