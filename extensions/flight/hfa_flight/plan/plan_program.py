"""Quadratic program for the change of a plan, solved with HPIPM.

Source: Frison and Diehl, IFAC-PapersOnLine 53 (2020) 6563.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.native.bound import BoundFunction

#: Settings of HPIPM. The number of iterations bounds the time of a sample. A flight decides on the
#: inputs of a program.
_TOLERANCE = 3e-4
_OPTIONS: dict[str, Any] = {
    "mode": "speed_abs",
    "iter_max": 40,
    "mu0": 1e3,
    **dict.fromkeys(("res_g_max", "res_b_max", "res_d_max", "res_m_max"), _TOLERANCE),
}
#: Cost of the plan in the units of the program. The tolerances are small beside it.
_COST_IN_UNITS = 2500.0
#: Bound that stands for none.
_NO_BOUND = 1e8


#: HPIPM's status of a program that is solved to the tolerance, and largest number of memories of a
#: CasADi function that are searched for the one with this status.
_SOLVED = 0
_MEMORIES = 8


class Range(NamedTuple):
    """Least and largest values."""

    least: np.ndarray
    most: np.ndarray


class PlanCost(NamedTuple):
    """Cost of a plan with N holds and S soft limits, as a function of its changes.

    z: states at the nodes of the plan minus those of the target, (N + 1, n)
    v: inputs of the plan minus those of the target, (N, m)
    weights: W of each hold, (N, n + m, n + m); the cost of a hold is [z; v]' W [z; v]
    P: matrix of the cost at the end, (n, n)
    slack_slopes, slack_curvatures: a slack s >= 0 of a soft limit of a hold costs
        slope s + curvature s²/2, (N, S) each
    value: cost of the plan, which decides the units of the program
    """

    z: np.ndarray
    v: np.ndarray
    weights: np.ndarray
    P: np.ndarray
    slack_slopes: np.ndarray
    slack_curvatures: np.ndarray
    value: float


class AlongHolds(NamedTuple):
    """Values at the ends and at the middles of the holds, such as the derivatives of the states
    there by the states and inputs at the start of the hold, (N, ..., n + m).
    """

    ends: np.ndarray
    middles: np.ndarray


class Room(NamedTuple):
    """Least and largest changes within the limits.

    ends: of the states with soft limits at the end of each hold, (N, S)
    middles: of the fast ones at the middle of each hold, (N, F)
    inputs: (N, m)
    """

    ends: Range
    middles: Range
    inputs: Range


class ProgramSolution(NamedTuple):
    """Solution of a quadratic program.

    v, z: changes of the inputs (N, m) and states (N + 1, n)
    cost: change of the cost, with the whole penalty of slacks
    is_solved: whether HPIPM reached its tolerance
    """

    v: np.ndarray
    z: np.ndarray
    cost: float
    is_solved: bool


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
        self.fast = fast
        self._n, self._m = n, m
        H, A = _numbers_of_values(count, n, m, soft, fast)
        of_H, self._numbers_of_H = _sparse(H)
        of_A, self._numbers_of_A = _sparse(A)
        limits, slacks = len(soft) + len(fast), len(soft)
        # HPIPM's numbers of states, inputs and rows of limits at the begin of each hold and at the
        # end. Slacks are inputs for it.
        stages: dict[str, Any] = {
            "N": count,
            "nx": [n] * (count + 1),
            "nu": [m + slacks] * count + [0],
            "ng": [2 * limits] * count + [0],
        }
        options = {**stages, "inf": _NO_BOUND, "error_on_fail": False, "print_time": False}
        options["hpipm"] = _OPTIONS
        solve = ca.conic("plan", "hpipm", {"h": of_H, "a": of_A}, options)
        # Arguments of the compiled function: the nonzero entries of H and A, and the vectors.
        given = {
            name: ca.MX.sym(name, solve.sparsity_in(name).nnz())
            for name in ("h", "a", "g", "lba", "uba", "lbx", "ubx")
        }
        found = solve(**{**given, "h": ca.MX(of_H, given["h"]), "a": ca.MX(of_A, given["a"])})
        self._program = solve
        self._memory: int | None = None
        # HPIPM writes to the memory of all results, also of those that nobody uses.
        results = [found[name] for name in ("x", "cost", "lam_a", "lam_x")]
        self._solve = BoundFunction(ca.Function("change", list(given.values()), results))

    def step(self, cost: PlanCost, slopes: AlongHolds, room: Room) -> ProgramSolution:
        """Return the change that minimizes the cost within the room.

        The result may contain values that are not finite.

        slopes: derivatives of all states at the ends of the holds, (N, n, n + m), and of the fast
            ones at the middles, (N, F, n + m)
        """
        count, n, m = len(cost.v), self._n, self._m
        # Unit of the changes, in which the plan costs _COST_IN_UNITS.
        unit = np.sqrt(max(cost.value, np.finfo(float).tiny) / _COST_IN_UNITS)
        curvatures = cost.weights.ravel(), 0.5 * cost.slack_curvatures.ravel(), cost.P.ravel()
        # All values of H and A, in the order of their numbers (`_numbers_of_values`). HPIPM
        # minimizes x'H x / 2 + g'x, so that H is twice the matrix of the cost; that of a slack s,
        # which costs curvature s²/2, is half of the curvature. In A, 1 and -1 are the coefficients
        # of slacks and of the next states.
        H = 2.0 * np.concatenate(curvatures)
        A = np.concatenate([[1.0, -1.0], slopes.ends.ravel(), slopes.middles.ravel()])
        limits = *_limits_of_rows(room, n), *_limits_of_unknowns(room, n)
        in_units = (np.clip(limit / unit, -_NO_BOUND, _NO_BOUND) for limit in limits)
        unknowns, cost_change, *_ = self._solve.at(
            H[self._numbers_of_H], A[self._numbers_of_A], _gradient(cost) / unit, *in_units
        )
        unknowns *= unit
        # Of each hold the states, inputs and slacks, then the states at the end.
        of_holds = unknowns[:-n].reshape(count, -1)
        v, z = of_holds[:, n : n + m], np.vstack([of_holds[:, :n], unknowns[-n:]])
        is_solved = self._status() in (_SOLVED, None)  # None if CasADi does not tell
        return ProgramSolution(v, z, float(cost_change[0]) * unit**2, is_solved)

    def _status(self) -> int | None:
        """Return HPIPM's status of the last program, None if CasADi does not tell."""
        # CasADi solves in one of several memories; the others have no status.
        memories = range(_MEMORIES) if self._memory is None else [self._memory]
        for memory in memories:
            try:
                status = self._program.stats(memory)["return_status"]
            except (RuntimeError, KeyError):
                continue
            self._memory = memory
            return int(status)
        return None


def _numbers_of_values(
    count: int, n: int, m: int, soft: np.ndarray, fast: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return H and A of a program, with the number of a value in place of each entry."""
    # A program fills its values in by one indexing with these numbers, instead of building H and A
    # anew. Numbers begin with 1; 0 is no entry. The values of H are W of each hold, the curvatures
    # of the slacks, and P; those of A are 1, -1, and the derivatives of the states at the ends and
    # at the middles of the holds.
    both, slacks, middles = n + m, len(soft), len(fast)
    unknowns, rows_of_hold = both + slacks, n + 2 * (slacks + middles)
    H = np.zeros((count * unknowns + n, count * unknowns + n), dtype=int)
    A = np.zeros((count * rows_of_hold, len(H)), dtype=int)
    sizes = np.array([count * both**2, count * slacks, n * n])
    W, curvatures, P = np.split(np.arange(1, sizes.sum() + 1), np.cumsum(sizes)[:-1])
    W, curvatures = W.reshape(count, both, both), curvatures.reshape(count, slacks)
    number_of_1, number_of_minus_1 = 1, 2
    ends = 3 + np.arange(count * n * both).reshape(count, n, both)
    at_middles = 1 + ends.max() + np.arange(count * middles * both).reshape(count, middles, both)
    for k in range(count):
        first, row = k * unknowns, k * rows_of_hold
        states_and_inputs, slack = first + np.arange(both), first + both + np.arange(slacks)
        H[np.ix_(states_and_inputs, states_and_inputs)] = W[k]
        H[slack, slack] = curvatures[k]
        # Rows of the n equations: the states after the hold are those of the next hold.
        A[row : row + n, states_and_inputs] = ends[k]
        A[row + np.arange(n), first + unknowns + np.arange(n)] = number_of_minus_1
        row += n
        # Rows of the limits at the end, then at the middle: x - slack of the upper sides, then
        # x + slack of the lower sides (`_limits_of_rows`).
        for limited, beyond in ((ends[k, soft], slack), (at_middles[k], slack[fast])):
            for sign in (number_of_minus_1, number_of_1):
                rows = row + np.arange(len(beyond))
                A[rows[:, None], states_and_inputs], A[rows, beyond] = limited, sign
                row += len(beyond)
    H[-n:, -n:] = P.reshape(n, n)
    return H, A


def _gradient(cost: PlanCost) -> np.ndarray:
    """Return the derivatives of the cost by the unknowns, at no change and no slack."""
    z_and_v = np.hstack([cost.z[:-1], cost.v])
    of_holds = 2.0 * np.einsum("kij,kj->ki", cost.weights, z_and_v)
    return np.append(np.hstack([of_holds, cost.slack_slopes]).ravel(), 2.0 * cost.P @ cost.z[-1])


def _limits_of_rows(room: Room, n: int) -> Range:
    """Return the limits of the rows of A, in the order of the rows of `_numbers_of_values`."""
    # Equations are 0. At the end and at the middle, x - slack <= highest and x + slack >= lowest.
    (lowest, highest), (lowest_middle, highest_middle) = room.ends, room.middles
    equations = np.zeros((len(lowest), n))
    free, free_middle = np.full(lowest.shape, np.inf), np.full(lowest_middle.shape, np.inf)
    least = np.hstack([equations, -free, lowest, -free_middle, lowest_middle])
    most = np.hstack([equations, highest, free, highest_middle, free_middle])
    return Range(least.ravel(), most.ravel())


def _limits_of_unknowns(room: Room, n: int) -> Range:
    """Return the limits of the unknowns: the first states stay, and slacks are at least 0."""
    inputs, slacks = room.inputs, room.ends.least.shape
    states = np.full((len(inputs.least), n), np.inf)
    states[0] = 0.0
    at_end = np.full(n, np.inf)
    least = np.hstack([-states, inputs.least, np.zeros(slacks)]).ravel()
    most = np.hstack([states, inputs.most, np.full(slacks, np.inf)]).ravel()
    return Range(np.append(least, -at_end), np.append(most, at_end))


def _sparse(numbers: np.ndarray) -> tuple[ca.Sparsity, np.ndarray]:
    """Return the sparsity of a matrix of numbers of values, and their indices by columns.

    The value with the number 1 has the index 0. CasADi stores the entries column by column.
    """
    height, width = numbers.shape
    columns, rows = np.nonzero(np.ascontiguousarray(numbers.T))
    sparsity = ca.Sparsity.triplet(height, width, rows.tolist(), columns.tolist())
    return sparsity, numbers[rows, columns] - 1
