"""Checks of a solution: the cost of its policies, and their L2 gain."""

from __future__ import annotations

import math

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.bilinear import System
from controller.riccati.certificate import form_of
from controller.riccati.double_double import exact, product_of_doubles
from controller.riccati.form import LAST_CORRECTION, Form
from controller.riccati.frequency_response import loop_gain, scaled_root
from controller.riccati.lyapunov import Lyapunov
from hfa_support.reporting.checks import Check, at_most, below

#: Largest error of the cost, relative to |z0|² |P|: z0'P z0 itself may be 0.
COST_TOLERANCE = 1e-8
#: Relative rounding of an L2 gain.
ROUNDING = 1e-9
#: Number of corrections of a cost by residuals in twice the precision.
REFINEMENTS = 3


def meaning_checks(form: Form, X: np.ndarray) -> tuple[Check, ...]:
    """Return the checks that the policies of X cost y0'X y0, and that the L2 gain of K is below
    delta.

    With delta = inf (no disturbance) any finite gain passes.

    X: (n, n), certified solution
    """
    K, L = form.gains(X)
    return cost_check(form, X, K, L), gain_check(form, K)


def cost_check(form: Form, X: np.ndarray, K: np.ndarray, L: np.ndarray) -> Check:
    """Return the check that the cost of v = -K y and d = L y is y0'X y0 from y0 = (1, ..., 1).

    X: (n, n)
    K, L: (m, n) and (k, n), stabilizing
    """
    claimed = float(X.sum())
    for refinements in (0, REFINEMENTS):
        cost = float(cost_matrix(form, K, L, refinements).sum())
        error = abs(cost - claimed) / max(len(X) * float(np.linalg.norm(X)), np.finfo(float).tiny)
        if error <= 0.1 * COST_TOLERANCE:
            break
    reason = f"the policies of P cost {cost:.10g}, but P predicts {claimed:.10g}"
    return at_most("cost_lyapunov", error, COST_TOLERANCE, reason)


def cost_matrix(form: Form, K: np.ndarray, L: np.ndarray, refinements: int) -> np.ndarray:
    """Return C, (n, n), such that v = -K y and d = L y cost y0'C y0 from the initial state y0.

    F'C + C F + Q - N K - K'N' + K'R K - δ² L'L = 0,  F = A - B K + E L

    In discrete time, F'C F - C replaces F'C + C F.

    K, L: (m, n) and (k, n), stabilizing
    refinements: number of corrections by residuals in twice the precision. Near the smallest delta,
        F is nearly unstable, and rounding of the equation would hide the cost without them.
    """
    loop = form.A - form.inputs @ K + form.disturbance @ L
    equation = Lyapunov.of_steps(loop) if form.is_discrete else Lyapunov(loop)
    weighted = form.delta * L if math.isfinite(form.delta) else 0.0 * L
    crossed = form.N @ K
    C, _ = equation.solve(weighted.T @ weighted - form.Q - K.T @ form.R @ K + crossed + crossed.T)
    for _ in range(refinements):
        correction, _ = equation.solve(-_cost_residual(form, K, L, C))
        C = C + correction
        if np.abs(correction).max() <= LAST_CORRECTION * np.abs(C).max():
            break
    return C


def _cost_residual(form: Form, K: np.ndarray, L: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return the residual of the equation of `cost_matrix`, (n, n), in twice the precision."""
    moved = product_of_doubles(-form.inputs, K) + product_of_doubles(form.disturbance, L)
    loop = exact(form.A) + moved
    crossed = product_of_doubles(-form.N, K)
    cost = exact(form.Q) + product_of_doubles(K.T, form.R) @ exact(K) + (crossed + crossed.mT)
    if math.isfinite(form.delta):
        weighted = product_of_doubles(form.delta * np.eye(len(L)), L)
        cost = cost + -(weighted.mT @ weighted)
    after = exact(C) @ loop
    change = loop.mT @ after + exact(-C) if form.is_discrete else after + after.mT
    return (change + cost).high


def gain_check(form: Form, K: np.ndarray) -> Check:
    """Return the check that the L2 gain of v = -K y is below delta.

    K: (m, n)
    """
    low, gain = loop_gain(closed_loop(form, K), is_discrete=form.is_discrete)
    if low < form.delta * (1.0 + ROUNDING) and form.delta <= gain:  # it is delta within rounding
        gain = np.nextafter(form.delta, 0.0)
    reason = f"the L2 gain {gain:.6g} of the closed loop is not below delta = {form.delta:.6g}"
    if math.isinf(gain):
        reason = "A - B K is not stable: the closed loop has no finite L2 gain"
    return below("l2_gain", gain, form.delta, reason)


def closed_loop(form: Form, K: np.ndarray) -> System:
    """Return the closed loop of v = -K y from d to the root of the cost rate: (A - B K, E, C, 0),
    C'C = Q - N K - K'N' + K'R K.

    K: (m, n)
    """
    C = scaled_root(form.weights).T @ np.vstack([np.eye(len(form.A)), -K])
    nothing = np.zeros((len(C), form.disturbance.shape[1]))
    return System(form.A - form.inputs @ K, form.disturbance, C, nothing)


def bounded_real_gain(game: Game, K: np.ndarray) -> float:
    """Return the L2 gain sup ‖y‖₂/‖d‖₂ of the closed loop with u = -K z, ‖y‖² = ∫ z'Qz + 2z'Nu +
    u'Ru.

    In discrete time, signals are weighted by α^(k/2), as their squares are in the cost. The result
    is inf if the loop is not stable.

    K: (m, n)

    Raises BadInputError if K is not a real m x n matrix, and NoSolutionError as `loop_gain` does.
    """
    form = form_of(game)
    K = np.linalg.solve(form.V, game.checked_gain(K) - form.F)
    loop = closed_loop(form, K * form.units)
    return loop_gain(loop, is_discrete=form.is_discrete).high
