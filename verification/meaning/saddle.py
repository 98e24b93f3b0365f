"""Is (u*, d*) a saddle point: does each player lose by leaving its policy alone, and to second order only?"""

from __future__ import annotations

import math

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.reporting.checks import Check, at_least, at_most
from hfa_model.support.errors import BadInputError
from verification.meaning.cost import cost_matrix, simulated_cost
from verification.riccati.spectrum import is_hurwitz

#: The larger perturbation changes the cost by about this fraction, the smaller is `RATIO` times smaller.
CHANGE = 1e-6
RATIO = 8.0
SLOPE_TOLERANCE = 0.05
DIRECTIONS = 3
#: Where the search for ε stops when a player cannot change the cost at all.
LARGEST_STEP = 1e12


def saddle_checks(
    game: Game, P: np.ndarray, initial: np.ndarray, seed: int, change: float = CHANGE
) -> tuple[Check, ...]:
    """J(K + εΔ, L) - J(K, L) = +c ε² and J(K, L + εΔ) - J(K, L) = -c ε², c > 0, in random directions Δ.

    P: (n, n), whose policies are K = R⁻¹B'P and L = δ⁻²E'P; initial z(0): (n,). The costs are compared at two ε
    a factor 8 apart; the slope log(ratio of changes)/log 8 is 2 at a saddle point and 1 away from it. change: of
    the cost at the larger ε, relative, and about the relative error of P that hides under it: at 1e-6, errors of 1e-6
    pass and most of 1e-5 do not. Near delta_min a change of 1e-4 is too large to be a parabola.
    With delta = inf, or an E without columns, there is no second player, and only the control is perturbed.
    Raises BadInputError when the flight from `initial` costs nothing.
    """
    K, L = game.gain(P), game.disturbance_gain(P)
    if not is_hurwitz(game.A - game.B @ K + game.E @ L):
        reason = "the policies of P do not bring the state to rest: there is no cost to compare"
        return (at_most("saddle_finite_cost", math.inf, 0.0, reason),)
    base = simulated_cost(game, K, L, initial)
    if base == 0.0:
        raise BadInputError("the flight from this initial state costs nothing; choose another initial state")
    rng = np.random.default_rng(seed)
    control = [(step, np.zeros_like(L)) for step in rng.standard_normal((DIRECTIONS, *K.shape))]
    checks = _judge("control", np.array([_changes(game, P, step, initial, base, change) for step in control]))
    if math.isfinite(game.delta) and L.size > 0:
        disturbance = [(np.zeros_like(K), step) for step in rng.standard_normal((DIRECTIONS, *L.shape))]
        losses = -np.array([_changes(game, P, step, initial, base, change) for step in disturbance])
        checks += _judge("disturbance", losses)
    return checks


def _judge(player: str, losses: np.ndarray) -> tuple[Check, ...]:
    """losses: (directions, 2), relative changes against the player at the large and the small perturbation."""
    least = float(losses.min())
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.log(np.abs(losses[:, 0] / losses[:, 1])) / math.log(RATIO)
    farthest = float(slopes[np.argmax(np.abs(slopes - 2.0))])
    return (
        at_least(
            f"saddle_{player}_loses",
            least,
            0.0,
            f"the {player} gains by leaving the policy of P (relative change {least:.3g})",
        ),
        at_most(
            f"saddle_{player}_slope_error",
            abs(farthest - 2.0),
            SLOPE_TOLERANCE,
            f"the cost changes with order {farthest:.3g} in the {player}, not 2",
        ),
    )


def _changes(
    game: Game, P: np.ndarray, step: tuple[np.ndarray, np.ndarray], initial: np.ndarray, base: float, change: float
) -> tuple[float, float]:
    """Relative changes of the cost at ε and ε/8, the largest ε = 2^k that changes it by at most `change`."""
    K, L = game.gain(P), game.disturbance_gain(P)

    def is_small(size: float) -> bool:
        control, disturbance = K + size * step[0], L + size * step[1]
        if not is_hurwitz(game.A - game.B @ control + game.E @ disturbance):
            return False
        return abs(float(initial @ cost_matrix(game, control, disturbance) @ initial) / base - 1.0) <= change

    size = 1.0
    while size < LARGEST_STEP and is_small(size):
        size *= 2.0
    while not is_small(size):
        size /= 2.0
    first, second = (
        simulated_cost(game, K + part * step[0], L + part * step[1], initial) / base - 1.0
        for part in (size, size / RATIO)
    )
    return first, second
