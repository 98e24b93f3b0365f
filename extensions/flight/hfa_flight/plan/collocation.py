"""Candidates of flights: Radau collocation, solved with IPOPT.

A candidate proves nothing until it is simulated.

Source: Betts, Practical Methods for Optimal Control, Chapter 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.plan.problem import MARGIN, FlightProblem
from hfa_flight.plan.smooth import smooth_rates

#: Collocation points per interval. With 3, solutions for the HFA take half as long again, and two
#: meshes differ as much, because the inputs are linear in each interval.
DEGREE = 2
#: Largest ratio of the lengths of the last and the first interval.
_LONGEST_GROWTH = 60.0
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.max_iter": 300,
    # Each option saves a tenth of the time. The equations are scaled already, and a slightly
    # inexact step is cheaper than the computation of its residual.
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.fast_step_computation": "yes",
}
#: Number of intervals from which IPOPT needs a third fewer iterations with an adaptive barrier.
_ADAPTIVE_FROM = 100
#: Least roughness of an interval in an adapted mesh, relative to the largest.
_LEAST_ROUGHNESS = 1e-3
#: Weight of jumps of the inputs' slopes, and power of the roughness that determines the intervals.
#: Of the values that were tried, these halve the difference between meshes of 25 and 50 intervals
#: for the HFA.
_WEIGHT_OF_JUMPS = 3.0
_POWER_OF_ROUGHNESS = 0.5
#: Largest violation of the collocation equations of a feasible candidate, in nominal values.
FEASIBLE = 1e-6


class CandidateFlight(NamedTuple):
    """Flight proposed by collocation, to be confirmed by simulation.

    lengths: lengths of the intervals, s, (N,)
    start: initial deviations z, (k,)
    z: deviations of the followed states at the collocation points, (N, DEGREE, followed)
    v: deviations of the inputs at the ends of the intervals, linear between them, (N + 1, m)
    cost: cost by quadrature at the collocation points, plus the tail
    tail: linear cost after the last interval
    feasible: whether all unknowns are finite and satisfy the collocation equations
    """

    lengths: np.ndarray
    start: np.ndarray
    z: np.ndarray
    v: np.ndarray
    cost: float
    tail: float
    feasible: bool

    @property
    def ends(self) -> np.ndarray:
        """Boundaries of the intervals, s, (N + 1,). The first is 0."""
        return np.append(0.0, np.cumsum(self.lengths))

    @property
    def nodes(self) -> np.ndarray:
        """Deviations of the followed states, (N, 1 + DEGREE, followed).

        The nodes of an interval are its start and its collocation points.
        """
        # The followed states that are not in z(0), such as the altitude, begin at the trim.
        start = np.pad(self.start, (0, self.z.shape[-1] - len(self.start)))
        before = np.vstack([start[None], self.z[:-1, -1]])
        return np.concatenate([before[:, None], self.z], axis=1)

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return deviations of the followed states, (T, followed), and of the inputs, (T, m), at
        given times.

        All deviations are 0 after the end of the candidate.

        times: s, (T,)
        """
        ends = self.ends
        last = len(self.lengths) - 1
        interval = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, last)
        tau = (times - ends[interval]) / self.lengths[interval]
        z = np.einsum("ij,ijk->ik", _lagrange(collocation_points(), tau), self.nodes[interval])
        v = self.v[interval] + tau[:, None] * (self.v[interval + 1] - self.v[interval])
        late = times > ends[-1] * (1.0 + 1e-12)
        z[late] = 0.0
        v[late] = 0.0
        return z, v


def collocation_points() -> np.ndarray:
    """Return 0 and the collocation points of an interval of length 1, (1 + DEGREE,)."""
    return np.array([0.0, *ca.collocation_points(DEGREE, "radau")])


def _lagrange(points: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the values of the p Lagrange polynomials at tau, (N, p)."""
    columns = []
    for index, point in enumerate(points):
        others = np.delete(points, index)
        columns.append(np.prod((tau[:, None] - others) / (point - others), axis=1))
    return np.column_stack(columns)


def mesh(seconds: float, intervals: int, fastest: float, step: float) -> np.ndarray:
    """Return the lengths of N intervals that grow geometrically, s, (N,). Their sum is `seconds`.

    The ratio of the last to the first length is clip(`seconds` `fastest` / N, 4,
    `_LONGEST_GROWTH`), before the lengths are rounded to steps.

    intervals: number N of intervals
    fastest: frequency of the fastest mode of the linear loop, 1/s
    step: simulation step, s
    """
    equal = seconds / intervals
    growth = np.clip(equal * fastest, 4.0, _LONGEST_GROWTH)
    lengths = growth ** np.linspace(0.0, 1.0, intervals)
    return _on_steps(np.append(0.0, np.cumsum(lengths)) * seconds / lengths.sum(), step)


def _on_steps(ends: np.ndarray, step: float) -> np.ndarray:
    """Return the lengths of intervals, rounded to multiples of the simulation step, s, (N,)."""
    end_steps = np.round(ends / step).astype(int)
    number = np.arange(len(end_steps))
    # At least one step after the boundary before, and early enough for those that follow.
    end_steps = np.maximum.accumulate(end_steps - number) + number
    latest = round(ends[-1] / step) - number[::-1]
    return step * np.diff(np.minimum(end_steps, latest)).astype(float)


def adapted_mesh(
    candidate: CandidateFlight, intervals: int, step: float, weights: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return the lengths of intervals on which a candidate is about equally smooth, s, (N,).

    The roughness of an interval is measured by the leading coefficients of the polynomials for the
    states and by jumps of the inputs' slopes at its ends; it is the largest of the interval and its
    neighbours. Each interval of the candidate gets a share of the new ones, a power of its
    roughness.

    intervals: number N of new intervals
    step: simulation step, s
    weights: weights of the states in this measure, (k,), and of the inputs, (m,)
    """
    of_states, of_inputs = weights
    # The leading coefficient of a state's polynomial in an interval, over an interval of length 1.
    leading = np.einsum("j,ijk->ik", _leading(collocation_points()), candidate.nodes)
    curvature = np.abs(leading[:, : len(of_states)] * of_states).sum(axis=1)
    slopes = np.diff(candidate.v, axis=0) / candidate.lengths[:, None]
    jumps = _WEIGHT_OF_JUMPS * np.abs(np.diff(slopes, axis=0) * of_inputs).sum(axis=1)
    jumps_at_ends = np.maximum(np.append(jumps, 0.0), np.append(0.0, jumps))
    roughness = curvature + jumps_at_ends * candidate.lengths
    before, after = np.append(0.0, roughness[:-1]), np.append(roughness[1:], 0.0)
    largest = np.maximum.reduce([roughness, after, before])
    shares = (largest + _LEAST_ROUGHNESS * largest.max()) ** _POWER_OF_ROUGHNESS
    shares_until = np.append(0.0, np.cumsum(shares))
    wanted = np.linspace(0.0, shares_until[-1], intervals + 1)
    return _on_steps(np.interp(wanted, shares_until, candidate.ends), step)


def _leading(points: np.ndarray) -> np.ndarray:
    """Return the factors on values at p points that add up to the leading coefficient."""
    return np.array([1.0 / np.prod(point - points[points != point]) for point in points])


def unknowns_in_order(z: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the unknowns of the nonlinear program as a vector.

    The order is v at the start, then for each interval z at the collocation points and v at the
    end.

    z: (N DEGREE, k)
    v: (N + 1, m)
    """
    inner = np.hstack([z.reshape(len(v) - 1, -1), v[1:]])
    return np.concatenate([v[0], inner.ravel()])


def points_of_unknowns(k: int, m: int, intervals: int) -> ca.DM:
    """Return the matrix that maps the unknowns of the program to (z, v) at all collocation points.

    z and v are the deviations of the states and of the inputs.

    k: number of states
    m: number of inputs
    intervals: number of intervals
    """
    # Places of the unknowns, in the order of `unknowns_in_order`.
    unknowns = np.arange(m + intervals * (DEGREE * k + m))
    of_intervals = unknowns[m:].reshape(intervals, DEGREE * k + m)
    states, inputs = np.split(of_intervals, [DEGREE * k], axis=1)
    at_ends = np.vstack([unknowns[:m], inputs])
    before = np.repeat(at_ends[:-1], DEGREE, axis=0)
    after = np.repeat(at_ends[1:], DEGREE, axis=0)
    # Inputs are linear in an interval: v = (1 - tau) v_before + tau v_after.
    tau = np.tile(collocation_points()[1:], intervals)[:, None] * np.ones(m)
    # Rows of the result: (z, v) of each point in turn.
    points = np.arange(intervals * DEGREE * (k + m)).reshape(-1, k + m)
    of_z, of_v = np.split(points, [k], axis=1)
    rows = np.concatenate([of_z.ravel(), of_v.ravel(), of_v.ravel()])
    columns = np.concatenate([states.ravel(), before.ravel(), after.ravel()])
    values = np.concatenate([np.ones(states.size), (1.0 - tau).ravel(), tau.ravel()])
    size = points.size, unknowns.size
    return ca.DM.triplet(rows.tolist(), columns.tolist(), ca.DM(values), *size)


def solved_by(solver: ca.Function, **arguments: np.ndarray) -> dict[str, ca.DM]:
    """Return the solution found by IPOPT, with all constraints equal to 0.

    Raises KeyboardInterrupt if the user interrupts IPOPT. CasADi itself reports an interruption as
    another error, or only in the status of IPOPT.
    """
    try:
        solved: dict[str, ca.DM] = solver(lbg=0.0, ubg=0.0, **arguments)
    except (RuntimeError, SystemError) as error:
        if "KeyboardInterrupt" in str(error):
            raise KeyboardInterrupt from error
        raise
    if solver.stats()["return_status"] == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    return solved


@dataclass(frozen=True, eq=False)
class Transcription:
    """Nonlinear program of a problem with a given number of intervals.

    The unknowns are the states and inputs. The objective is the quadrature of z'Qz + v'Rv, plus
    z'Pz at the end.

    intervals: number N of intervals
    """

    problem: FlightProblem
    intervals: int

    def solve(
        self,
        start: np.ndarray,
        lengths: np.ndarray,
        z: np.ndarray,
        v: np.ndarray,
        margin: float = MARGIN,
    ) -> CandidateFlight:
        """Return the candidate that IPOPT finds from a guess. The candidate may be infeasible.

        start: initial deviations z, (k,)
        lengths: lengths of the intervals of the guess, s, (N,)
        z: guess at the collocation points, (N DEGREE, k) or (N DEGREE, followed)
        v: guess at the ends of the intervals, (N + 1, m)
        margin: fraction by which the limits of the states are narrowed, as in `inner_limits`
        """
        problem = self.problem
        of_states, of_inputs = problem.nominal
        z = problem.padded(z)
        begin = problem.padded(start)
        below, above = self._bounds(begin, margin)
        guess = unknowns_in_order(z / of_states, v / of_inputs)
        linear_cost = float(start @ problem.P @ start)
        scale = 1.0 / (linear_cost or 1.0)  # without a cost, any scale is right
        parameters = np.concatenate([begin / of_states, lengths, [scale]])
        solved = solved_by(
            self._solver,
            x0=np.clip(guess, below, above),
            p=parameters,
            lbx=below,
            ubx=above,
        )
        unknowns = np.array(solved["x"]).ravel()
        m = len(problem.inputs)
        inner = unknowns[m:].reshape(self.intervals, -1)
        z = inner[:, :-m].reshape(self.intervals, DEGREE, -1) * of_states
        violation = np.abs(np.array(solved["g"])).max()
        end = z[-1, -1, : len(start)]
        return CandidateFlight(
            lengths=lengths,
            start=start,
            z=z,
            v=np.vstack([unknowns[:m], inner[:, -m:]]) * of_inputs,
            cost=float(solved["f"]) / scale,
            tail=float(end @ problem.P @ end),
            feasible=bool(np.isfinite(unknowns).all() and violation <= FEASIBLE),
        )

    def _bounds(self, begin: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds of the unknowns: the same limits at all points."""
        problem = self.problem
        of_states, of_inputs = problem.nominal
        sides = zip(problem.inner_limits(begin, margin), problem.input_limits, strict=True)
        below, above = (
            unknowns_in_order(
                np.tile(limit_z / of_states, (self.intervals * DEGREE, 1)),
                np.tile(limit_v / of_inputs, (self.intervals + 1, 1)),
            )
            for limit_z, limit_v in sides
        )
        return below, above

    @cached_property
    def _solver(self) -> ca.Function:
        """IPOPT solver of the nonlinear program."""
        # The equations at collocation point i are s_i - h_i f(r_i) = 0, with states and inputs r_i,
        # slopes s_i of the polynomial of the states, and length h_i of the interval. The scale of
        # the objective is that of `solve`, 1 over the linear cost.
        problem, intervals = self.problem, self.intervals
        k, m = len(problem.followed), len(problem.inputs)
        points = intervals * DEGREE
        chosen = points_of_unknowns(k, m, intervals)
        x = ca.MX.sym("x", chosen.columns())
        start, lengths, scale = (ca.MX.sym("p", size) for size in (k, intervals, 1))
        r = ca.reshape(ca.mtimes(chosen, x), k + m, points)
        h = ca.reshape(ca.repmat(lengths.T, DEGREE, 1), 1, points)
        rates = smooth_rates(problem).map(points)(r)
        equations = self._slopes(r[:k, :], start) - ca.repmat(h, k, 1) * rates
        Q, R, P = problem.scaled_weights()
        _, _, quadrature = ca.collocation_coeff(collocation_points()[1:].tolist())
        shares = h * ca.repmat(ca.DM(quadrature).T, 1, intervals)
        weight = ca.diagcat(ca.DM(Q), ca.DM(R))
        running = ca.dot(ca.repmat(shares, k + m, 1) * r, ca.mtimes(weight, r))
        cost = running + ca.bilin(ca.DM(P), r[:k, -1], r[:k, -1])
        parts = {
            "x": x,
            "p": ca.vertcat(start, lengths, scale),
            "f": scale * cost,
            "g": ca.vec(equations),
        }
        strategy = "adaptive" if intervals >= _ADAPTIVE_FROM else "monotone"
        return ca.nlpsol("flight", "ipopt", parts, {**OPTIONS, "ipopt.mu_strategy": strategy})

    def _slopes(self, z: ca.MX, start: ca.MX) -> ca.MX:
        """Return the slopes of the states' polynomials at the points, per length of an interval.

        z: states at the collocation points, (k, N DEGREE)
        """
        ends = z[:, DEGREE - 1 : self.intervals * DEGREE - 1 : DEGREE]
        # Row 0 has the derivatives by the state at the begin of an interval, the others those by
        # the states at its collocation points.
        derivatives, _, _ = ca.collocation_coeff(collocation_points()[1:].tolist())
        unit = ca.DM.eye(self.intervals)
        of_points = ca.mtimes(z, ca.kron(unit, derivatives[1:, :]))
        begins = ca.horzcat(start, ends)
        return of_points + ca.mtimes(begins, ca.kron(unit, derivatives[0, :]))
