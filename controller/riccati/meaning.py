"""Checks of a solution: the cost of its policies, and their L2 gain computed by two methods."""

from __future__ import annotations

import math

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import stability
from controller.riccati.double_double import exact, product_of_doubles
from controller.riccati.form import LAST_CORRECTION
from controller.riccati.frequency_response import closed_loop, loop_gain, responses_at
from controller.riccati.lyapunov import Lyapunov
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_most, below

#: Largest error of the cost, relative to |z0|² |P|: z0'P z0 itself may be 0.
COST_TOLERANCE = 1e-8
#: Number of corrections of a cost by residuals in twice the precision.
REFINEMENTS = 3
#: Largest relative difference between the response at the peak and the bounded-real bound.
PEAK_TOLERANCE = 1e-6


def meaning_checks(game: Game, P: np.ndarray, initial: np.ndarray) -> tuple[Check, ...]:
    """Return the checks that the policies of P cost z0'P z0 and that the L2 gain of K is below
    delta.

    A further check compares two computations of the L2 gain. With delta = inf (no disturbance) any
    finite gain passes.

    game: the game
    P: (n, n), exact or learned
    initial: initial state z0, (n,)
    """
    return cost_check(game, P, initial), *gain_checks(game, game.gain(P))


def cost_matrix(
    game: Game, K: np.ndarray, L: np.ndarray, refinements: int = REFINEMENTS
) -> np.ndarray:
    """Return X, (n, n), such that u = -K z and d = L z cost z0'X z0 from the initial state z0.

    F'X + X F + C = 0,  F = A - B K + E L,  C = Q + K'R K - δ² L'L

    In discrete time, α F'X F - X + C = 0.

    game: the game, with the cost and the plant, without cross weights
    K: (m, n)
    L: (k, n)
    refinements: number of corrections by residuals in twice the precision. Near the smallest delta,
        F is nearly unstable, and rounding of the equation would hide the cost without them.

    Raises NoSolutionError if F (√α F) is not stable. The cost is then not finite.
    """
    root = math.sqrt(game.discount)
    loop = root * (game.A - game.B @ K + game.E @ L)
    size, limit = stability(loop, is_discrete=game.is_discrete)
    if not size < limit:
        raise NoSolutionError("A - B K + E L is not stable: these policies have infinite cost")
    equation = Lyapunov.of_steps(loop) if game.is_discrete else Lyapunov(loop)
    pair = np.vstack([np.eye(len(K.T)), -K])
    weighted = game.delta * L if math.isfinite(game.delta) else 0.0 * L
    X, _ = equation.solve(weighted.T @ weighted - pair.T @ game.weights @ pair)
    for _ in range(refinements):
        correction, _ = equation.solve(-_cost_residual(game, K, L, X))
        X = X + correction
        if np.abs(correction).max() <= LAST_CORRECTION * np.abs(X).max():
            break
    return X


def _cost_residual(game: Game, K: np.ndarray, L: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return the residual of the equation of `cost_matrix`, (n, n), in twice the precision."""
    root = math.sqrt(game.discount)
    moved = product_of_doubles(-root * game.B, K) + product_of_doubles(root * game.E, L)
    loop = exact(root * game.A) + moved
    cost = exact(game.Q) + product_of_doubles(K.T, game.R) @ exact(K)
    if math.isfinite(game.delta):
        weighted = product_of_doubles(game.delta * np.eye(len(L)), L)
        cost = cost + -(weighted.mT @ weighted)
    moved = exact(X) @ loop
    change = loop.mT @ moved + exact(-X) if game.is_discrete else moved + moved.mT
    return (change + cost).high


def cost_check(game: Game, P: np.ndarray, initial: np.ndarray) -> Check:
    """Return the check that the cost of the policies of P, from a Lyapunov equation, is z0'P z0.

    The check fails with the value inf if the policies of P are not stabilizing.

    game: the game
    P: (n, n)
    initial: initial state z0, (n,)
    """
    K, L = game.policies(P)
    name = "cost_lyapunov"
    claimed = float(initial @ P @ initial)
    size = float(initial @ initial) * float(np.linalg.norm(P))
    for refinements in (0, REFINEMENTS):
        try:
            cost = float(initial @ cost_matrix(game, K, L, refinements) @ initial)
        except NoSolutionError:
            reason = "the policies of P are not stabilizing: their cost is not finite"
            return at_most(name, math.inf, COST_TOLERANCE, reason)
        error = abs(cost - claimed) / max(size, np.finfo(float).tiny)
        if error <= 0.1 * COST_TOLERANCE:
            break
    reason = f"the policies of P cost {cost:.10g}, but P predicts {claimed:.10g}"
    return at_most(name, error, COST_TOLERANCE, reason)


def gain_checks(game: Game, K: np.ndarray) -> tuple[Check, ...]:
    """Return the checks that the L2 gain of u = -K z is below delta, and that two methods agree on
    the gain: the bounded-real lemma, and the response at one frequency.

    If A - B K is not stable, only a failed check of the L2 gain is returned.

    game: the game
    K: (m, n)
    """
    loop = closed_loop(game, K)
    low, gain, point = loop_gain(loop, is_discrete=game.is_discrete)
    if math.isinf(gain):
        reason = "A - B K is not stable: the closed loop has no finite L2 gain"
        return (below("l2_gain", gain, game.delta, reason),)
    if low < game.delta <= gain:  # the upper bound is not below delta, but the gain may be
        gain = low
    found = float(np.linalg.norm(loop.C @ responses_at(loop.A, loop.B, point), 2))
    difference = abs(found - gain) / gain if gain > 0.0 else found
    too_large = f"the L2 gain {gain:.6g} of the closed loop is not below delta = {game.delta:.6g}"
    apart = f"the response gives {found:.9g}, the bounded-real lemma {gain:.9g}"
    return (
        below("l2_gain", gain, game.delta, too_large),
        at_most("l2_gain_methods_agree", difference, PEAK_TOLERANCE, apart),
    )
