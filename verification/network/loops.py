"""Closed loops of critics that are not quadratic, on the linear and on the nonlinear plant.

A policy u costs J = V* + ∫ (u - u*)'R (u - u*) - δ² (d - d*)'(d - d*) dt, and in discrete time a
sum over the steps (`excess_cost_rate`). The worst disturbance of u = -K z is that of its
`Excess`.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.symbols import symbols_for
from controller.riccati.balancing import abscissa_of
from controller.riccati.excess import Excess
from controller.riccati.gare import Solution
from hfa_aircraft.march.ending import FAR_OF_VALUE, OF_EXACT, OF_VALUE, Outcome, has_decayed
from hfa_support.matrices import quadratic_forms
from hfa_support.native.bound import BoundFunction
from verification.plant import NonlinearPlant

#: A tick of a simulation in continuous time is as long as the slowest linear loop needs to decay to
#: exp(-`DECAY`). A loop that is more than `SLOWEST` times slower than the exact one counts as that
#: fast.
DECAY = 5.0
SLOWEST = 100.0
#: Largest number of ticks of a simulation: 500 time constants of the linear loop.
TICKS = 100
#: Largest number of LSODA steps in a simulation of the linear plant, in one that is slow to
#: evaluate (a wide network, the nonlinear plant), and of steps of a discrete loop.
STEPS = 20_000
FEW_STEPS = 1000
#: Number of steps of a discrete loop that are computed together.
_PER_TICK = 100
#: Largest number of Newton steps to an equilibrium, and its largest distance, in boxes.
_NEWTON_STEPS = 30
_FARTHEST_REST = 100.0
Expression = Callable[[ca.SX], ca.SX]


class End(NamedTuple):
    """End of a simulation.

    outcome: whether the loop converges, diverges, or is not decided at the end of the clock
    time: duration, s or steps
    z: state minus the equilibrium, (n,)
    cost: cost until then
    discount: discount of the cost after the end
    """

    outcome: Outcome
    time: float
    z: np.ndarray
    cost: float
    discount: float


class Ticks(Protocol):
    """Simulation of one loop, tick by tick.

    tick: duration of a tick, s or steps
    most_steps: largest number of steps of the simulation
    """

    tick: float
    most_steps: int

    def __call__(self, state: np.ndarray, steps: int) -> tuple[np.ndarray, int]:
        """Return the state after a tick, nan where the loop diverges, and the steps it took.

        steps: largest number of steps; if the tick takes more, the state is the first one
        """


class FlowTicks:
    """Ticks of x' = f(x), by LSODA with error control.

    rate: x -> (x', V*)
    tick: duration, s
    largest: V* above which the loop diverges
    most_steps: largest number of LSODA's own steps of a simulation
    """

    def __init__(self, rate: ca.Function, tick: float, largest: float, most_steps: int) -> None:
        self.tick = tick
        self.most_steps = most_steps
        self._rate = BoundFunction(rate)
        self._largest = largest

    def __call__(self, state: np.ndarray, steps: int) -> tuple[np.ndarray, int]:
        """Return the state after a tick, and the number of LSODA's steps."""
        from scipy.integrate import odeint

        with (
            contextlib.suppress(FloatingPointError),  # the loop diverges
            warnings.catch_warnings(action="ignore"),  # of LSODA when it fails
        ):
            (_, reached), report = odeint(
                self._rates,
                state,
                [0.0, self.tick],
                full_output=True,
                rtol=1e-7,
                atol=1e-9 * np.abs(state).max(),
                mxstep=steps,
            )
            if report["message"] == "Integration successful.":
                return reached, int(report["nst"][-1])
            return state, steps
        return np.full(state.shape, np.nan), 0

    def _rates(self, x: np.ndarray, _: float) -> np.ndarray:
        """Return x'. Raises FloatingPointError where the loop diverges."""
        self._rate.inputs[0][:] = x
        self._rate()
        rates, value = self._rate.results
        if not value[0] <= self._largest:
            raise FloatingPointError
        return rates


class StepTicks:
    """Ticks of x⁺ = F(x), of several steps each.

    after: x -> x⁺
    is_slow: whether it is slow to evaluate
    """

    def __init__(self, after: ca.Function, *, is_slow: bool) -> None:
        per_tick, self.most_steps = (1, FEW_STEPS) if is_slow else (_PER_TICK, STEPS)
        self.tick = float(per_tick)
        x = ca.MX.sym("x", after.numel_in(0))
        one = ca.Function("step", [x], [ca.densify(after(x))])
        self._tick = BoundFunction(one.mapaccum("steps", per_tick))

    def __call__(self, state: np.ndarray, steps: int) -> tuple[np.ndarray, int]:
        """Return the state after a tick, and the number of its steps."""
        with np.errstate(all="ignore"):
            (after,) = self._tick.at(state)
        return after[-len(state) :], int(self.tick)


@dataclass(frozen=True, eq=False)
class Loop:
    """Closed loop of z and of its cost.

    A simulation ends when V* = z'Pz has decreased to `OF_VALUE` of its first value, when it has
    increased beyond `largest`, or when the clock ends.

    ticks: simulation of [z; cost], in discrete time of [z; cost; discount αᵏ]
    first: initial cost and discount
    P: matrix of V*, (n, n)
    equilibrium: equilibrium near z = 0, or None if none is found
    largest: V* above which the loop diverges
    by_exact: matrix of the exact loop in discrete time, (n, n), or None. A slow loop also converges
        if V* is at most `OF_EXACT` times that of the exact loop at the end of the clock
    """

    ticks: Ticks
    first: tuple[float, ...]
    P: np.ndarray
    equilibrium: np.ndarray | None
    largest: float
    by_exact: np.ndarray | None = None

    def simulate(self, start: np.ndarray) -> End:
        """Simulate the loop from the initial state `start` (n,).

        Without an equilibrium, nothing is decided.
        """
        n = len(start)
        state, time = np.append(start, self.first), 0.0
        if self.equilibrium is None:
            return self._end(Outcome.UNDECIDED, time, state, n)
        initial = self._value(start - self.equilibrium)
        left = self.ticks.most_steps
        for _ in range(self._most_ticks):
            state, used = self.ticks(state, left)
            left -= used
            if not self._value(state[:n]) <= self.largest:
                return self._end(Outcome.LEFT, time, state, n)
            if left <= 0:
                break
            time += self.ticks.tick
            if has_decayed(self._value(state[:n] - self.equilibrium), initial, OF_VALUE):
                return self._end(Outcome.CONVERGED, time, state, n)
        outcome = Outcome.UNDECIDED
        if self.by_exact is not None:
            exact = np.linalg.matrix_power(self.by_exact, round(time)) @ (start - self.equilibrium)
            value = self._value(state[:n] - self.equilibrium)
            if has_decayed(value, self._value(exact), OF_EXACT):
                outcome = Outcome.CONVERGED
        return self._end(outcome, time, state, n)

    @property
    def _most_ticks(self) -> int:
        if self.by_exact is None:
            return TICKS
        return math.ceil(self.ticks.most_steps / self.ticks.tick)

    def _end(self, outcome: Outcome, time: float, state: np.ndarray, n: int) -> End:
        cost, *discount = state[n:].tolist()
        z = state[:n] if self.equilibrium is None else state[:n] - self.equilibrium
        return End(outcome, time, z, cost, *(discount or [1.0]))

    def _value(self, z: np.ndarray) -> float:
        """Return V* of a state z (n,)."""
        with np.errstate(all="ignore"):
            return float(quadratic_forms(z[None], self.P)[0])


def undisturbed_loop(exact: Solution, critic: Critic, b: np.ndarray) -> Loop:
    """Return the closed loop without disturbance.

    b: half-widths of the box of states, (n,)
    """
    return _loop_of(exact, exact.game.A, critic, b)


def worst_loop(exact: Solution, critic: Critic, excess: Excess, b: np.ndarray) -> Loop:
    """Return the closed loop under the worst disturbance of u = -K z, the critic's linear part.

    The cost is J - V*. Inputs and disturbances count from their values at the equilibrium.

    excess: cost of u = -K z above the optimum, with the gain of its disturbance above the optimum
    b: half-widths of the box of states, (n,)
    """
    game = exact.game

    def running(equilibrium: np.ndarray) -> Expression:
        return excess_cost_rate(critic.policy, exact, excess.disturbance_gain, equilibrium)

    A = game.A + game.E @ (exact.L + excess.disturbance_gain)
    return _loop_of(exact, A, critic, b, running)


def plant_loop(
    exact: Solution, plant: NonlinearPlant, critic: Critic | None, b: np.ndarray
) -> Loop:
    """Return the closed loop of the nonlinear plant with its saturated inputs.

    critic: the critic, or None for the exact policy
    b: half-widths of the box of states, (n,)
    """
    game = exact.game
    z = ca.SX.sym("z", len(b)) if critic is None else critic.symbols
    u = -ca.DM(exact.K) @ z if critic is None else critic.policy(z)
    own = [] if critic is None else [game.A - game.B @ critic.K]
    return flow_loop(z, plant.closed(z, u), exact, _tick(exact, *own), b, is_slow=True)


def _loop_of(
    exact: Solution,
    A: np.ndarray,
    critic: Critic,
    b: np.ndarray,
    running: Callable[[np.ndarray], Expression] | None = None,
) -> Loop:
    """Return the loop z' = A z + B u, in discrete time z⁺ = A z + B u, of a critic's policy.

    A: matrix of the game, with the policy of the disturbance if there is one, (n, n)
    running: equilibrium -> cost per second or step, or None without cost
    """
    game = exact.game
    linear = A - game.B @ critic.K
    if game.is_discrete:
        z = symbols_for([critic.policy], len(b))
        next_state = ca.DM(A) @ z + ca.DM(game.B) @ critic.policy(z)
        return step_loop(z, next_state, exact, A - game.B @ exact.K, b, running)
    z = critic.symbols
    rate = ca.DM(A) @ z + ca.DM(game.B) @ critic.policy(z)
    undisturbed = game.A - game.B @ critic.K
    return flow_loop(z, rate, exact, _tick(exact, undisturbed, linear), b, running)


def _tick(exact: Solution, *loops: np.ndarray) -> float:
    """Return the duration of a tick in continuous time, s, in which the exact loop and linear loops
    decay. Loops count as at most `SLOWEST` times slower than the exact one.

    loops: stable matrices, (n, n)
    """
    game = exact.game
    by_exact, *rates = (abs(abscissa_of(loop)) for loop in (game.A - game.B @ exact.K, *loops))
    return DECAY / max(min([by_exact, *rates]), by_exact / SLOWEST)


def excess_cost_rate(
    policy: ca.Function, exact: Solution, M: np.ndarray, equilibrium: np.ndarray
) -> Expression:
    """Return the rate at which a policy costs more than the exact policy, as z -> a'H a.

    a = (v, w) are the deviations v = u(z) + K z - (u(e) + K e) and w = M (z - e) of the players
    from their exact policies, minus those at the equilibrium e. H is [R 0; 0 -δ²], in discrete time
    plus α [B E]'P [B E].

    exact: exact solution, with the policy u* = -K z and the value z'P z
    M: gain of the disturbance above the exact one, (k, n)
    equilibrium: equilibrium of the loop, (n,)
    """
    game = exact.game
    price, cross = exact.excess_weight, np.zeros((len(game.R), len(M)))
    of_disturbance = -(game.delta**2) * np.eye(len(M)) if M.any() else 0.0 * np.eye(len(M))
    if game.is_discrete:
        ahead = game.discount * exact.P @ game.E
        cross = game.B.T @ ahead
        of_disturbance = of_disturbance + game.E.T @ ahead
    H = np.block([[price, cross], [cross.T, of_disturbance]])
    at_rest = np.array(policy(equilibrium)).ravel() + exact.K @ equilibrium

    def cost(z: ca.SX) -> ca.SX:
        away = policy(z) + ca.DM(exact.K) @ z - ca.DM(at_rest)
        both = ca.vertcat(away, ca.DM(M) @ (z - ca.DM(equilibrium)))
        return ca.bilin(ca.DM(H), both, both)

    return cost


def flow_loop(
    z: ca.SX,
    rates: ca.SX,
    exact: Solution,
    tick: float,
    b: np.ndarray,
    running: Callable[[np.ndarray], Expression] | None = None,
    *,
    is_slow: bool = False,
) -> Loop:
    """Return the closed loop z' = rates(z), cost' = running(z), integrated with LSODA.

    exact: exact solution, whose P measures convergence
    tick: duration of a tick, s
    b: half-widths of the box of states, (n,)
    running: equilibrium -> function z -> cost rate, 0 at the equilibrium, or None without a cost
    is_slow: whether the rates are slow to evaluate
    """
    equilibrium = newton_equilibrium(z, rates, b)
    cost = type(z)(0.0)
    if running is not None and equilibrium is not None:
        cost = running(equilibrium)(z)
    value = ca.bilin(ca.DM(exact.P), z, z)
    slopes = ca.Function("slopes", [z], [ca.densify(ca.vertcat(rates, cost)), value])
    both = type(z).sym("both", z.numel() + 1)
    rate = ca.Function("rate", [both], list(slopes(both[: z.numel()])))
    largest = FAR_OF_VALUE * float(b @ np.abs(exact.P) @ b)
    most_steps = FEW_STEPS if is_slow or not isinstance(rates, ca.SX) else STEPS
    ticks = FlowTicks(rate, tick, largest, most_steps)
    return Loop(ticks, first=(0.0,), P=exact.P, equilibrium=equilibrium, largest=largest)


def step_loop(
    x: ca.SX,
    after: ca.SX,
    exact: Solution,
    by_exact: np.ndarray,
    b: np.ndarray,
    running: Callable[[np.ndarray], Expression] | None = None,
) -> Loop:
    """Return the closed loop x⁺ = after(x) with cost Σ αᵏ running(x_k).

    exact: exact solution, with P and the discount factor α
    by_exact: A - B K* of the exact loop, (n, n)
    b: half-widths of the box of states, (n,)
    running: equilibrium -> function x -> cost of a step, or None without a cost
    """
    equilibrium = newton_equilibrium(x, after - x, b)
    paid = type(x)(0.0)
    if running is not None and equilibrium is not None:
        paid = running(equilibrium)(x)
    n = x.numel()
    step = ca.Function("step", [x], [ca.densify(after), ca.densify(paid)])
    state = type(x).sym("state", n + 2)  # x, the sum so far, and αᵏ
    x_after, cost = step(state[:n])
    total, weight = state[n] + state[n + 1] * cost, exact.game.discount * state[n + 1]
    later = ca.Function("later", [state], [ca.vertcat(x_after, total, weight)])
    return Loop(
        StepTicks(later, is_slow=isinstance(x, ca.MX)),
        first=(0.0, 1.0),
        P=exact.P,
        equilibrium=equilibrium,
        largest=FAR_OF_VALUE * float(b @ np.abs(exact.P) @ b),
        by_exact=by_exact,
    )


def newton_equilibrium(z: ca.SX, rates: ca.SX, b: np.ndarray) -> np.ndarray | None:
    """Return the equilibrium z (n,) that Newton's method finds from z = 0, or None.

    The result is None without convergence. The iterates must stay within |z_i| <= `_FARTHEST_REST`
    b_i.

    z: symbols, (n,)
    rates: expression of z', or of x⁺ - x, in these symbols, (n,)
    b: half-widths of the box, (n,)
    """
    step = ca.Function("step", [z], [rates, ca.jacobian(rates, z)])
    point = np.zeros(len(b))
    for _ in range(_NEWTON_STEPS):
        rate, jacobian = (np.array(part) for part in step(point))
        if not (np.all(np.isfinite(rate)) and np.all(np.isfinite(jacobian))):
            return None
        try:
            change = np.linalg.solve(jacobian, rate.ravel())
        except np.linalg.LinAlgError:
            return None
        point = point - change
        if np.any(np.abs(point) > _FARTHEST_REST * b):
            return None
        if np.all(np.abs(change) <= 1e-12 * b):
            return point
    return None
