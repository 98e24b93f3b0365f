"""Plans of a predictive policy: flights of the model that a quadratic program improves."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_optimal.held_model import HeldModel
from hfa_optimal.holds import Grid, gains_of
from hfa_optimal.plan_program import PlanProgram
from hfa_optimal.scaled import ScaledProblem

#: Factors on a step of the quadratic program that are tried until the flight is cheaper.
_SHARES = (1.0, 0.35, 0.1225, 0.042875)
#: A plan is not improved further if its cost falls by less than this fraction.
_SMALL = 1e-4
#: Price of a soft limit, in units of the largest slope of z'Pz over the usual box, per sample. With
#: a tenth of it, flights leave the limits where this is cheaper.
_STIFF = 5.0
#: Least price of a soft limit, relative to the largest. Largest unit of a slack, nominal values.
_LEAST_PRICE = 0.02
_LARGEST_SLACK = 5.0


class Target(NamedTuple):
    """Equilibrium at which a flight ends, as deviations from the trim: z (n,) and v (m,)."""

    z: np.ndarray
    v: np.ndarray


class Plan(NamedTuple):
    """Flight of the model over the horizon.

    z: states at the nodes, (N + 1, n)
    v: inputs during the holds, (N, m)
    cost: cost of the flight, with z'Pz at its end and the prices of exceeded soft limits
    """

    z: np.ndarray
    v: np.ndarray
    cost: float


class Planner:
    """Plans over the holds of a grid, in nominal units.

    A plan is a flight of the smooth equations with held inputs. Its cost is the exact cost of the
    linear model over the holds, plus z'Pz at the end. The limits of the inputs are hard. Those of
    the states are soft at the nodes, with an exact penalty, and narrowed by the margin.

    scaled: the problem in nominal units
    grid: holds of a plan
    P: matrix of the cost z'Pz at the end of a plan, (n, n). It may be replaced between samples
    margin: fraction of the distance from the trim by which the limits of the states are narrowed
    disturbance: disturbance of the model in the disturbances d of a plan, or "" for none
    """

    def __init__(
        self,
        scaled: ScaledProblem,
        grid: Grid,
        P: np.ndarray,
        margin: float,
        disturbance: str = "",
    ) -> None:
        self.scaled = scaled
        self.grid = grid
        self.holds = grid.of(scaled)
        self.P = P
        lowest, highest = scaled.state_limits
        self.soft = np.flatnonzero(np.isfinite(lowest) | np.isfinite(highest))
        self._room = (1.0 - margin) * lowest[self.soft], (1.0 - margin) * highest[self.soft]
        self._prices = self._slack_prices()
        self._weights = np.array([hold.W for hold in self.holds])
        self._program = PlanProgram(self._weights, self._prices, self.soft, scaled.sizes[2])
        self.model = HeldModel(scaled, grid.holds, disturbance)

    def _slack_prices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return slope and curvature of the cost of a slack at each node, (N, S) each."""
        k, _, _ = self.scaled.sizes
        lowest, highest = self.scaled.state_limits
        pull = 2.0 * np.abs(self.P[:, :k]) @ self.scaled.box
        prices = _STIFF * np.maximum(pull, _LEAST_PRICE * pull.max())[self.soft] / self.grid.dt
        reach = np.minimum(0.5 * (highest - lowest)[self.soft], _LARGEST_SLACK)
        slopes = np.outer(self.grid.holds, prices)
        return slopes, slopes / np.maximum(reach, 1e-9)

    @cached_property
    def gains(self) -> np.ndarray:
        """Linear optimal gains of the holds, without limits, (N, m, n)."""
        return gains_of(self.holds, self.P)[0]

    def flown(self, z: np.ndarray, v: np.ndarray, d: np.ndarray, target: Target) -> Plan:
        """Return the plan with given inputs, with infinite cost if the flight is not finite.

        z: states now, (n,)
        v: inputs during the holds, (N, m)
        d: disturbances
        """
        nodes = self.model.flown(z, v, d)
        with np.errstate(all="ignore"):
            cost = self._cost(nodes, v, target)
        return Plan(nodes, v, cost if np.isfinite(cost) else np.inf)

    def _cost(self, nodes: np.ndarray, v: np.ndarray, target: Target) -> float:
        both = np.hstack([nodes[:-1] - target.z, v - target.v])
        end = nodes[-1] - target.z
        soft = nodes[1:-1, self.soft]
        slack = np.maximum(0.0, np.maximum(soft - self._room[1], self._room[0] - soft))
        slopes, curvatures = (price[1:] for price in self._prices)
        cost = np.einsum("ki,kij,kj->", both, self._weights, both) + end @ self.P @ end
        return float(cost + (slack * (slopes + 0.5 * curvatures * slack)).sum())

    def cost_of_sample(self, plan: Plan, target: Target) -> float:
        """Return the cost of the first hold of a plan."""
        both = np.concatenate([plan.z[0] - target.z, plan.v[0] - target.v])
        return float(both @ self._weights[0] @ both)

    def improved(self, plan: Plan, d: np.ndarray, target: Target, tries: int) -> tuple[Plan, int]:
        """Return a plan of at most the cost of the given one, and the number of refused steps.

        A step of the quadratic program is shortened until the flight of the model is cheaper.
        Otherwise it is refused, and the plan stays.

        tries: largest number of steps
        """
        lowest, highest = self.scaled.input_limits
        for _ in range(tries):
            if not np.isfinite(plan.cost):
                return plan, 0
            step = self._proposed(plan, d, target)
            better = None
            for share in _SHARES if np.isfinite(step).all() else ():
                v = np.clip(plan.v + share * step, lowest, highest)
                flown = self.flown(plan.z[0], v, d, target)
                if flown.cost < plan.cost:
                    better = flown
                    break
            if better is None:
                return plan, 1
            gained = plan.cost - better.cost
            plan = better
            if gained < _SMALL * plan.cost:
                break
        return plan, 0

    def _proposed(self, plan: Plan, d: np.ndarray, target: Target) -> np.ndarray:
        """Return the change of the inputs that the quadratic program proposes, (N, m)."""
        before = plan.z[:-1]
        lowest, highest = self.scaled.input_limits
        soft = before[:, self.soft]
        return self._program.step(
            plan.z - target.z,
            plan.v - target.v,
            self.P,
            self.model.moved_along(before, plan.v, d)[1],
            (self._room[0] - soft, self._room[1] - soft),
            (lowest - plan.v, highest - plan.v),
        )

    def guesses(self, z: np.ndarray, d: np.ndarray, target: Target) -> list[Plan]:
        """Return two first plans: inputs of the target, and the saturated linear optimum."""
        limits = self.scaled.input_limits
        constant = np.tile(target.v, (len(self.holds), 1))
        linear = self.model.flown_by(
            z,
            d,
            lambda number, z: np.clip(target.v - self.gains[number] @ (z - target.z), *limits),
        )
        return [self.flown(z, v, d, target) for v in (constant, linear)]

    def shifted(self, v: np.ndarray) -> np.ndarray:
        """Return the inputs of a plan one sample later: averages over the new holds, (N, m)."""
        ends = self.grid.ends
        integral = np.vstack(
            [np.zeros(v.shape[1]), np.cumsum(v * self.grid.holds[:, None], axis=0)]
        )
        later = ends + self.grid.dt
        within = np.minimum(later, ends[-1])
        moved = np.column_stack([np.interp(within, ends, column) for column in integral.T])
        moved += (later - within)[:, None] * v[-1]
        return np.diff(moved, axis=0) / self.grid.holds[:, None]
