"""Checks of a solution: the cost of its policies, and their L2 gain computed by two methods."""

from __future__ import annotations

import math
import warnings

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.double_double import (
    add,
    exact,
    product,
    product_of_doubles,
    transposed,
)
from controller.riccati.frequency_response import (
    TOLERANCE,
    bounded_real_gain,
    closed_loop,
    peak_gain,
)
from controller.riccati.gain_sweep import swept_gain
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_most, below

#: Largest error of the cost, relative to |z0|² |P|: z0'P z0 itself may be 0.
COST_TOLERANCE = 1e-8
#: Number of corrections of a cost by residuals in twice the precision.
REFINEMENTS = 3
#: Largest relative error of the sweep, which can miss a peak but not exceed it.
SWEEP_TOLERANCE = 1e-6


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


def cost_matrix(game: Game, K: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Return X, (n, n), such that u = -K z and d = L z cost z0'X z0 from the initial state z0.

    F'X + X F + Q - N K - K'N' + K'R K - δ² L'L = 0,  F = A - B K + E L.

    game: the game, with the cost and the plant
    K: (m, n)
    L: (k, n)

    X is refined with residuals in twice the precision. Near the smallest delta, F is nearly
    unstable, and rounding of the equation would hide the cost.

    Raises NoSolutionError if F is not Hurwitz. The cost is then not finite.
    """
    from scipy.linalg import solve_continuous_lyapunov

    moved = add(product_of_doubles(-game.B, K), product_of_doubles(game.E, L))
    loop = add(exact(game.A), moved)
    abscissa = spectrum(loop[0]).abscissa
    if abscissa >= 0.0:
        raise NoSolutionError(
            f"A - B K + E L has abscissa {abscissa:+.4g} 1/s: these policies have infinite cost"
        )
    paid = product(product_of_doubles(K.T, game.R), exact(K))
    mixed = product_of_doubles(-game.N, K)
    cost = add(add(exact(game.Q), paid), add(mixed, transposed(mixed)))
    if math.isfinite(game.delta):
        weighted = product_of_doubles(game.delta * np.eye(len(L)), L)
        earned = product(transposed(weighted), weighted)
        cost = add(cost, (-earned[0], -earned[1]))
    X = np.zeros_like(game.A)
    for _ in range(1 + REFINEMENTS):
        linear = product(exact(X), loop)
        residual = add(add(linear, transposed(linear)), cost)[0]
        with warnings.catch_warnings(action="ignore"):  # SciPy warns near the axis
            change = solve_continuous_lyapunov(loop[0].T, -residual)
        X = X + (change + change.T) / 2.0
    return X


def cost_check(game: Game, P: np.ndarray, initial: np.ndarray) -> Check:
    """Return the check that the cost of the policies of P, from a Lyapunov equation, is z0'P z0.

    The check fails with the value inf if the policies of P are not stabilizing.

    game: the game
    P: (n, n)
    initial: initial state z0, (n,)
    """
    K = game.gain(P)
    L = game.disturbance_gain(P)
    name = "cost_lyapunov"
    try:
        cost = float(initial @ cost_matrix(game, K, L) @ initial)
    except NoSolutionError:
        reason = "the policies of P are not stabilizing: their cost is not finite"
        return at_most(name, math.inf, COST_TOLERANCE, reason)
    claimed = float(initial @ P @ initial)
    size = float(initial @ initial) * float(np.linalg.norm(P, 2))
    error = abs(cost - claimed) / max(size, np.finfo(float).tiny)
    reason = f"the policies of P cost {cost:.10g}, but P predicts {claimed:.10g}"
    return at_most(name, error, COST_TOLERANCE, reason)


def gain_checks(game: Game, K: np.ndarray) -> tuple[Check, ...]:
    """Return the checks that the L2 gain of u = -K z is below delta, and that two methods agree on
    the gain.

    If A - B K is not Hurwitz, only a failed check of the L2 gain is returned.

    game: the game
    K: (m, n)
    """
    gain = bounded_real_gain(game, K)
    if math.isinf(gain):
        reason = "A - B K is not Hurwitz: the closed loop has no finite L2 gain"
        return (below("l2_gain", gain, game.delta, reason),)
    loop, E, C = closed_loop(game, K)
    if game.delta <= gain <= game.delta * (1.0 + 2.0 * TOLERANCE):  # an upper bound
        gain = peak_gain(loop, E, C, np.zeros((len(C), E.shape[1])), game.delta)
    swept = swept_gain(loop, E, C)
    difference = abs(swept.gain - gain)
    if gain > 0.0:
        difference /= gain
    too_large = f"the L2 gain {gain:.6g} of the closed loop is not below delta = {game.delta:.6g}"
    apart = (
        f"the sweep gives {swept.gain:.9g} at {swept.frequency:.4g} rad/s,"
        f" the bounded-real lemma {gain:.9g}"
    )
    return (
        below("l2_gain", gain, game.delta, too_large),
        at_most("l2_gain_methods_agree", difference, SWEEP_TOLERANCE, apart),
    )
