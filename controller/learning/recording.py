"""Recorded transitions of a plant: their generation, rank and Bellman residuals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.critic.training_run import Excitation
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, numbers_in, refuse_unless_whole
from hfa_support.matrices import quadratic_forms, spectral_abscissa, spectral_radius

#: Singular values of the unit rows below this fraction of the largest count as 0. The weights can
#: have the rounding error of a sample, 1e-16, divided by this fraction: eight digits remain
#: correct.
RANK_TOLERANCE = 1e-8
#: Recorded samples for each weight by default.
SAMPLES_PER_WEIGHT = 4


class Stack(NamedTuple):
    """N_h samples of a plant without input: states z_j and their rates F_j = A z_j, (N_h, n)."""

    states: np.ndarray
    drifts: np.ndarray


class Transitions(NamedTuple):
    """N recorded transitions of a plant.

    begins: [x u d] of each transition, (N, s). There is no column of d if none was recorded
    ends: of x' for a game in continuous time without `hold`, else x after the transition, (N, n)
    follows: whether a transition begins where the one before it ends, (N,)
    rounding: last digit of the recorded x, u and d, (s,)
    hold: time for which u and d are constant, s, of samples of a game in continuous time, or None
    notes: sentences on the data
    """

    begins: np.ndarray
    ends: np.ndarray
    follows: np.ndarray
    rounding: np.ndarray
    hold: float | None = None
    notes: tuple[str, ...] = ()


def simulated(game: Game, seed: int) -> Transitions:
    """Return exact transitions from random states with random inputs and disturbances.

    No input or disturbance changes a state by more than the spread of the state in one step, or in
    the time of the fastest mode. The cost of each is at most the cost of all states together.

    seed: seed of the random numbers
    """
    widths = widths_of(game)
    count = SAMPLES_PER_WEIGHT * len(widths) * (len(widths) + 1) // 2
    begins = np.random.default_rng(seed).uniform(-widths, widths, (count, len(widths)))
    ends = begins @ plant_of(game, len(widths)).T
    return Transitions(begins, ends, np.zeros(count, dtype=bool), np.zeros(len(widths)))


def plant_of(game: Game, columns: int) -> np.ndarray:
    """Return the first columns of [A B E]."""
    return np.hstack([game.A, game.B, game.E])[:, :columns]


def widths_of(game: Game) -> np.ndarray:
    """Return half-widths of random x and u, and of d for a finite delta, (s,) (`simulated`)."""
    columns, prices = game.B, np.diag(game.R)
    if np.isfinite(game.delta):
        columns = np.hstack([columns, game.E])
        prices = np.append(prices, np.full(game.E.shape[1], game.delta**2))
    spread = natural_spread(game)
    cost_of_states = float(np.diag(game.Q) @ spread**2) or 1.0
    effects = np.abs(columns / spread[:, None]).max(axis=0)  # of a unit, in spreads
    fastest = 1.0 if game.is_discrete else _fastest(game.A)
    by_effect = fastest / np.where(effects > 0.0, effects, 1.0)
    by_cost = np.sqrt(cost_of_states / prices)
    return np.append(spread, np.minimum(by_effect, by_cost))


def random_pool(game: Game, count: int, seed: int, half_widths: np.ndarray | None = None) -> Stack:
    """Return samples of a plant at random states, drawn uniformly from a box, without noise.

    game: the game, with A for the drifts A z
    count: number of states, at least 1
    seed: the same seed gives the same states
    half_widths: half-widths of the box, (n,); by default `natural_spread`

    Raises BadInputError if `half_widths` are not n positive numbers, if count or seed is out of
    range, or if the game is in discrete time.

    >>> import hfa
    >>> from controller import random_pool
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> random_pool(game, 100, seed=1).states.shape
    (100, 1)
    """
    game.refuse_steps("random_pool")
    refuse_unless_whole("count", count, 1)
    refuse_unless_whole("seed", seed, 0)
    n = game.A.shape[0]
    widths = natural_spread(game) if half_widths is None else numbers_in("the box", half_widths)
    if widths.shape != (n,) or not np.all((widths > 0.0) & np.isfinite(widths)):
        raise BadInputError(f"the half-widths are {widths.tolist()}; give {n} positive numbers")
    states = np.random.default_rng(seed).uniform(-widths, widths, (count, n))
    return Stack(states, states @ game.A.T)


def natural_spread(game: Game) -> np.ndarray:
    """Return the standard deviation of each state under white-noise inputs and disturbances, (n,).

    The eigenvalues of the plant are shifted by -β. The variances are the diagonal of X with
        (A - βI) X + X (A - βI)' + B R⁻¹B' + EE'/δ² = 0,
        β = max(largest real part of the eigenvalues of A, 0) + 10 % of the spectral radius.
    A spectral radius of 0 is replaced by 1/s. For a state that no input or disturbance affects, the
    result is the scale of the state in the balancing of A. The result depends on the units of the
    states.
    """
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov

    balanced, (units, _) = matrix_balance(game.A, permute=False, separate=True)
    shift = max(spectral_abscissa(balanced), 0.0) + 0.1 * _fastest(balanced)
    noise = (game.S_control + game.S_disturbance / game.delta**2) / np.outer(units, units)
    covariance = solve_continuous_lyapunov(balanced - shift * np.eye(len(units)), -noise)
    variances = np.diag(covariance)
    return units * np.sqrt(np.where(variances > 0.0, variances, 1.0))


def _fastest(A: np.ndarray) -> float:
    """Return the spectral radius of A, 1/s, or 1/s if it is 0."""
    return spectral_radius(A) or 1.0


def excitation(samples: np.ndarray) -> Excitation:
    """Return the rank and the condition of recorded samples.

    samples: ψ(z_j), (N_h, M), whose rows are divided by their lengths, unless these are 0
    """
    lengths = np.linalg.norm(samples, axis=1, keepdims=True)
    rows = samples / np.where(lengths > 0.0, lengths, 1.0)
    values = np.zeros(rows.shape[1])
    computed = np.linalg.svd(rows, compute_uv=False)
    values[: len(computed)] = computed
    return Excitation(
        rank=int(np.sum(values > RANK_TOLERANCE * values[0])),
        size=rows.shape[1],
        samples=len(rows),
        condition=float(values[0] / values[-1]) if values[-1] > 0.0 else np.inf,
    )


class RelativeResidual(NamedTuple):
    """Norm |e| of the residual of a learner's equation over all samples.

    to_costs: |e| divided by the norm of the costs
    to_terms: |e| divided by the norm of the summed magnitudes of the terms of the equation
    """

    to_costs: float
    to_terms: float

    @classmethod
    def of(cls, errors: np.ndarray, costs: np.ndarray, terms: np.ndarray) -> RelativeResidual:
        """Return the residual of errors, costs and summed magnitudes of terms, (N_h,) each."""
        norm, of_costs, of_terms = (float(np.linalg.norm(each)) for each in (errors, costs, terms))
        return cls(norm / of_costs, norm / of_terms)


def residual_of_value(
    slopes: np.ndarray, drifts: np.ndarray, costs: np.ndarray, S: np.ndarray
) -> RelativeResidual:
    """Return the residual of the game's Hamilton-Jacobi-Isaacs equation for a value V.

    At sample j, e_j = ∇V'F_j + z_j'Q z_j - ¼ ∇V'S ∇V (paper Eq. 33 with the extremal policies).

    slopes: ∇V at the samples, (N_h, n)
    drifts: F_j, (N_h, n)
    costs: z_j'Q z_j, (N_h,)
    S: (n, n)
    """
    with np.errstate(all="ignore"):
        changes = slopes * drifts
        policies = 0.25 * quadratic_forms(slopes, S)
        errors = changes.sum(axis=1) + costs - policies
        terms = np.abs(changes).sum(axis=1) + costs + np.abs(policies)
        return RelativeResidual.of(errors, costs, terms)


def refuse_poor(recorded: Excitation) -> None:
    """Raise BadInputError if the rank of recorded samples is below the number of weights.

    With a lower rank, a small residual does not determine the weights.
    """
    if recorded.rank < recorded.size:
        raise BadInputError(
            f"the rank of the recorded samples is {recorded.rank} of {recorded.size} (singular "
            f"values below {RANK_TOLERANCE:g} of the largest do not count); record more different "
            "states"
        )
