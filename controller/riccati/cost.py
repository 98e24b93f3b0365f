"""What a pair of linear policies costs, whether it is a saddle point, and what another gain loses
in flight.

At a saddle point each player loses by leaving its policy alone, and to second order only.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from controller.riccati.balancing import add, balanced_units, exact, is_hurwitz, product, spectrum
from controller.riccati.frequency_response import bounded_real_gain
from controller.riccati.gare import GameSolution
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.checks import Check, at_least, at_most

COST_TOLERANCE = 1e-8
#: Time constants of the slowest mode until a quadratic cost has spent all but e^-40 of itself.
TIME_CONSTANTS = 20.0
#: The larger perturbation changes the cost by about this fraction, the smaller is `RATIO` times
#: smaller.
CHANGE = 1e-6
RATIO = 8.0
SLOPE_TOLERANCE = 0.05
DIRECTIONS = 3
#: Where the search for ε stops when a player cannot change the cost at all.
LARGEST_STEP, SMALLEST_STEP = 1e12, 1e-30
#: An eigenvalue of P* below this part of the largest is that of a state that costs nothing.
SIGNLESS = 1e-12
#: Newton steps to the loss double their digits; from 0 they grow to it from below.
MAX_STEPS = 100


def cost_matrix(game: Game, K: np.ndarray, L: np.ndarray) -> np.ndarray:
    """X with cost z0'X z0 of u = -K z, d = L z:  F'X + X F + Q + K'R K - δ² L'L = 0,  F = A - B K +
    E L.

    K: (m, n); L: (k, n); X: (n, n).  Raises NoSolutionError when F is not Hurwitz: the cost is not
    finite."""
    from scipy.linalg import solve_continuous_lyapunov

    loop, _ = _stable_loop(game, K, L)
    price = 0.0 if math.isinf(game.delta) else game.delta**2
    with warnings.catch_warnings(
        action="ignore"
    ):  # of a loop near the axis, whose cost is compared with another
        X = solve_continuous_lyapunov(loop.T, -(game.Q + K.T @ game.R @ K - price * L.T @ L))
    return (X + X.T) / 2.0


def simulated_cost(
    game: Game, K: np.ndarray, L: np.ndarray, initial: np.ndarray, P: np.ndarray | None = None
) -> float:
    """J = ∫ z'Qz + u'Ru - δ² d'd dt of u = -K z, d = L z from z(0) = initial, (n,), less z(0)'P
    z(0), P: (n, n) or 0.

    That is ∫ z'Qz + u'Ru - δ² d'd + 2 z'P z' dt, whose integrand is small where P is about the
    cost: small changes of it keep their digits however stiff the plant. Integrated over time with
    transition matrices, which are exact: z(t) = Φ(t) z(0) and J(t) = z(0)'X(t) z(0) go on by Φ(2t)
    = Φ(t)², X(2t) = X(t) + Φ(t)'X(t) Φ(t), from a step in which no mode moves far, until the state
    has died out. Raises NoSolutionError when A - B K + E L is not Hurwitz. Source: Van Loan, IEEE
    Trans. Automatic Control 23 (1978), for the first step."""
    from scipy.linalg import block_diag, expm

    F, abscissa = _stable_loop(game, K, L)
    n, price = (
        len(F),
        0.0 if math.isinf(game.delta) else game.delta**2,
    )  # no disturbance, no pay-off: inf * 0 is 0
    policies = np.vstack([np.eye(n), -K, L])
    prices = exact(block_diag(game.Q, game.R, -price * np.eye(len(L))))
    if P is not None:
        high, low = product(exact((P + P.T) / 2.0), exact(np.hstack([game.A, game.B, game.E])))
        zeros = np.zeros((len(policies) - n, len(policies)))
        high, low = np.vstack([high, zeros]), np.vstack([low, zeros])
        prices = add(prices, add((high, low), (high.T, low.T)))
    running = product(product(exact(policies.T), prices), exact(policies))[0]
    end, time = TIME_CONSTANTS / -abscissa, 1.0 / float(np.linalg.norm(F, 1))
    step = expm(np.block([[-F.T, running], [np.zeros_like(F), F]]) * time)
    transition = step[n:, n:]
    X = transition.T @ step[:n, n:]
    while time < end:
        X = X + transition.T @ X @ transition
        transition = transition @ transition
        time *= 2.0
    return float(initial @ X @ initial)


def cost_checks(game: Game, P: np.ndarray, initial: np.ndarray) -> tuple[Check, ...]:
    """The policies of P cost z0'P z0, by a Lyapunov equation and integrated over time from z0 =
    initial, (n,)."""
    K, L, names = game.gain(P), game.disturbance_gain(P), ("cost_lyapunov", "cost_simulated")
    if not is_hurwitz(game.A - game.B @ K + game.E @ L):
        reason = "the policies of P do not bring the state to rest: their cost is not finite"
        return tuple(at_most(name, math.inf, COST_TOLERANCE, reason) for name in names)
    costs = float(initial @ cost_matrix(game, K, L) @ initial), simulated_cost(game, K, L, initial)
    claimed = float(initial @ P @ initial)
    off = [abs(cost - claimed) / max(abs(claimed), np.finfo(float).tiny) for cost in costs]
    reasons = [
        f"the policies of P cost {cost:.10g} where P claims {claimed:.10g}" for cost in costs
    ]
    return tuple(
        at_most(*each[:2], COST_TOLERANCE, each[2])
        for each in zip(names, off, reasons, strict=True)
    )


def _stable_loop(game: Game, K: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, float]:
    """A - B K + E L and its abscissa, 1/s."""
    loop = game.A - game.B @ K + game.E @ L
    abscissa = spectrum(loop).abscissa
    if abscissa >= 0.0:
        raise NoSolutionError(
            f"A - B K + E L has abscissa {abscissa:+.4g} 1/s: the cost of these policies is infinite"
        )
    return loop, abscissa


def saddle_checks(
    game: Game, P: np.ndarray, initial: np.ndarray, change: float = CHANGE
) -> tuple[Check, ...]:
    """J(K + εΔ, L) - J(K, L) = +c ε² and J(K, L + εΔ) - J(K, L) = -c ε², c > 0, in random
    directions Δ.

    P: (n, n), whose policies are K = R⁻¹B'P and L = δ⁻²E'P; initial z(0): (n,). The costs are
    compared at two ε a factor 8 apart; the slope log(ratio of changes)/log 8 is 2 at a saddle point
    and 1 away from it. change: of the cost at the larger ε, relative, and about the relative error
    of P that hides under it: at 1e-6, errors of 1e-6 pass and most of 1e-5 do not. Near delta_min a
    change of 1e-4 is too large to be a parabola. With delta = inf, or an E without columns, there
    is no second player, and only the control is perturbed. Raises BadInputError when the flight
    from `initial` costs nothing."""
    K, L = game.gain(P), game.disturbance_gain(P)
    if not is_hurwitz(game.A - game.B @ K + game.E @ L):
        reason = "the policies of P do not bring the state to rest: there is no cost to compare"
        return (at_most("saddle_finite_cost", math.inf, 0.0, reason),)
    checks, rng = [], np.random.default_rng(0)
    players = ("control", K, 1.0), ("disturbance", L, -1.0)
    with np.errstate(all="ignore"):  # a P far from any value overflows, and fails
        for player, gain, sign in players[: 1 + (math.isfinite(game.delta) and L.size > 0)]:
            steps = rng.standard_normal((DIRECTIONS, *gain.shape))
            pairs = [(step, 0.0 * L) if player == "control" else (0.0 * K, step) for step in steps]
            losses = sign * np.array([*_changes(game, P, pairs, initial, change)])
            least, slopes = (
                float(losses.min()),
                np.log(np.abs(losses[:, 0] / losses[:, 1])) / math.log(RATIO),
            )
            farthest = float(slopes[np.argmax(np.abs(slopes - 2.0))])
            gains = f"the {player} gains by leaving the policy of P (relative change {least:.3g})"
            order = f"the cost changes with order {farthest:.3g} in the {player}, not 2"
            checks.append(at_least(f"saddle_{player}_loses", least, 0.0, gains))
            checks.append(
                at_most(f"saddle_{player}_slope_error", abs(farthest - 2.0), SLOPE_TOLERANCE, order)
            )
    return tuple(checks)


def _changes(
    game: Game,
    P: np.ndarray,
    steps: list[tuple[np.ndarray, np.ndarray]],
    initial: np.ndarray,
    change: float,
) -> Iterator[tuple[float, float]]:
    """Relative changes of the cost at ε and ε/8, the largest ε = 2^k that changes it by at most
    `change`, in each direction; nan where rounding changes it more. Directions are alike: the
    search begins at the ε of the last one."""
    K, L = game.gain(P), game.disturbance_gain(P)
    base, excess = (simulated_cost(game, K, L, initial, less) for less in (None, P))
    if base == 0.0:
        raise BadInputError(
            "the flight from this initial state costs nothing; choose another initial state"
        )

    def is_small(size: float, step: tuple[np.ndarray, np.ndarray]) -> bool:
        try:
            X = cost_matrix(game, K + size * step[0], L + size * step[1])
        except NoSolutionError:  # not Hurwitz
            return False
        return abs(float(initial @ X @ initial) / base - 1.0) <= change

    size = 1.0
    for step in steps:
        while size < LARGEST_STEP and is_small(size, step):
            size *= 2.0
        while size >= SMALLEST_STEP and not is_small(size, step):
            size /= 2.0
        try:
            first, second = (
                (simulated_cost(game, K + part * step[0], L + part * step[1], initial, P) - excess)
                / base
                for part in (size, size / RATIO)
            )
        except NoSolutionError:  # Hurwitz at one step and not at a smaller one
            first = second = math.nan
        if size < SMALLEST_STEP:  # the two costs of P itself differ: a P of rounding alone
            size, first, second = 1.0, math.nan, math.nan
        yield first, second


#: What data call the numbers of `FlightCost`.
_KEYS = (
    *("cost_lost_worst_percent", "cost_lost_mean_percent", "l2_gain", "l2_gain_exact"),
    *("distance_to_instability", "distance_to_instability_exact"),
)


class FlightCost(NamedTuple):
    """Cost lost by u = -K z against the optimum, percent of z'P*z, each under its own worst
    disturbance.

    worst, mean: over starts; the mean over starts of equal optimal cost. inf: no bound, the gain is
    not below delta or the loop is not stable. gain, exact_gain: L2 gains, to be below delta.
    distance, exact_distance: the smallest change that takes A - B K to an undamped mode, as a part
    of its norm in balanced units; 0 for an unstable loop."""

    worst: float
    mean: float
    gain: float
    exact_gain: float
    distance: float
    exact_distance: float

    def to_dict(self) -> dict[str, float | None]:
        """Ready for JSON, with the unit in the name."""
        return dict(zip(_KEYS, map(finite_or_none, self), strict=True))


def flight_cost(game: Game, exact: GameSolution, K: np.ndarray) -> FlightCost:
    """Compare the gain K (m, n) with that of the exact solution, in flight."""
    best = bounded_real_gain(game, exact.K), spectrum(game.A - game.B @ exact.K).axis_distance()
    loop = spectrum(game.A - game.B @ K) if is_moderate(K) else None
    if loop is None or loop.abscissa >= 0.0:
        return FlightCost(math.inf, math.inf, math.inf, best[0], 0.0, best[1])
    worst, mean = _lost(game, exact, K)
    return FlightCost(
        100.0 * worst,
        100.0 * mean,
        bounded_real_gain(game, K),
        best[0],
        loop.axis_distance(),
        best[1],
    )


def _lost(game: Game, exact: GameSolution, K: np.ndarray) -> tuple[float, float]:
    """Largest and mean eigenvalue of P*^-1 D, D of `loss_matrix`, on the states that cost
    something."""
    D = loss_matrix(game, exact, K)
    if D is None:
        return math.inf, math.inf
    units = balanced_units(game)
    squared = np.outer(units, units)
    values, vectors = np.linalg.eigh(exact.P * squared)
    paid = values > SIGNLESS * max(float(values[-1]), 0.0)
    if not paid.any():
        return (0.0, 0.0) if not D.any() else (math.inf, math.inf)
    root = vectors[:, paid] / np.sqrt(values[paid])
    lost = np.linalg.eigvalsh(root.T @ (D * squared) @ root)
    return max(float(lost[-1]), 0.0), max(float(lost.mean()), 0.0)


def is_moderate(matrix: np.ndarray) -> bool:
    """Whether every entry is a number no larger than `LARGEST_CRITIC_ENTRY`."""
    return bool(np.all(np.abs(matrix) <= LARGEST_CRITIC_ENTRY))


def loss_matrix(game: Game, exact: GameSolution, K: np.ndarray) -> np.ndarray | None:
    """D >= 0, (n, n): with u = -K z, which stabilizes, the worst disturbance costs z'(P* + D) z;
    None without bound.

    F'D + D F + (K - K*)'R(K - K*) + δ⁻² D E E' D = 0,  F = A - B K + E L*: the cost equation of K
    less that of K*, so that small losses keep their digits. Newton steps from D = 0."""
    from scipy.linalg import solve_continuous_lyapunov

    change = K - exact.K
    charge = change.T @ game.R @ change
    spread = game.S_disturbance / game.delta**2
    start = game.A - game.B @ K + game.E @ exact.disturbance_gain
    D = np.zeros_like(game.A)
    for _ in range(MAX_STEPS):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "error", RuntimeWarning
                )  # SciPy's word for a singular Lyapunov equation
                F = start + spread @ D
                if spectrum(F).abscissa >= 0.0:
                    return None
                found = solve_continuous_lyapunov(F.T, D @ spread @ D - charge)
        except (ValueError, RuntimeWarning):  # it overflows, or has no solution
            return None
        found = (found + found.T) / 2.0
        if np.abs(found - D).max() <= 1e-10 * np.abs(found).max():
            return found
        D = found
    return None
