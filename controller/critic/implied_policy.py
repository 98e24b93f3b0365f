"""Policy implied by a discrete-time value V: optimal for one step, followed by the cost V."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from controller.critic.symbols import symbols_for
from controller.game.zero_sum import Game

#: Newton's method: largest number of steps, and largest permitted residual. The residual is
#: relative to the terms, which vanish at the trim, but at least to those at the edge of the box, or
#: at states with the value 1 if the box is unknown.
_STEPS = 20
_LEFT = 1e-9


def policy_of_next(problem: Game, gradient: ca.Function, P: np.ndarray) -> ca.Function:
    """Return the policy x (n,) -> u (m,) that is optimal for one step, followed by the cost V.

    u and w are the saddle point of the cost. With g = ∂V/∂x at the next state, they satisfy

      R u + N'x + ½ α B'g = 0,  -δ² w + ½ α E'g = 0

    With δ = inf, w is 0. u is NaN if Newton's method, started at u = -K x and w = L x of the
    quadratic part of V, does not converge.

    problem: the discrete-time game
    gradient: function x (n,) -> ∂V/∂x (n,)
    P: quadratic part of V, (n, n)
    """
    n, m = problem.B.shape
    K, L = problem.policies(P)
    gains = -K
    columns = problem.B
    price = problem.R
    cross = problem.N.T
    if math.isfinite(problem.delta):  # with w multiplied by delta as unknown
        k = problem.E.shape[1]
        gains = np.vstack([gains, problem.delta * L])
        columns = np.hstack([columns, problem.E / problem.delta])
        price = np.block([[price, np.zeros((m, k))], [np.zeros((k, m)), -np.eye(k)]])
        cross = np.vstack([cross, np.zeros((k, n))])
    costly = np.diag(P) > 0.0
    sizes = np.abs(gains[:, costly]) @ np.diag(P)[costly] ** -0.5  # of states with the value 1
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    x = symbols_for([gradient], n)
    scaled = symbols_for([gradient], len(gains))
    a = ca.DM(sizes) * scaled
    paid = ca.DM(price) @ a
    crossed = ca.DM(cross) @ x
    after = ca.DM(problem.A) @ x + ca.DM(columns) @ a
    valued = 0.5 * problem.discount * (ca.DM(columns).T @ gradient(after))
    units = ca.DM(np.abs(np.diag(price)) * sizes)
    slope = ca.densify((paid + crossed + valued) / units)
    terms = (ca.fabs(paid) + ca.fabs(crossed) + ca.fabs(valued)) / units
    box = 1.0
    if problem.half_widths is not None:
        box = float(np.max(np.sqrt(np.diag(P).clip(0.0)) * problem.half_widths)) or 1.0
    left = ca.mmax(ca.fabs(slope)) / ca.fmax(ca.mmax(terms), box)
    options = {"max_iter": _STEPS, "error_on_fail": False, "show_eval_warnings": False}
    root = ca.rootfinder("root", "newton", {"x": scaled, "p": x, "g": slope}, options)
    state = ca.MX.sym("x", n)
    found = root(x0=ca.DM(gains / sizes[:, None]) @ state, p=state)["x"]
    is_found = ca.Function("left", [x, scaled], [left])(state, found) <= _LEFT
    u = ca.DM(sizes[:m]) * found[:m]
    return ca.Function("policy", [state], [ca.if_else(is_found, 1.0, math.nan) * u])
