"""A problem of best flights in nominal units, as a predictive policy uses it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hfa_flight.plan.hold import hold_of
from hfa_flight.plan.initial_box import usual_box
from hfa_flight.plan.problem import FlightProblem
from hfa_flight.plan.smooth import smooth_slopes

#: Fraction of its range by which the inputs move a state that they reach.
_REACHES = 0.1


@dataclass(frozen=True, eq=False)
class ScaledProblem:
    """Linear model, weights and limits of a problem, divided by nominal values.

    z (n,) are the deviations of the followed states, v (m,) those of the moving inputs. The first k
    followed states are those of the linear model.

    problem: aircraft, trim, weights and limits
    """

    problem: FlightProblem

    @cached_property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers k of states of the linear model, n of followed states and m of inputs."""
        problem = self.problem
        return len(problem.states), len(problem.followed), len(problem.inputs)

    @cached_property
    def linear(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A (n, n), B (n, m), Q (n, n) and R (m, m). The weights of carried states are 0."""
        n = self.sizes[1]
        slopes = np.array(smooth_slopes(self.problem)(0.0))
        Q, R, _ = self.problem.scaled_weights()
        return slopes[:, :n], slopes[:, n:], Q, R

    @cached_property
    def P(self) -> np.ndarray:
        """Matrix of the least cost z'Pz of the linear model without limits, (n, n)."""
        return self.problem.scaled_weights()[2]

    @cached_property
    def linear_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A (k, k), B (k, m), Q (k, k) and R (m, m) of the states of the linear model."""
        k = self.sizes[0]
        A, B, Q, R = self.linear
        return A[:k, :k], B[:k], Q[:k, :k], R

    @cached_property
    def poles(self) -> np.ndarray:
        """Poles of the aircraft, 1/s, (k,)."""
        return np.asarray(np.linalg.eigvals(self.linear_states[0]))

    @cached_property
    def loop_poles(self) -> np.ndarray:
        """Poles of the loop of the linear optimum, 1/s, (k,)."""
        linear = self.problem.linear
        return np.asarray(np.linalg.eigvals(linear.A - linear.B @ self.problem.K))

    @cached_property
    def fastest(self) -> float:
        """Magnitude of the fastest pole of the aircraft, 1/s; 0 for integrators alone."""
        return float(np.abs(self.poles).max())

    @cached_property
    def box(self) -> np.ndarray:
        """Half-widths of the usual box of initial deviations, (k,)."""
        return usual_box(self.problem) / self.problem.sizes.states[: self.sizes[0]]

    def excess_weight(self, P: np.ndarray) -> float:
        """Return the relative increase of the mean cost z'Pz over the usual box, against the
        linear optimum without holds.

        P: (k, k) or (n, n)
        """
        k = self.sizes[0]
        mean, least = (np.diag(matrix)[:k] @ self.box**2 for matrix in (P, self.P))
        return float(mean / least - 1.0)

    @cached_property
    def state_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest deviations of the followed states, (n,) each."""
        lowest, highest = self.problem.state_limits
        sizes = self.problem.sizes.states
        return lowest / sizes, highest / sizes

    @cached_property
    def input_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest deviations of the inputs, (m,) each."""
        lowest, highest = self.problem.input_limits
        sizes = self.problem.sizes.inputs
        return lowest / sizes, highest / sizes

    def reached(self, dt: float) -> np.ndarray:
        """Return which followed states the inputs can move by a tenth of their range in dt seconds,
        (n,). States without limits, and carried ones, are not.
        """
        k, n, _ = self.sizes
        lowest, highest = self.input_limits
        ranges = 0.5 * (highest - lowest)
        moves = np.abs(hold_of(*self.linear_states, dt).B) @ np.where(
            np.isfinite(ranges), ranges, 1.0
        )
        below, above = (limit[:k] for limit in self.state_limits)
        room = 0.5 * (above - below)
        return np.pad(np.isfinite(room) & (moves >= _REACHES * room), (0, n - k))
