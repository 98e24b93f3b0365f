"""Policy implied by a discrete-time value V: optimal for one step, followed by the cost V."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, symbols_for
from controller.game.discrete_game import DiscreteGame
from controller.riccati.normal_form import NormalForm

#: Newton's method: largest number of steps, and largest permitted residual relative to the terms.
_STEPS = 20
_LEFT = 1e-9


def discrete_critic(problem: DiscreteGame, critic: Critic) -> Critic:
    """Return the critic with the policy that its value V implies in discrete time.

    - A critic without a value, or with an explicit policy, is returned unchanged.
    - If V is quadratic, or if the critic contains a number that is not finite, the policy is
      linear, u = -K x.
    - Otherwise V, ∂V/∂x and the nonlinear policy u are stored as CasADi functions in `network`.

    The critic may have been made for the matrices of one step, as a game in continuous time.
    """
    if critic.P is None or critic.feedback is None:
        return critic
    K, L = problem.policies((critic.P + critic.P.T) / 2.0)
    critic = replace(critic, K=K)
    network = dict(critic.network)
    if critic.is_quadratic or not critic.finite:
        return critic
    assert critic.gradient is not None  # not quadratic: with weights, or a network of V
    if not network:
        assert critic.value is not None  # as above
        network = {"V": critic.value, "gradient": critic.gradient}
    network["policy"] = policy_of_next(problem, critic.gradient, K, L)
    return replace(critic, feedback=None, network=network, implies_policy=True)


def policy_of_next(
    problem: DiscreteGame, gradient: ca.Function, K: np.ndarray, L: np.ndarray
) -> ca.Function:
    """Return the policy x (n,) -> u (m,) that is optimal for one step, followed by the cost V.

    u and w are the saddle point of the cost. With g = ∂V/∂x at the next state, they satisfy

      R u + N'x + ½ α B'g = 0,  -δ² w + ½ α E'g = 0

    With δ = inf, w is 0. u is NaN if Newton's method, started at u = -K x and w = L x, does not
    converge.

    problem: the discrete-time game
    gradient: function x (n,) -> ∂V/∂x (n,)
    K: gain for the quadratic part of V, (m, n)
    L: disturbance gain for the quadratic part of V, (k, n)
    """
    step = problem.step
    n, m = step.B.shape
    gains = -K
    columns = step.B
    price = step.R
    cross = step.N.T
    if math.isfinite(step.delta):  # with w multiplied by delta as unknown
        k = step.E.shape[1]
        gains = np.vstack([gains, step.delta * L])
        columns = np.hstack([columns, step.E / step.delta])
        price = np.block([[price, np.zeros((m, k))], [np.zeros((k, m)), -np.eye(k)]])
        cross = np.vstack([cross, np.zeros((k, n))])
    sizes = np.abs(gains) @ NormalForm.of(step).units
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    x = symbols_for([gradient], n)
    scaled = symbols_for([gradient], len(gains))
    a = ca.DM(sizes) * scaled
    paid = ca.DM(price) @ a
    crossed = ca.DM(cross) @ x
    after = ca.DM(step.A) @ x + ca.DM(columns) @ a
    valued = 0.5 * problem.discount * (ca.DM(columns).T @ gradient(after))
    units = ca.DM(np.abs(np.diag(price)) * sizes)
    slope = ca.densify((paid + crossed + valued) / units)
    terms = (ca.fabs(paid) + ca.fabs(crossed) + ca.fabs(valued)) / units
    left = ca.mmax(ca.fabs(slope)) / ca.fmax(ca.mmax(terms), sys.float_info.min)
    options = {"max_iter": _STEPS, "error_on_fail": False, "show_eval_warnings": False}
    root = ca.rootfinder("root", "newton", {"x": scaled, "p": x, "g": slope}, options)
    state = ca.MX.sym("x", n)
    found = root(x0=ca.DM(gains / sizes[:, None]) @ state, p=state)["x"]
    is_found = ca.Function("left", [x, scaled], [left])(state, found) <= _LEFT
    u = ca.DM(sizes[:m]) * found[:m]
    return ca.Function("policy", [state], [ca.if_else(is_found, 1.0, math.nan) * u])
