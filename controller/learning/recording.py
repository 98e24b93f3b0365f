"""Recorded samples (z_j, F_j) of a plant: their generation, rank and Bellman residuals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controller.critic.training_run import Excitation
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, numbers_in, refuse_unless_whole
from hfa_support.matrices import LARGEST, checked_matrix, quadratic_forms
from hfa_support.reporting.report import Reported

#: Singular values of the unit rows below this fraction of the largest count as 0. The weights can
#: have the rounding error of a sample, 1e-16, divided by this fraction: eight digits remain
#: correct.
RANK_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False, repr=False)
class Stack(Reported):
    """N_h recorded samples of a plant.

    F must not contain the reference forcing r(t) = A x_d - x_d'. The value z'Pz belongs to F = A z
    alone.

    states: z_j, (N_h, n)
    drifts: F_j = z' - B u - E d, (N_h, n)

    Raises BadInputError if the shapes differ or a number is not finite or too large.
    """

    states: np.ndarray
    drifts: np.ndarray

    def __post_init__(self) -> None:
        """Check both arrays and make them read-only.

        Raises BadInputError, as described for the class.
        """
        for name in ("states", "drifts"):
            object.__setattr__(
                self, name, checked_matrix(f"stack {name}", getattr(self, name), LARGEST)
            )
        if self.states.shape != self.drifts.shape:
            raise BadInputError(
                f"states have shape {self.states.shape}, drifts {self.drifts.shape}; give (N_h, n)"
            )

    @property
    def samples(self) -> int:
        """Number of samples, N_h."""
        return int(self.states.shape[0])

    def without_cross_weights(self, game: Game) -> Stack:
        """Return the samples of `game.without_cross_weights`, with the drifts F_j - B R⁻¹N'z_j."""
        return Stack(self.states, self.drifts - self.states @ (game.B @ game.F).T)

    def linear(self) -> tuple[Stack, float]:
        """Return the samples with their drifts replaced by Â z_j, and the relative misfit of this
        fit.

        Â is the least-squares fit of the drifts, and the misfit is |F - Â z| / |F|. For exact
        drifts the misfit is of the order of rounding. Otherwise the misfit has the size of the
        noise or of a reference forcing.
        """
        A_transposed, *_ = np.linalg.lstsq(self.states, self.drifts, rcond=None)
        fitted = self.states @ A_transposed
        size = float(np.linalg.norm(self.drifts))
        misfit = float(np.linalg.norm(self.drifts - fitted)) / size if size > 0.0 else 0.0
        return Stack(self.states, fitted), misfit

    def channel_scales(self) -> np.ndarray:
        """Return the root mean square of each state, (n,), used as its scale.

        Raises BadInputError if a state is zero in every sample. The effect of such a state cannot
        be learned.
        """
        scales = np.sqrt(np.mean(self.states**2, axis=0))
        if np.any(scales == 0.0):
            raise BadInputError(
                f"state {np.argmin(scales) + 1} is 0 in every recorded sample; excite this state"
            )
        return scales


def record(game: Game, states: np.ndarray) -> Stack:
    """Return samples of a plant at given states, with the exact drifts A z.

    game: the game, with A
    states: (N, n)

    Raises BadInputError if the states are not (N, n), or if the game is in discrete time.
    """
    game.refuse_steps("record")
    states = numbers_in("recorded states", states)
    if states.ndim != 2 or states.shape[1] != game.A.shape[0]:
        raise BadInputError(
            f"recorded states have shape {states.shape}; give (N, {game.A.shape[0]})"
        )
    return Stack(states, states @ game.A.T)


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
    return record(game, np.random.default_rng(seed).uniform(-widths, widths, (count, n)))


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
    eigenvalues = np.linalg.eigvals(balanced)
    spectral_radius = float(np.abs(eigenvalues).max()) or 1.0
    shift = max(float(eigenvalues.real.max()), 0.0) + 0.1 * spectral_radius
    noise = (game.S_control + game.S_disturbance / game.delta**2) / np.outer(units, units)
    covariance = solve_continuous_lyapunov(balanced - shift * np.eye(len(units)), -noise)
    variances = np.diag(covariance)
    return units * np.sqrt(np.where(variances > 0.0, variances, 1.0))


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
