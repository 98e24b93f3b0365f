"""Closed loops of critics that are not quadratic, on the linear and on the nonlinear plant.

A policy u has the cost J = V* + ∫ (u - u*)' price (u - u*) - δ² (d - d*)'(d - d*) dt, or the sum
over the steps. The worst disturbance of u = -K z is d = d* + δ⁻² E'X z in continuous time. In
discrete time, costs are those under d*.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.symbols import symbols_for
from controller.riccati.balancing import stability
from controller.riccati.gare import Solution
from verification.axis import (
    DECAY,
    SLOWEST,
    STEPS,
    Expression,
    Loop,
    excess_cost_rate,
    flow_loop,
    step_loop,
)
from verification.scope import NonlinearPlant


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
