"""Policy implied by a discrete-time value V: optimal for one step, followed by the cost V."""

from __future__ import annotations

import math
from typing import NamedTuple

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
    m = problem.B.shape[1]
    actions = _actions(problem, P)
    x = symbols_for([gradient], len(problem.A))
    scaled = symbols_for([gradient], len(actions.sizes))
    a = ca.DM(actions.sizes) * scaled
    after = ca.DM(problem.A) @ x + ca.DM(actions.columns) @ a
    # half the slopes, along the actions, of their cost, of the cross terms and of the value after
    # the step, in units of the price of an action times its size
    of_price = ca.DM(actions.price) @ a
    of_cross = ca.DM(actions.cross) @ x
    of_value = 0.5 * problem.discount * (ca.DM(actions.columns).T @ gradient(after))
    units = ca.DM(np.abs(np.diag(actions.price)) * actions.sizes)
    slope = ca.densify((of_price + of_cross + of_value) / units)
    terms = (ca.fabs(of_price) + ca.fabs(of_cross) + ca.fabs(of_value)) / units
    residual = ca.mmax(ca.fabs(slope)) / ca.fmax(ca.mmax(terms), _root_of_value_at_edge(problem, P))
    # `root` can be called with MX only
    options = {"max_iter": _STEPS, "error_on_fail": False, "show_eval_warnings": False}
    root = ca.rootfinder("root", "newton", {"x": scaled, "p": x, "g": slope}, options)
    state = ca.MX.sym("x", len(problem.A))
    start = ca.DM(actions.gains / actions.sizes[:, None]) @ state
    saddle = root(x0=start, p=state)["x"]
    has_converged = ca.Function("residual", [x, scaled], [residual])(state, saddle) <= _LEFT
    u = ca.DM(actions.sizes[:m]) * saddle[:m]
    return ca.Function("policy", [state], [ca.if_else(has_converged, 1.0, math.nan) * u])


def _root_of_value_at_edge(problem: Game, P: np.ndarray) -> float:
    """Return the largest sqrt(x'P x) of one state at the edge of the box, 1 without a box."""
    if problem.half_widths is None:
        return 1.0
    return float(np.max(np.sqrt(np.diag(P).clip(0.0)) * problem.half_widths)) or 1.0


class _Actions(NamedTuple):
    """The actions a = (u, δ w) of a step, or u alone without disturbance: x⁺ = A x + columns a.

    columns: [B E/δ], (n, k)
    price: weights of a in the cost, (k, k)
    cross: weights of a with x in the cost, (k, n)
    gains: policy a = gains x of the quadratic part of V, (k, n)
    sizes: sizes of the actions at states with the value 1, (k,)
    """

    columns: np.ndarray
    price: np.ndarray
    cross: np.ndarray
    gains: np.ndarray
    sizes: np.ndarray


def _actions(problem: Game, P: np.ndarray) -> _Actions:
    """Return the actions of a step of a game, whose value begins with x'P x."""
    n, m = problem.B.shape
    K, L = problem.policies(P)
    columns, price, cross, gains = problem.B, problem.R, problem.N.T, -K
    if math.isfinite(problem.delta):
        k = problem.E.shape[1]
        columns = np.hstack([columns, problem.E / problem.delta])
        price = np.block([[price, np.zeros((m, k))], [np.zeros((k, m)), -np.eye(k)]])
        cross = np.vstack([cross, np.zeros((k, n))])
        gains = np.vstack([gains, problem.delta * L])
    values = np.diag(P)
    costly = values > 0.0
    sizes = np.abs(gains[:, costly]) @ values[costly] ** -0.5
    return _Actions(columns, price, cross, gains, np.where(sizes > 0.0, sizes, 1.0))
