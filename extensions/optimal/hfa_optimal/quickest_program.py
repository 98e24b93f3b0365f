"""Proposals of least time: collocation as in `collocation.py`, with an unknown final time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_flight.problem import FlightProblem
from hfa_optimal.collocation import (
    DEGREE,
    FEASIBLE,
    OPTIONS,
    Proposal,
    collocation_points,
    points_of_unknowns,
    solved_by,
    unknowns_in_order,
)
from hfa_optimal.smooth import smooth_rates

#: Weights of the inputs and of their steps, relative to their ranges, compared with the time. Of
#: several inputs with equal times, the smallest and smoothest are proposed.
_SMALL_INPUTS = 1e-4
_SMALL_STEPS = 3e-4
#: Shortest and longest time, relative to that of the guess.
_SHORTEST = 1e-3
_LONGEST = 20.0


@dataclass(frozen=True, eq=False)
class TimeProgram:
    """Nonlinear program of the least time to the trim, with a given number of intervals."""

    problem: FlightProblem
    intervals: int

    def solve(self, guess: Proposal, reserve: float) -> Proposal:
        """Return the proposal that IPOPT finds from a guess. Its `cost` is the duration, s.

        reserve: fraction of the distance from the trim to each limit that the proposal leaves to
            the policy
        """
        problem = self.problem
        of_states, of_inputs = problem.sizes
        count = self.intervals * DEGREE
        start = guess.start
        begin = problem.padded(start)
        bounds = []
        for of_z, of_v in zip(
            problem.inner_limits(begin, reserve), problem.input_limits, strict=True
        ):
            z = np.tile(of_z / of_states, (count, 1))
            z[-1, : len(start)] = 0.0
            v = np.tile((1.0 - reserve) * of_v / of_inputs, (self.intervals + 1, 1))
            bounds.append(unknowns_in_order(z, v))
        below, above = bounds
        row = unknowns_in_order(guess.z.reshape(count, -1) / of_states, guess.v / of_inputs)
        seconds = float(guess.lengths.sum())
        shares = guess.lengths / seconds
        solved = solved_by(
            self._solver,
            x0=np.append(np.clip(row, below, above), 1.0),
            p=np.concatenate([begin / of_states, seconds * shares]),
            lbx=np.append(below, _SHORTEST),
            ubx=np.append(above, _LONGEST),
        )
        values = np.array(solved["x"]).ravel()
        m = len(problem.inputs)
        inner = values[m:-1].reshape(self.intervals, -1)
        violation = np.abs(np.array(solved["g"])).max()
        time = float(values[-1]) * seconds
        return Proposal(
            lengths=time * shares,
            start=start,
            z=inner[:, :-m].reshape(self.intervals, DEGREE, -1) * of_states,
            v=np.vstack([values[:m], inner[:, -m:]]) * of_inputs,
            cost=time,
            tail=0.0,
            feasible=bool(np.isfinite(values).all() and violation <= FEASIBLE),
        )

    @cached_property
    def _solver(self) -> ca.Function:
        """IPOPT solver of the program.

        The last unknown is the duration of the proposal divided by that of the guess. The
        parameters are the initial state and the lengths of the guess's intervals.
        """
        problem = self.problem
        k, m, N = len(problem.followed), len(problem.inputs), self.intervals
        points = N * DEGREE
        chosen = points_of_unknowns(k, m, N)
        w = ca.MX.sym("w", chosen.columns())
        longer = ca.MX.sym("longer")
        p = ca.MX.sym("p", k + N)
        start, lengths = ca.vertsplit(p, [0, k, k + N])
        rows = ca.reshape(ca.mtimes(chosen, w), k + m, points)
        z, v = rows[:k, :], rows[k:, :]
        begins = ca.horzcat(start, z[:, DEGREE - 1 : points - 1 : DEGREE])
        derivatives, _, _ = ca.collocation_coeff(collocation_points()[1:].tolist())
        unit = ca.DM.eye(N)
        slopes = ca.mtimes(z, ca.kron(unit, derivatives[1:, :]))
        slopes += ca.mtimes(begins, ca.kron(unit, derivatives[0, :]))
        seconds = longer * ca.reshape(ca.repmat(lengths.T, DEGREE, 1), 1, points)
        g = ca.vec(slopes - ca.repmat(seconds, k, 1) * smooth_rates(problem).map(points)(rows))
        lowest, highest = problem.input_limits
        _, of_inputs = problem.sizes
        ranges = ca.DM(np.where(np.isfinite(highest - lowest), highest - lowest, of_inputs))
        parts = v * ca.repmat(ca.DM(of_inputs) / ranges, 1, points)
        steps = ca.diff(ca.horzcat(v[:, 0], v[:, DEGREE - 1 :: DEGREE]), 1, 1)
        steps = steps * ca.repmat(ca.DM(of_inputs) / ranges, 1, N)
        f = longer + _SMALL_INPUTS * ca.sumsqr(parts) / points + _SMALL_STEPS * ca.sumsqr(steps)
        program = {"x": ca.vertcat(w, longer), "p": p, "f": f, "g": g}
        return ca.nlpsol("quickest", "ipopt", program, OPTIONS)
