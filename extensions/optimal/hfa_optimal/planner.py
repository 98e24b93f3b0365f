"""Plans of a predictive policy: flights of the model that a quadratic program improves."""

from __future__ import annotations

from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import rk4
from hfa_optimal.holds import Grid, gains_of
from hfa_optimal.plan_program import PlanProgram
from hfa_optimal.scaled import ScaledProblem
from hfa_optimal.smooth import disturbed_rates
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code

#: Least number of Runge-Kutta steps in a hold, and largest product of such a step and the fastest
#: pole. The gradient of a plan at the trim is then exact to 1e-5.
_PARTS = 2
_STEP = 0.2
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
        self._rates = disturbed_rates(scaled.problem, disturbance)

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

    @cached_property
    def _parts(self) -> list[int]:
        """Number of Runge-Kutta steps in each hold."""
        shares = self.grid.holds * self.scaled.fastest / _STEP
        return np.maximum(_PARTS, np.ceil(shares - 1e-9)).astype(int).tolist()

    @property
    def disturbances(self) -> int:
        """Number of disturbances d: one added to each rate, and that of the model."""
        return self.scaled.sizes[1] + self._rates.numel_in(1)

    @cached_property
    def slopes(self) -> ca.Function:
        """Function ((z, v), w) -> rates, their derivatives by (z, v) and by w."""
        both = ca.SX.sym("both", self._rates.numel_in(0))
        w = ca.SX.sym("w", self._rates.numel_in(1))
        rates = self._rates(both, w)
        by = (ca.densify(ca.jacobian(rates, column)) for column in (both, w))
        return ca.Function("slopes", [both, w], [rates, *by], {"cse": True})

    @cached_property
    def _step(self) -> ca.Function:
        """Function (z, v, d, h) -> z after one Runge-Kutta step of h seconds."""
        z, v, d, h = self._symbols()
        n = self.scaled.sizes[1]
        after = rk4(lambda x, _: self._rates(ca.vertcat(x, v), d[n:]) + d[:n], z, h)
        return ca.Function("step", [z, v, d, h], [after])

    @cached_property
    def _step_slopes(self) -> ca.Function:
        """Function ([z, S], v, d, h) -> [z, S] after one Runge-Kutta step, with the derivatives S
        (n, n + m) of z by the states and inputs at the start of the hold.
        """
        _, v, d, h = self._symbols()
        _, n, m = self.scaled.sizes
        columns = ca.MX.sym("columns", n, 1 + n + m)

        def moved(columns: Any, _: float) -> Any:
            rate, jacobian, _ = self.slopes(ca.vertcat(columns[:, 0], v), d[n:])
            of_inputs = ca.horzcat(ca.DM.zeros(n, n), jacobian[:, n:])
            return ca.horzcat(rate + d[:n], jacobian[:, :n] @ columns[:, 1:] + of_inputs)

        after = ca.densify(rk4(moved, columns, h))
        return ca.Function("step_slopes", [columns, v, d, h], [after])

    def _held(self, step: ca.Function, parts: int) -> ca.Function:
        """Return the function (z or [z, S], v, d, seconds) -> z or [z, S] after a hold.

        parts: number of Runge-Kutta steps
        """
        begin = ca.MX.sym("begin", *step.size_in(0))
        _, v, d, seconds = self._symbols()
        repeated = (ca.repmat(each, 1, parts) for each in (v, d, seconds / parts))
        after = step.fold(parts)(begin, *repeated)
        return ca.Function(f"{step.name()}_{parts}", [begin, v, d, seconds], [after])

    def _symbols(self) -> tuple[Any, Any, Any, Any]:
        _, n, m = self.scaled.sizes
        names = {"z": n, "v": m, "d": n + self._rates.numel_in(1), "seconds": 1}
        z, v, d, seconds = (ca.MX.sym(name, size) for name, size in names.items())
        return z, v, d, seconds

    @cached_property
    def _flown(self) -> BoundFunction:
        """Machine code of (z, v (m, N), d) -> states after each hold, (n, N)."""
        z, _, d, _ = self._symbols()
        inputs = ca.MX.sym("inputs", self.scaled.sizes[2], len(self._parts))
        nodes = [z]
        for parts, first, last in self._groups():
            held = self._held(self._step, parts).mapaccum(last - first)
            seconds = ca.DM(self.grid.holds[first:last]).T
            over = ca.repmat(d, 1, last - first)
            nodes.append(held(nodes[-1][:, -1], inputs[:, first:last], over, seconds))
        after = ca.horzcat(*nodes[1:])
        return BoundFunction(machine_code(ca.Function("flown", [z, inputs, d], [after])))

    @cached_property
    def _slopes(self) -> BoundFunction:
        """Machine code of (z (n, N), v (m, N), d) -> derivatives over each hold, (n, N (n + m))."""
        _, n, m = self.scaled.sizes
        _, _, d, _ = self._symbols()
        before = ca.MX.sym("before", n, len(self._parts))
        inputs = ca.MX.sym("inputs", m, len(self._parts))
        slopes = []
        for parts, first, last in self._groups():
            held = self._held_slopes(parts).map(last - first)
            seconds = ca.DM(self.grid.holds[first:last]).T
            over = ca.repmat(d, 1, last - first)
            slopes.append(held(before[:, first:last], inputs[:, first:last], over, seconds))
        function = ca.Function("slopes", [before, inputs, d], [ca.horzcat(*slopes)])
        return BoundFunction(machine_code(function))

    def _held_slopes(self, parts: int) -> ca.Function:
        """Return the function (z, v, d, seconds) -> S (n, n + m) after a hold."""
        z, v, d, seconds = self._symbols()
        _, n, m = self.scaled.sizes
        begin = ca.horzcat(z, ca.DM.eye(n), ca.DM.zeros(n, m))
        after = self._held(self._step_slopes, parts)(begin, v, d, seconds)
        return ca.Function(f"slopes_{parts}", [z, v, d, seconds], [ca.densify(after[:, 1:])])

    def _groups(self) -> list[tuple[int, int, int]]:
        """Return the number of steps, the first hold and the end of each run of equal numbers."""
        groups, first = [], 0
        for parts, same in groupby(self._parts):
            last = first + len(list(same))
            groups.append((parts, first, last))
            first = last
        return groups

    @cached_property
    def _one(self) -> BoundFunction:
        return BoundFunction(self._held(self._step, self._parts[0]))

    def after(self, z: np.ndarray, v: np.ndarray, d: np.ndarray, seconds: float) -> np.ndarray:
        """Return the states after a hold of at most a sample, (n,)."""
        (moved,) = self._one.at(z, v, d, seconds)
        return moved

    def flown(self, z: np.ndarray, v: np.ndarray, d: np.ndarray, target: Target) -> Plan:
        """Return the plan with given inputs, with infinite cost if the flight is not finite.

        z: states now, (n,)
        v: inputs during the holds, (N, m)
        d: disturbances
        """
        (after,) = self._flown.at(z, v.ravel(), d)
        nodes = np.vstack([z[None], after.reshape(len(v), -1)])
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
        count, n = len(plan.v), len(target.z)
        before = plan.z[:-1]
        (slopes,) = self._slopes.at(before.ravel(), plan.v.ravel(), d)
        lowest, highest = self.scaled.input_limits
        soft = before[:, self.soft]
        return self._program.step(
            plan.z - target.z,
            plan.v - target.v,
            self.P,
            slopes.reshape(count, -1, n).transpose(0, 2, 1),
            (self._room[0] - soft, self._room[1] - soft),
            (lowest - plan.v, highest - plan.v),
        )

    def guesses(self, z: np.ndarray, d: np.ndarray, target: Target) -> list[Plan]:
        """Return two first plans: inputs of the target, and the saturated linear optimum."""
        constant = np.tile(target.v, (len(self.holds), 1))
        return [self.flown(z, v, d, target) for v in (constant, self._linear(z, d, target))]

    def _linear(self, z: np.ndarray, d: np.ndarray, target: Target) -> np.ndarray:
        """Return the inputs of the linear optimum of the holds, saturated, in a flight, (N, m)."""
        inputs = []
        held = {parts: self._held(self._step, parts) for parts in set(self._parts)}
        for K, seconds, parts in zip(self.gains, self.grid.holds, self._parts, strict=True):
            v = np.clip(target.v - K @ (z - target.z), *self.scaled.input_limits)
            inputs.append(v)
            z = np.array(held[parts](z, v, d, seconds)).ravel()
        return np.array(inputs)

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
