"""Transitions of a plant, states that are drawn for one, and the residual of its game."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_support.matrices import balanced, quadratic_forms, spectral_abscissa, spectral_radius

#: Drawn samples for each weight.
SAMPLES_PER_WEIGHT = 4


class Transitions(NamedTuple):
    """N recorded transitions of a plant.

    begins: [x u d] of each transition, (N, s). There is no column of d if none was recorded
    ends: of x' for a game in continuous time without `hold`, else x after the transition, (N, n)
    follows: whether a transition begins where the one before it ends, (N,)
    rounding: last digit of the recorded x, u and d, (s,)
    hold: time for which u and d are constant, s, of samples of a game in continuous time, or None
    notes: sentences on the data
    rows: name of the row of each transition, for messages
    """

    begins: np.ndarray
    ends: np.ndarray
    follows: np.ndarray
    rounding: np.ndarray
    hold: float | None
    notes: tuple[str, ...]
    rows: Sequence[str]


def drawn(game: Game, seed: int) -> np.ndarray:
    """Return random states, inputs and, for a finite delta, disturbances [x u d], (N, s).

    They are drawn uniformly from a box, whose half-widths are those of `widths_of`.

    seed: seed of the random numbers
    """
    widths = widths_of(game)
    size = len(widths)
    # A quadratic form of [x u d] has s (s + 1) / 2 weights.
    count = SAMPLES_PER_WEIGHT * size * (size + 1) // 2
    return np.random.default_rng(seed).uniform(-widths, widths, (count, size))


def plant_of(game: Game, columns: int) -> np.ndarray:
    """Return the first columns of [A B E]."""
    return np.hstack([game.A, game.B, game.E])[:, :columns]


def widths_of(game: Game) -> np.ndarray:
    """Return half-widths of random x and u, and of d for a finite delta, (s,).

    The half-widths of x are the `natural_spread`. No input or disturbance changes a state by more
    than its spread in one step, or costs more than all states.
    """
    columns, weights = game.B, np.diag(game.R)
    if np.isfinite(game.delta):
        columns = np.hstack([columns, game.E])
        weights = np.append(weights, np.full(game.E.shape[1], game.delta**2))
    spread = natural_spread(game)

    # Change in a step of the state that an input of 1 moves most, in spreads.
    effects = np.abs(columns / spread[:, None]).max(axis=0)
    by_effect = 1.0 / np.where(effects > 0.0, effects, 1.0)

    cost_of_states = float(np.diag(game.Q) @ spread**2) or 1.0
    by_cost = np.sqrt(cost_of_states / weights)
    return np.append(spread, np.minimum(by_effect, by_cost))


def natural_spread(game: Game) -> np.ndarray:
    """Return the standard deviation of each state under white-noise inputs and disturbances, (n,).

    The eigenvalues of the plant are shifted by -β. The variances are the diagonal of X with
        (A - βI) X + X (A - βI)' + B R⁻¹B' + EE'/δ² = 0,
        β = max(largest real part of the eigenvalues of A, 0) + 10 % of the spectral radius.
    A spectral radius of 0 is replaced by 1/s. For a state that no input or disturbance affects, the
    result is the scale of the state in the balancing of A. The result depends on the units of the
    states.
    """
    from scipy.linalg import solve_continuous_lyapunov

    A, units = balanced(game.A)
    shift = max(spectral_abscissa(A), 0.0) + 0.1 * (spectral_radius(A) or 1.0)
    noise = (game.S_control + (game.E @ game.E.T) / game.delta**2) / np.outer(units, units)
    covariance = solve_continuous_lyapunov(A - shift * np.eye(len(units)), -noise)
    variances = np.diag(covariance)
    return units * np.sqrt(np.where(variances > 0.0, variances, 1.0))


def root_mean_square(columns: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column of (N, k), (k,)."""
    return np.asarray(np.sqrt(np.mean(columns**2, axis=0)))


class Learned(NamedTuple):
    """What a law learned.

    weights: of the value, (M,)
    residual: of the equation of the game, relative to the costs
    diagnostics: further numbers of the law, by name
    H: Q-function of a game in discrete time, or None
    """

    weights: np.ndarray
    residual: float
    diagnostics: Mapping[str, float] = {}
    H: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """States z_j of a game in continuous time, recorded with their drifts F_j = A z_j.

    game: the game, without cross weights
    psi: basis ψ, with M weights
    states: z_j, (N_h, n)
    """

    game: Game
    psi: Basis
    states: np.ndarray

    @cached_property
    def drifts(self) -> np.ndarray:
        """F_j, (N_h, n)."""
        return self.states @ self.game.A.T

    @cached_property
    def gradient(self) -> np.ndarray:
        """∂ψ_j, (N_h, M, n)."""
        return self.psi.gradient(self.states)

    @cached_property
    def costs(self) -> np.ndarray:
        """State cost z_j'Q z_j, (N_h,)."""
        return quadratic_forms(self.states, self.game.Q)

    def residual(self, weights: np.ndarray) -> float:
        """Return the residual of the Hamilton-Jacobi-Isaacs equation for V = W'ψ, weights W (M,).

        The errors are e_j = ∇V'F_j + z_j'Q z_j - ¼ ∇V'S ∇V (paper Eq. 33 with the extremal
        policies). Their norm is relative to that of the costs.
        """
        with np.errstate(all="ignore"):
            slopes = np.einsum("jmi,m->ji", self.gradient, weights)  # ∇V, (N_h, n)
            of_policies = 0.25 * quadratic_forms(slopes, self.game.S)
            errors = np.sum(slopes * self.drifts, axis=1) + self.costs - of_policies
            return float(np.linalg.norm(errors) / np.linalg.norm(self.costs))
