"""Closed loops of critics that are not quadratic, on the linear and on the nonlinear plant.

A policy u has the cost J = V* + ∫ (u - u*)' price (u - u*) - δ² (d - d*)'(d - d*) dt, or the sum
over the steps. The worst disturbance of u = -K z is d = d* + δ⁻² E'X z in continuous time. In
discrete time, costs are those under d*.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.symbols import symbols_for
from controller.riccati.balancing import stability
from controller.riccati.gare import Solution
from hfa_aircraft.march.ending import FAR_OF_VALUE, OF_EXACT, OF_VALUE, EndRule, has_decayed
from hfa_aircraft.march.march import Free, march
from hfa_aircraft.march.steppers import Adaptive, Recurrence, Stepper
from hfa_support.matrices import quadratic_forms
from verification.plant import NonlinearPlant

#: A simulation ends when the exact loop has decayed to exp(-`DECAY`).
DECAY = 5.0
#: It ends later for a slower linear loop, but not later than this many times the time of the exact
#: loop.
SLOWEST = 100.0
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
    """End of a simulation that converges.

    z: state minus the equilibrium, (n,)
    cost: cost until then
    discount: discount of the cost after the end
    """

    z: np.ndarray
    cost: float
    discount: float


@dataclass(frozen=True, eq=False)
class Loop:
    """Closed loop of z and of its cost, which converges if V* = z'Pz decreases to `OF_VALUE`.

    stepper: integration of [z; cost], in discrete time of [z; cost; discount αᵏ]
    steps: number of steps
    first: initial cost and discount
    P: matrix of V*, (n, n)
    equilibrium: equilibrium near z = 0, or None if none is found
    largest: V* above which the loop diverges
    by_exact: state-transition matrix of the exact loop in discrete time, (n, n), or None. V* may
        also decrease to `OF_EXACT` times that of the exact loop
    """

    stepper: Stepper
    steps: int
    first: tuple[float, ...]
    P: np.ndarray
    equilibrium: np.ndarray | None
    largest: float
    by_exact: np.ndarray | None = None

    def simulate(self, start: np.ndarray) -> End | None:
        """Simulate the loop from the initial state `start` (n,).

        The result is None if the loop has no equilibrium, diverges or does not converge, or if the
        integration fails.
        """
        if self.equilibrium is None:
            return None
        n = len(start)
        any_state = np.finfo(float).max  # `largest` decides
        rule = EndRule(any_state, lambda x: self._values(x) <= self.largest)
        loop = Free(self.stepper, np.append(start, self.first)[None])
        with np.errstate(all="ignore"):
            ticks = math.ceil(self.steps / self.stepper.steps)
            flown, ends = march(loop, ticks, over=rule.over)
        final = flown.states[0, min(ends[0], self.steps)]
        z_end, (cost, *discount) = final[:n], final[n:].tolist()  # [z; cost; discount]
        if rule.is_over(final[None])[0]:
            return None
        z = z_end - self.equilibrium
        begin = start - self.equilibrium
        value, initial = self._values(np.vstack([z, begin]))
        converges = has_decayed(value, initial, OF_VALUE)
        if self.by_exact is not None:
            exact = self._values((self.by_exact @ begin)[None])[0]
            converges |= has_decayed(value, exact, OF_EXACT)
        return End(z, cost, *(discount or [1.0])) if converges else None

    def _values(self, states: np.ndarray) -> np.ndarray:
        """Return V* of each of the states (N, n and more), (N,)."""
        return quadratic_forms(states[:, : len(self.P)], self.P)


def undisturbed_loop(exact: Solution, critic: Critic, b: np.ndarray) -> Loop:
    """Return the closed loop without disturbance.

    b: half-widths of the box of states, (n,)
    """
    return _loop_of(exact, exact.game.A, critic, b)


def worst_loop(exact: Solution, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
    """Return the closed loop under the disturbance of u = -K z, the critic's linear part.

    The cost is J - V*. Inputs and disturbances count from their values at the equilibrium.

    b: half-widths of the box of states, (n,)
    X: (n, n), with J - V* = z'X z for u = -K z
    """
    game = exact.game
    L_above_exact = np.zeros_like(exact.disturbance_gain)
    if not game.is_discrete and math.isfinite(game.delta):
        L_above_exact = game.disturbance_gain(X)

    def running(equilibrium: np.ndarray) -> Expression:
        paid = excess_cost_rate(critic.policy, exact.K, exact.price, equilibrium)
        if not L_above_exact.any():
            return paid
        gained = ca.DM(game.delta * L_above_exact)
        rest = ca.DM(equilibrium)
        return lambda z: paid(z) - ca.sumsqr(gained @ (z - rest))

    A = game.A + game.E @ (exact.disturbance_gain + L_above_exact)
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
    return flow_loop(z, plant.closed(z, u), exact, _duration(exact, *own), b, is_slow=True)


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
        steps = min(math.ceil(_duration(exact, linear)), STEPS)
        by_exact = A - game.B @ exact.K
        return step_loop(z, next_state, exact, by_exact, steps, b, running)
    z = critic.symbols
    rate = ca.DM(A) @ z + ca.DM(game.B) @ critic.policy(z)
    undisturbed = game.A - game.B @ critic.K
    return flow_loop(z, rate, exact, _duration(exact, undisturbed, linear), b, running)


def _duration(exact: Solution, *loops: np.ndarray) -> float:
    """Return the duration of a simulation, s or steps, in which the exact loop and linear loops
    decay.

    In continuous time, loops count as at most SLOWEST times slower than the exact one. In discrete
    time, the caller limits the number of steps.

    loops: stable matrices, (n, n)
    """
    game = exact.game
    discrete = game.is_discrete

    def rate(loop: np.ndarray) -> float:
        value = stability(loop, is_discrete=discrete).value
        return -math.log(min(max(value, 1e-3), 1.0 - 1e-12)) if discrete else abs(value)

    by_exact = rate(game.A - game.B @ exact.K)
    slowest = min([by_exact, *map(rate, loops)])
    return DECAY / (slowest if discrete else max(slowest, by_exact / SLOWEST))


def excess_cost_rate(
    policy: ca.Function, K: np.ndarray, price: np.ndarray, equilibrium: np.ndarray
) -> Expression:
    """Return the rate at which a policy costs more than the exact policy, as z -> v' price v.

    v = u(z) + K z - (u(e) + K e) is the deviation from the exact policy, minus its value at the
    equilibrium e.

    K: gain of the exact policy u* = -K z
    price: price of the inputs of the game, `Solution.price`, (m, m)
    equilibrium: equilibrium of the loop, (n,)
    """
    at_rest = np.array(policy(equilibrium)).ravel() + K @ equilibrium

    def cost(z: ca.SX) -> ca.SX:
        away = policy(z) + ca.DM(K) @ z - ca.DM(at_rest)
        return ca.bilin(ca.DM(price), away, away)

    return cost


def flow_loop(
    z: ca.SX,
    rates: ca.SX,
    exact: Solution,
    time: float,
    b: np.ndarray,
    running: Callable[[np.ndarray], Expression] | None = None,
    *,
    is_slow: bool = False,
) -> Loop:
    """Return the closed loop z' = rates(z), cost' = running(z), integrated with LSODA.

    exact: exact solution, whose P measures convergence
    time: duration of a simulation, s
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
    stepper = Adaptive(rate, time, largest=largest, most_steps=most_steps)
    return Loop(stepper, steps=1, first=(0.0,), P=exact.P, equilibrium=equilibrium, largest=largest)


def step_loop(
    x: ca.SX,
    after: ca.SX,
    exact: Solution,
    by_exact: np.ndarray,
    steps: int,
    b: np.ndarray,
    running: Callable[[np.ndarray], Expression] | None = None,
) -> Loop:
    """Return the closed loop x⁺ = after(x) with cost Σ αᵏ running(x_k).

    exact: exact solution, with P and the discount factor α
    by_exact: A - B K* of the exact loop, (n, n)
    steps: number of steps
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
    stepper = Recurrence(later, 1 if isinstance(x, ca.MX) else min(steps, _PER_TICK))
    return Loop(
        stepper,
        steps=steps,
        first=(0.0, 1.0),
        P=exact.P,
        equilibrium=equilibrium,
        largest=FAR_OF_VALUE * float(b @ np.abs(exact.P) @ b),
        by_exact=np.linalg.matrix_power(by_exact, steps),
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
