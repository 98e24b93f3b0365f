"""Policy that follows a proposed flight, with feedback."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import saturated
from hfa_flight.air.delay import steps_of
from hfa_flight.plan.collocation import Proposal
from hfa_flight.plan.problem import FlightProblem
from hfa_flight.plan.smooth import smooth_slopes
from hfa_flight.policies.policy import Measurements, Policy

#: Largest growth exponent of the linear costate equations in one step of the Riccati recursion.
_STEP = 6.0
#: Integration steps in a tick. z* and v* are given at the ends of each step.
STEPS = 8


@dataclass(frozen=True, eq=False, repr=False)
class TrackingPolicy(Policy):
    """Policy v = v*(t) - K(t) (z - z*(t)), saturated at the input limits.

    z* and v* are the proposal, interpolated linearly in each integration step.

    held: one row per tick, as `tracking_rows` returns them: begin of the tick, s, then (z*, v*) at
        the ends of its integration steps, then the columns of K
    tick: duration of a tick, s
    moved: indices of the inputs in v
    count: number of all inputs
    lowest, highest: limits of v, (m,)
    """

    tick: float
    moved: list[int]
    count: int
    lowest: np.ndarray
    highest: np.ndarray

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the deviations of all inputs as an expression. Inputs that do not move are 0."""
        k = measurements.error.numel()
        m = len(self.moved)
        size = (STEPS + 1) * (k + m)
        begin, proposed, K = ca.vertsplit(held, [0, 1, 1 + size, 1 + size + m * k])
        step = STEPS * (t - begin) / self.tick
        weights = [ca.fmax(0.0, 1.0 - ca.fabs(step - knot)) for knot in range(STEPS + 1)]
        interpolated = ca.mtimes(ca.reshape(proposed, k + m, STEPS + 1), ca.vertcat(*weights))
        z_proposed, v_proposed = interpolated[:k], interpolated[k:]
        v = v_proposed - ca.mtimes(ca.reshape(K, m, k), measurements.error - z_proposed)
        u = ca.SX.zeros(self.count)
        u[self.moved] = saturated(v, ca.DM(self.lowest), ca.DM(self.highest))
        return u


def tracking_rows(problem: FlightProblem, proposal: Proposal, tick: float) -> np.ndarray:
    """Return the array `held` of the `TrackingPolicy` for a proposal, one row per tick.

    A last row contains the gain of the linear policy, which follows the proposal.

    tick: duration of a tick, s
    """
    seconds = float(proposal.lengths.sum())
    ticks = steps_of(seconds, tick)
    z, v = proposal.at(tick / STEPS * np.arange(ticks * STEPS + 1))
    both = np.hstack([z[:, : len(problem.states)], v])
    knots = STEPS * np.arange(ticks)[:, None] + np.arange(STEPS + 1)
    begins = tick * np.arange(ticks)
    gains = tracking_gains(problem, proposal)
    interval = np.searchsorted(proposal.ends[1:], begins, side="right")
    K = gains[np.minimum(interval, len(gains) - 1)].transpose(0, 2, 1).reshape(ticks, -1)
    rows = np.hstack([begins[:, None], both[knots].reshape(ticks, -1), K])
    last = np.zeros(rows.shape[1])
    last[-K.shape[1] :] = problem.K.ravel(order="F")
    return np.vstack([rows, last])


def held_size(problem: FlightProblem) -> int:
    """Return the number of columns of the array that `tracking_rows` returns."""
    k, m = len(problem.states), len(problem.inputs)
    return 1 + (STEPS + 1) * (k + m) + m * k


def tracking_gains(problem: FlightProblem, proposal: Proposal) -> np.ndarray:
    """Return the gains of the time-varying LQR along a proposal, (N, m, k).

    The final cost is z'Pz. In each interval, the equations are linearized at the middle of the
    interval.
    """
    from scipy.linalg import expm

    A, B = _slopes(problem, proposal)
    S = B @ np.linalg.solve(problem.R, B.transpose(0, 2, 1))
    k = A.shape[1]
    costate = np.zeros((len(A), 2 * k, 2 * k))
    costate[:, :k, :k] = A
    costate[:, :k, k:] = -S
    costate[:, k:, :k] = -problem.Q
    costate[:, k:, k:] = -A.transpose(0, 2, 1)
    fastest = np.abs(np.linalg.eigvals(costate)).max(axis=1)
    steps = np.maximum(1, np.ceil(proposal.lengths * fastest / _STEP)).astype(int)
    back = expm(-costate * (proposal.lengths / steps)[:, None, None])
    P = problem.P
    gains = np.empty((len(A), B.shape[2], k))
    for index in range(len(A) - 1, -1, -1):
        E = back[index]
        for _ in range(steps[index]):
            # (z; P z) before a step is E (z; P z) after it.
            P = np.linalg.solve((E[:k, :k] + E[:k, k:] @ P).T, (E[k:, :k] + E[k:, k:] @ P).T).T
            P = 0.5 * (P + P.T)
        gains[index] = np.linalg.solve(problem.R, B[index].T @ P)
    return gains


def _slopes(problem: FlightProblem, proposal: Proposal) -> tuple[np.ndarray, np.ndarray]:
    """Return A, (N, k, k), and B, (N, k, m), at the middle of each interval.

    They relate deviations of the k linear states and the inputs. The followed states after the
    linear ones are left out.
    """
    nominal_states, nominal_inputs = problem.sizes
    z, v = proposal.at(proposal.ends[:-1] + 0.5 * proposal.lengths)
    middles = np.hstack([z / nominal_states, v / nominal_inputs])
    side_by_side = np.array(smooth_slopes(problem).map(len(middles))(middles.T))
    k, followed = len(problem.states), len(nominal_states)
    scaled = side_by_side.reshape(followed, len(middles), -1).transpose(1, 0, 2)
    slopes = scaled * nominal_states[:, None] / np.concatenate([nominal_states, nominal_inputs])
    return slopes[:, :k, :k], slopes[:, :k, followed:]
