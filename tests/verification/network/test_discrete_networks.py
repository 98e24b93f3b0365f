"""Checks of networks and of other nonquadratic values in discrete time."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from game_samples import in_steps

from hfa import Game, from_network, solve

pytestmark = pytest.mark.usefixtures("folder")
A = np.array([[1.02, 0.1], [0.1, 1.0]])
B = np.array([[0.0], [0.1]])
Z = ca.SX.sym("z", 2)


def problem_of(delta=20.0, discount=1.0, N=0.0):
    """Return a game in discrete time, whose cross weights are all N."""
    step = Game(A, B, E=0.1 * np.eye(2), Q=np.eye(2), R=np.eye(1), delta=delta)
    return in_steps(replace(step, N=np.full((2, 1), N)), discount)


def critic_of(problem, **outputs):
    """Return the critic of expressions in `Z`, "V" or "policy" -> expression."""
    function = ca.Function("planted", [Z], [ca.densify(ca.vertcat(*outputs.values()))])
    return from_network(problem, function, network="+".join(outputs))


def test_the_implied_policy_is_a_saddle_point():
    """The policy implied by a nonquadratic value V at a state x is the u of a saddle point of
    Q(u, w) = cost of the step + α V(after it).

    Q with the worst w is lower at u than at u ± 0.001.
    """
    problem = problem_of(delta=20.0, discount=0.95, N=0.2)
    P = solve(problem).P
    value = ca.bilin(ca.DM(P), Z, Z) + 2e4 * Z[0] ** 4
    V = ca.Function("V", [Z], [value])
    critic = critic_of(problem, V=value)
    u = ca.SX.sym("u")
    w = ca.SX.sym("w", 2)
    x = np.array([0.4, -0.3])
    after = ca.DM(A) @ x + ca.DM(B) @ u + ca.DM(problem.E) @ w
    paid = float(x @ problem.Q @ x) + 2.0 * float(x @ problem.N[:, 0]) * u + u**2
    Q = paid - problem.delta**2 * ca.sumsqr(w) + 0.95 * V(after)
    worst = ca.rootfinder("worst", "newton", {"x": w, "p": u, "g": ca.gradient(Q, w)})
    cost = ca.Function("cost", [u, w], [Q])
    best = float(critic.policy(x))
    costs = [float(cost(best + d, worst(x0=[0, 0], p=best + d)["x"])) for d in (-1e-3, 0.0, 1e-3)]
    assert costs[1] < min(costs[0], costs[2])
