"""Plans of a predictive policy: flights of the model that a quadratic program improves."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.hold import Hold
from hfa_optimal.held_model import HeldModel
from hfa_optimal.holds import Grid, gains_of
from hfa_optimal.one_sample_filter import OneSampleFilter
from hfa_optimal.plan_program import PlanProgram
from hfa_optimal.scaled import ScaledProblem
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code

#: Factors on a step of the quadratic program that are tried until the flight is cheaper.
_SHARES = (1.0, 0.35, 0.1225, 0.042875)
#: Cost above which a flight is taken as infinite.
_LOST = 1e20
#: A plan is not improved further if its cost falls by less than this fraction.
_SMALL = 3e-5
#: Share of its cost that a program must promise for a second program of the same step.
_WORTH = 1e-3
#: Part of the room of a state beyond which the quadratic program knows its limits.
_NEAR = 0.5
#: Price of a soft limit, in units of the largest slope of z'Pz over the usual box, per sample. With
#: a tenth of it, flights leave the limits where this is cheaper.
_STIFF = 5.0
#: Least price of a soft limit, relative to the largest. Largest unit of a slack, nominal values.
_LEAST_PRICE = 0.02
_LARGEST_SLACK = 5.0
#: Duration of the flight of a gain, in horizons.
_HORIZONS = 4


class Target(NamedTuple):
    """Equilibrium at which a flight ends, as deviations from the trim: z (n,) and v (m,)."""

    z: np.ndarray
    v: np.ndarray


class Plan(NamedTuple):
    """Flight of the model over the horizon.

    z: states at the nodes, (N + 1, n)
    middle: states at the samples in the middle of the holds, (N, n)
    v: inputs during the holds, (N, m)
    cost: cost of the flight, with z'Pz at its end and the price of exceeded soft limits
    price: that price
    age: number of samples since the first plan, which decides the holds
    """

    z: np.ndarray
    middle: np.ndarray
    v: np.ndarray
    cost: float
    price: float
    age: int


class Planner:
    """Plans over the holds of a grid, in nominal units.

    A plan is a flight of the smooth equations with held inputs. Its cost is the exact cost of the
    linear model over the holds, plus z'Pz at the end. The limits of the inputs are hard. Those of
    the states are soft at the samples, with an exact penalty, and narrowed by the margin. The
    quadratic program knows them at the ends of the holds, and those of fast states at the middles.

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
        self.P = P
        self.margin = margin
        lowest, highest = scaled.state_limits
        self.soft = np.flatnonzero(np.isfinite(lowest) | np.isfinite(highest))
        self._room = (1.0 - margin) * lowest[self.soft], (1.0 - margin) * highest[self.soft]
        longest, count = grid.most_samples
        fast = scaled.reached(grid.dt) & (longest.max() > 1)
        self._fast = np.flatnonzero(fast[self.soft])
        self._slopes, self._curvatures = self._slack_prices()
        self._programs: dict[tuple[int, ...], PlanProgram] = {}
        self._filter = OneSampleFilter(scaled, grid.dt * longest[-1], 1.0 - margin)
        self.model = HeldModel(scaled, grid.dt * longest, disturbance)
        self._begins = HeldModel(scaled, grid.dt * (longest - longest // 2), disturbance)
        self._rests = HeldModel(scaled, grid.dt * (longest // 2), disturbance)
        self._flights = HeldModel(scaled, np.full(count, grid.dt), disturbance)
        self._gain_flight = self._flight_of_gain()

    def _slack_prices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return slope and curvature of the cost of a slack for a second, (S,) each."""
        k, _, _ = self.scaled.sizes
        lowest, highest = self.scaled.state_limits
        pull = 2.0 * np.abs(self.P[:, :k]) @ self.scaled.box
        prices = _STIFF * np.maximum(pull, _LEAST_PRICE * pull.max())[self.soft] / self.grid.dt
        reach = np.minimum(0.5 * (highest - lowest)[self.soft], _LARGEST_SLACK)
        return prices, prices / np.maximum(reach, 1e-9)

    def flown(
        self, z: np.ndarray, v: np.ndarray, d: np.ndarray, target: Target, age: int = 0
    ) -> Plan:
        """Return the plan with given inputs, with infinite cost if the flight is not finite.

        z: states now, (n,)
        v: inputs during the holds, (N, m)
        d: disturbances
        age: number of samples since the first plan
        """
        holds = self.grid.at(age)
        ends = np.cumsum(holds.samples)
        inputs = np.zeros((len(self._flights.holds), len(target.v)))
        inputs[: ends[-1]] = np.repeat(v, holds.samples, axis=0)
        samples = self._flights.flown(z, inputs, d)[: ends[-1] + 1]
        nodes, middle = samples[np.append(0, ends)], samples[ends - holds.samples // 2]
        with np.errstate(all="ignore"):
            both = np.hstack([nodes[:-1] - target.z, v - target.v])
            end = nodes[-1] - target.z
            cost = np.einsum("ki,kij,kj->", both, holds.weights, both) + end @ self.P @ end
            price = self._price(samples[1:])
            cost = float(cost + price)
        return Plan(nodes, middle, v, cost if cost < _LOST else np.inf, price, age)

    def _price(self, samples: np.ndarray) -> float:
        """Return the price of exceeded soft limits at some samples, (K, n)."""
        soft = samples[:, self.soft]
        slack = np.maximum(0.0, np.maximum(soft - self._room[1], self._room[0] - soft))
        return float(self.grid.dt * (slack * (self._slopes + 0.5 * self._curvatures * slack)).sum())

    def cost_of_gain(self, K: np.ndarray, z: np.ndarray, d: np.ndarray, target: Target) -> float:
        """Return the cost of the flight of v = v_t - K (z - z_t), within the limits of the inputs.

        It lasts four horizons, and z'Pz at its end is added. It is infinite if a sample exceeds the
        narrowed limits of the states.

        K: held gain, (m, k)
        z: initial states, (n,)
        """
        (after,) = self._gain_flight.at(np.concatenate([z, [0.0, 0.0]]), K.ravel(), *target, d)
        end = after[:-2] - target.z
        cost = float(after[-2] + end @ self.P @ end) if after[-1] == 0.0 else np.inf
        return cost if cost < _LOST else np.inf

    def _flight_of_gain(self) -> BoundFunction:
        """Return the machine code of ([z, cost, excess], K by rows, z_t, v_t, d) -> [z, cost,
        largest excess over the limits] after four horizons.
        """
        k, n, m = self.scaled.sizes
        sizes = {"begin": n + 2, "K": m * k, "z_t": n, "v_t": m, "d": self.model.disturbances}
        begin, K, z_t, v_t, d = given = [ca.MX.sym(name, size) for name, size in sizes.items()]
        away = begin[:n] - z_t
        least, most = (ca.DM(limit) for limit in self.scaled.input_limits)
        v = ca.fmin(ca.fmax(v_t - ca.reshape(K, k, m).T @ away[:k], least), most)
        both = ca.vertcat(away, v - v_t)
        after = self.model.sample(begin[:n], v, d, self.grid.dt)
        cost = begin[n] + ca.bilin(ca.DM(self.grid.at(0).weights[0]), both, both)
        soft = ca.vec(after[self.soft.tolist()])
        lows, highs = (ca.DM(room) for room in self._room)
        excess = ca.mmax(ca.vertcat(begin[n + 1], soft - highs, lows - soft))
        step = ca.Function("step", given, [ca.vertcat(after, cost, excess)]).expand()
        samples = _HORIZONS * int(self.grid.samples(0).sum())
        constant = [ca.repmat(each, 1, samples) for each in given[1:]]
        flown = step.fold(samples)(begin, *constant)
        return BoundFunction(machine_code(ca.Function("gain_flight", given, [flown])))

    def cost_of_sample(self, plan: Plan, target: Target) -> float:
        """Return the cost of the first hold of a plan."""
        both = np.concatenate([plan.z[0] - target.z, plan.v[0] - target.v])
        return float(both @ self.grid.at(plan.age).weights[0] @ both)

    def improved(self, plan: Plan, d: np.ndarray, target: Target, tries: int) -> tuple[Plan, int]:
        """Return a plan of at most the cost of the given one, and the number of refused steps.

        A step of the quadratic program is shortened until the flight of the model is cheaper.
        Otherwise it is refused, and the plan stays.

        tries: largest number of steps
        """
        for _ in range(tries):
            if not np.isfinite(plan.cost):
                return plan, 0
            better = self._step(plan, d, target)
            if better is None:
                return plan, 1
            gained = plan.cost - better.cost
            plan = better
            if gained < _SMALL * plan.cost:
                break
        return plan, 0

    def _step(self, plan: Plan, d: np.ndarray, target: Target) -> Plan | None:
        """Return a cheaper plan by a step of the quadratic program, or None.

        The plan itself is returned where the program promises less than _SMALL of its cost.

        If the full step is not cheaper, a second program has limits that are corrected by the
        difference of the flight from its linear prediction. The step then bends towards it.
        """
        slopes = self._slopes_along(plan, d)
        none = np.zeros(plan.middle.shape)
        step, moved, change = self._proposed(plan, slopes, (none, none), target)
        if not np.isfinite(step).all():
            return None
        if plan.price - change < _SMALL * plan.cost:
            return plan
        full = self._changed(plan, step, d, target)
        if full.cost < plan.cost:
            return full
        bent = np.zeros(step.shape)
        if np.isfinite(full.cost) and plan.price - change > _WORTH * plan.cost:
            both = np.hstack([moved[:-1], step])
            ends = full.z[1:] - plan.z[1:] - moved[1:]
            middles = full.middle - plan.middle - np.einsum("nij,nj->ni", slopes[1], both)
            corrected, _, _ = self._proposed(plan, slopes, (ends, middles), target)
            bent = np.where(np.isfinite(corrected), corrected - step, 0.0)
        for share in _SHARES if bent.any() else _SHARES[1:]:  # the full step has been flown
            shorter = self._changed(plan, share * step + share**2 * bent, d, target)
            if shorter.cost < plan.cost:
                return shorter
        return None

    def _changed(self, plan: Plan, change: np.ndarray, d: np.ndarray, target: Target) -> Plan:
        v = np.clip(plan.v + change, *self.scaled.input_limits)
        return self.flown(plan.z[0], v, d, target, plan.age)

    def _proposed(
        self,
        plan: Plan,
        slopes: tuple[np.ndarray, np.ndarray],
        correction: tuple[np.ndarray, np.ndarray],
        target: Target,
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the result of the quadratic program: changes of inputs, states and cost.

        It knows the limits of the states that the plan brings beyond half of their room.

        slopes: derivatives at the ends and middles of the holds
        correction: differences of the states there from their linear prediction
        """
        lows, highs = self._room
        ends, middles = plan.z[1:] + correction[0], plan.middle + correction[1]
        states = plan.z[1:, self.soft]
        near = (states > _NEAR * highs) | (states < _NEAR * lows)
        soft = np.flatnonzero(near.any(axis=0))
        program = self._program(soft)
        fast = soft[program.fast]
        ends, middles = ends[:, self.soft[soft]], middles[:, self.soft[fast]]
        lowest, highest = self.scaled.input_limits
        holds = self.grid.at(plan.age)
        seconds = holds.seconds[:, None]
        return program.step(
            plan.z - target.z,
            plan.v - target.v,
            holds.weights,
            self.P,
            (seconds * self._slopes[soft], seconds * self._curvatures[soft]),
            slopes[0],
            slopes[1][:, self.soft[fast]],
            (lows[soft] - ends, highs[soft] - ends),
            (lows[fast] - middles, highs[fast] - middles),
            (lowest - plan.v, highest - plan.v),
            plan.cost,
        )

    def _program(self, soft: np.ndarray) -> PlanProgram:
        """Return the quadratic program with the limits of some states, given by number."""
        key = tuple(soft.tolist())
        if key not in self._programs:
            _, n, m = self.scaled.sizes
            fast = np.flatnonzero(np.isin(soft, self._fast))
            self._programs[key] = PlanProgram(len(self.model.holds), n, m, self.soft[soft], fast)
        return self._programs[key]

    def _slopes_along(self, plan: Plan, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the states at the ends and middles of the holds."""
        holds = self.grid.at(plan.age)
        z, n = plan.z[:-1], plan.z.shape[1]
        if not len(self._fast):
            ends = self.model.moved_along(z, plan.v, d, holds.seconds)[1]
            return ends, ends
        rest = holds.samples // 2
        middle, begins = self._begins.moved_along(
            z, plan.v, d, self.grid.dt * (holds.samples - rest)
        )
        ends = self._rests.moved_along(middle, plan.v, d, self.grid.dt * rest)[1]
        over = ends[:, :, :n] @ begins
        over[:, :, n:] += ends[:, :, n:]
        return over, begins

    def guesses(self, z: np.ndarray, d: np.ndarray, target: Target) -> list[Plan]:
        """Return two first plans: the saturated linear optimum, and the inputs of the target."""
        holds = self.grid.at(0)
        constant = np.tile(target.v, (len(holds.samples), 1))
        linear = []
        moved = z
        for gain, samples in zip(gains_of(holds.linear, self.P)[0], holds.samples, strict=True):
            v = target.v - gain @ (moved - target.z)
            linear.append(np.clip(v, *self.scaled.input_limits))
            for _ in range(samples):
                moved = self.model.after(moved, linear[-1], d, self.grid.dt)
        return [self.flown(z, v, d, target) for v in (np.array(linear), constant)]

    def later(self, plan: Plan, z: np.ndarray, d: np.ndarray, target: Target) -> Plan:
        """Return the plan one sample later: the same inputs at the same times.

        z: states now, (n,)
        """
        before, holds = self.grid.at(plan.age), self.grid.at(plan.age + 1)
        begins = 1 + np.cumsum(holds.samples) - holds.samples
        number = np.searchsorted(np.cumsum(before.samples), begins, side="right")
        v = plan.v[np.minimum(number, len(plan.v) - 1)]
        beyond = number == len(plan.v)
        if beyond.any():
            v[beyond] = self._last_input(plan, holds.linear[-1], target)
        return self.flown(z, v, d, target, plan.age + 1)

    def _last_input(self, plan: Plan, hold: Hold, target: Target) -> np.ndarray:
        """Return the cheapest input of a hold after the end of a plan, (m,).

        It is the linear optimum, the last input of the plan, or that of the target, changed least
        such that fast states stay within their limits.
        """
        z = plan.z[-1]
        gain, _ = hold.back(self.P)
        linear = np.clip(target.v - gain @ (z - target.z), *self.scaled.input_limits)
        inputs = [self._filter(z, v) for v in (linear, plan.v[-1], target.v)]
        calm = np.zeros(self._filter.model.disturbances)
        costs = []
        for v in inputs:
            (after,) = self._filter.model.moved_along(z[None], v[None], calm)[0]
            both, end = np.concatenate([z - target.z, v - target.v]), after - target.z
            costs.append(both @ hold.W @ both + end @ self.P @ end + self._price(after[None]))
        return inputs[int(np.argmin(costs))]
