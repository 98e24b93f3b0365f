"""Least-squares fit of [A B E] to transitions: what the data can tell, before anything is learned.

The laws learn from states that are drawn for the fit. The 95 % bands of P and K follow from the
covariance of the fit, to first order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.critic.training_run import DataSummary
from controller.game.zero_sum import Game, q_function, rates_of_step
from controller.learning.recording import Transitions, plant_of, root_mean_square
from hfa_support.errors import BadInputError, shortened
from hfa_support.reporting.text import numbered
from hfa_support.units import conversion_factor

#: Singular values of the data below this fraction of the largest count as 0. The fit can have the
#: rounding error of a sample, 1e-16, divided by this fraction: eight digits remain correct.
_RANK_TOLERANCE = 1e-8
#: Probability that a band does not hold the exact value.
_OUTSIDE = 0.05
#: Probability that independent noise is taken for a correlated one.
_CHANCE = 1e-4
#: Misfit that rounding can cause: it is no noise.
_ROUNDING = 1e-12


class Bands(NamedTuple):
    """Half-widths of the 95 % bands of P (n, n) and K (m, n)."""

    P: np.ndarray
    K: np.ndarray


class PlantFit:
    """Least-squares fit M (n, s) of ends = M [x; u; d] + constant to the transitions of a game.

    The ends are rates, or the states after a step, in which u and d are constant. Begins and ends
    are those about their means, which is the fit of any constant: data may be about any trim.

    user_game: the game of the user, with any A and B; `game` has those of the fit
    ends: about their means, (N, n)
    scales: root mean squares of the columns of [x u d] about their means, (s,)
    scaled_begins: [x u d] about their means / scales, (N, s)
    condition: ratio of the largest to the smallest singular value of scaled_begins
    matrix: M
    units: factors from M to that of begins and ends in units of their sizes, (n, s)
    residuals: ends - M [x; u; d] - constant, (N, n)
    covariance: of the residuals of the states, (n, n)
    noise: their standard deviations, (n,)
    misfit: largest ratio of a state's residuals to its ends, both as root mean squares

    Raises BadInputError if the transitions do not determine M, with the reason.
    """

    def __init__(self, game: Game, transitions: Transitions) -> None:
        self.user_game = game
        self.transitions = transitions
        count, columns = transitions.begins.shape
        if count <= columns + 1:
            raise BadInputError(
                f"the data have {count} transitions; record at least {columns + 2}, two more than "
                "there are states, inputs and disturbances, to see a constant and the noise"
            )
        begins, self.ends = (
            each - each.mean(axis=0) for each in (transitions.begins, transitions.ends)
        )
        self.scales = root_mean_square(begins)
        n, m = game.B.shape
        names = (*game.names.states, *game.names.inputs, *numbered("d", columns - n - m))
        for place in np.flatnonzero(np.ptp(transitions.begins, axis=0) == 0.0).tolist():
            raise BadInputError(f"{names[place]} is the same in every row of the data; excite it")
        self.scaled_begins = begins / self.scales
        self._refuse_policies(names)
        sizes = np.linalg.svd(self.scaled_begins, compute_uv=False)
        rank = int(np.sum(sizes > _RANK_TOLERANCE * sizes[0]))
        if rank < columns:
            raise BadInputError(
                f"the rank of states, inputs and disturbances is {rank} of {columns}: "
                "some are combinations of others in every row; record other motions too, and move "
                "each input independently"
            )
        self.condition = sizes[0] / sizes[-1]
        fit, *_ = np.linalg.lstsq(self.scaled_begins, self.ends, rcond=None)
        self.matrix = fit.T / self.scales
        self.units = self.scales / self.scales[:n, None]
        self.residuals = self.ends - self.scaled_begins @ fit
        self.degrees_of_freedom = count - columns - 1
        self.covariance = self.residuals.T @ self.residuals / self.degrees_of_freedom
        self.noise = np.sqrt(np.diag(self.covariance))
        self.misfit = _misfit(self.residuals, self.ends)

    def _refuse_policies(self, names: Sequence[str]) -> None:
        """Raise BadInputError for inputs and disturbances that are linear functions of x."""
        n = len(self.user_game.A)
        scaled, rounding = self.scaled_begins, self.transitions.rounding / self.scales
        gains = np.linalg.lstsq(scaled[:, :n], scaled[:, n:], rcond=None)[0]  # (u, d) from x
        beyond_policy = np.abs(scaled[:, n:] - scaled[:, :n] @ gains).max(axis=0)
        # Rounding changes u and x by up to 0.5 of their last digits, and their fit by half of that.
        rounding_errors = (0.5 + 0.25) * (rounding[n:] + rounding[:n] @ np.abs(gains))
        is_policy = beyond_policy <= np.maximum(rounding_errors, _RANK_TOLERANCE)
        if is_policy.any():
            moved = ", ".join(names[n + place] for place in np.flatnonzero(is_policy).tolist())
            raise BadInputError(
                f"in every row, {moved} is a policy u = -K x of the states, up to rounding, so "
                "that its effect cannot be told from theirs; add independent excitation to it "
                "while recording"
            )

    @cached_property
    def game(self) -> Game:
        """The game with A, B and, where d was recorded, E of the fit."""
        n, m = self.user_game.B.shape
        hold, fit = self.transitions.hold, self.matrix
        if hold is not None:  # the fit is of steps, A, B and E are of rates
            rates = rates_of_step(fit * self.units, hold)
            if rates is None:
                raise BadInputError(
                    f"a mode of the samples changes its sign every {hold:g} s, as no plant in "
                    "continuous time with held inputs does; record more often, or check dt and "
                    "that inputs are constant between samples"
                )
            fit = rates / self.units
            self._refuse_fast_modes(fit, hold)
        A, B, E = np.split(fit, [n, n + m], axis=1)
        return replace(self.user_game, A=A, B=B, E=E if E.size else self.user_game.E)

    def summary(self) -> DataSummary:
        """Return what the data can tell."""
        follows = self.transitions.follows
        return DataSummary(
            rows=len(follows),
            # A transition that follows no other is the first of an episode.
            episodes=int(np.sum(~follows)) if follows.any() else 0,
            rank=len(self.scales),
            condition=self.condition,
            misfit=self.misfit,
            noise=self.noise,
            hold=self.transitions.hold,
            notes=(*self.transitions.notes, *self._doubts()),
        )

    @property
    def shows_noise(self) -> bool:
        """Whether the deviations from the fit can be independent noise of the ends."""
        return self.misfit > _ROUNDING and not any(self._doubts())

    def _doubts(self) -> Iterator[str]:
        """Yield sentences on why the deviations are no independent noise."""
        from scipy.special import chdtri

        if self._outliers:
            yield self._outliers
        followers = np.flatnonzero(self.transitions.follows)
        if len(followers):
            # For independent residuals, each entry of all independent ones has the variance 1.
            seen = self.noise > _ROUNDING * root_mean_square(self.ends)
            unit, *_ = np.linalg.svd(
                self.residuals[:, seen] / self.noise[seen], full_matrices=False
            )
            ratio = len(unit) / math.sqrt(len(followers))
            correlations = ratio * unit[followers].T @ unit[followers - 1]
            if np.sum(correlations**2) > chdtri(correlations.size, _CHANCE):
                yield (
                    "residuals of successive samples are correlated, as noise of sensors makes "
                    "them, which biases P and K"
                )

    @cached_property
    def _outliers(self) -> str:
        """Sentence on rows that do not fit the others and cause most of the misfit, or "".

        The fit is that of the 80 % of the rows with the smallest residuals (least trimmed squares).
        A row is outside if a residual exceeds 6 standard deviations, by the median of all rows.
        """
        ends = self.ends
        begins = np.column_stack([self.scaled_begins, np.ones(len(ends))])  # of rows without them
        kept = inside = np.arange(len(ends))
        for _ in range(20):
            fit, *_ = np.linalg.lstsq(begins[kept], ends[kept], rcond=None)
            errors = np.abs(ends - begins @ fit)
            deviations = 1.4826 * np.median(errors, axis=0) + _ROUNDING * root_mean_square(ends)
            sizes = (errors / np.where(deviations > 0.0, deviations, 1.0)).max(axis=1)
            kept = np.argsort(sizes)[: max(int(0.8 * len(ends)), begins.shape[1] + 1)]
            inside = np.flatnonzero(sizes <= 6.0)
        without = _misfit(errors[inside], ends[inside])
        if len(inside) == len(ends) or without > 0.5 * self.misfit:
            return ""
        rows = np.delete(self.transitions.rows, inside)
        return (
            f"{len(rows)} of {len(ends)} rows do not fit the others "
            f"({shortened(', '.join(rows), 200)}): without them, the misfit is "
            f"{100.0 * without:.2g} %; mark the ends of episodes, or remove wrong rows"
        )

    def _refuse_fast_modes(self, rates: np.ndarray, hold: float) -> None:
        """Raise BadInputError if samples are slower than a mode of the user's plant, or if the rate
        of X is not X_rate, of states with such names, as of slow samples or of a wrong time.

        rates: [A B E] by the logarithm of the step, (n, s)
        """
        fastest = np.abs(np.linalg.eigvals(self.user_game.A).imag).max()
        if fastest * hold > math.pi:
            raise BadInputError(
                f"the plant has a mode of {fastest:.3g} rad/s, and samples every {hold:g} s show "
                f"none faster than {math.pi / hold:.3g} rad/s; record more often"
            )
        names = self.user_game.names
        labels = dict(zip(names.states, names.state_units, strict=True))
        for row, (state, unit) in enumerate(labels.items()):
            rate = f"{state}_rate"
            if rate not in labels or self.misfit > 0.1:
                continue
            terms = rates[row] * self.scales  # root mean squares of the parts of the rate
            place = names.states.index(rate)
            known = self.scales[place] * (conversion_factor(labels[rate], f"{unit}/s") or 1.0)
            terms[place] -= known
            if np.abs(terms).max() > 0.5 * known:
                raise BadInputError(
                    f"the rate of {state} in the data is not {rate}: the samples, every "
                    f"{hold:g} s, are slower than a mode, or their time is wrong; "
                    "record more often"
                )

    @cached_property
    def _root_of_row(self) -> np.ndarray:
        """Root of the covariance of a row of M for noise of variance 1, (s, s).

        With begins = Q R and Q'Q = 1, the covariance (begins'begins)⁻¹ is R⁻¹R⁻ᵀ.
        """
        return np.asarray(
            np.linalg.inv(np.linalg.qr(self.scaled_begins, mode="r")) / self.scales[:, None]
        )

    def refuse_without_effect(self) -> None:
        """Raise BadInputError for an input whose effect on each state has 0 in its 95 % band."""
        n = len(self.matrix)
        # The probability outside is divided among the bands of all states (Bonferroni).
        quantile = _quantile(_OUTSIDE / n, self.degrees_of_freedom)
        bands = quantile * np.outer(self.noise, np.linalg.norm(self._root_of_row, axis=1))
        for place, name in enumerate(self.user_game.names.inputs, start=n):
            if np.any(np.abs(self.matrix[:, place]) > bands[:, place]):
                continue
            raise BadInputError(
                f"the data show no effect of {name} in 95 % bands, with a misfit of "
                f"{100.0 * self.misfit:.2g} %; record longer, with less noise, or with larger "
                "independent excitation" + (f". {self._outliers}" if self._outliers else "")
            )

    def bands(self, P: np.ndarray) -> Bands:
        """Return the 95 % bands of the value z'P z and of its gain, for independent noise."""
        # The error of M is Σ e_ij a_i b_j' with independent e_ij of variance 1, and the columns a_i
        # and b_j of the roots of the covariances of a column and of a row of M.
        variances, vectors = np.linalg.eigh(self.covariance)
        root_of_column = vectors * np.sqrt(variances.clip(0.0))
        changes = [
            self._changes(P, np.outer(a, b)) for a in root_of_column.T for b in self._root_of_row.T
        ]
        # Variances add: the norm of all changes of P, and that of all changes of K.
        deviations = (np.linalg.norm(of_one, axis=0) for of_one in zip(*changes, strict=True))
        quantile = _quantile(_OUTSIDE, self.degrees_of_freedom)
        return Bands(*(quantile * deviation for deviation in deviations))

    def _changes(self, P: np.ndarray, change: np.ndarray) -> Bands:
        """Return the changes of P and K, to first order, for a change (n, s) of the fit.

        With the policies (x, u, d) = V x of P and their loop Ac = M V,

            continuous: Ac' dP + dP Ac + V'dH V = 0,     dH = J'P dM + dM'P J,  J = [1 0 0]
            discrete:   α Ac' dP Ac - dP + V'dH V = 0,   dH = α (M'P dM + dM'P M)
        """
        from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

        game = self.game
        n, m = game.B.shape
        if self.transitions.hold is not None:  # the fit is of steps, M of rates
            of_fit = (change * self.units).ravel()
            change = np.linalg.solve(self._fit_by_rates, of_fit).reshape(change.shape) / self.units

        H = q_function(game, P if game.is_discrete else np.zeros_like(P))
        M = plant_of(game, len(H))
        dM = np.pad(change, ((0, 0), (0, len(H))))[:, : len(H)]  # 0 for d that was not recorded
        K, L = game.policies(P)
        V = np.vstack([np.eye(n), -K, L])[: len(H)]
        alpha, J = game.discount, M if game.is_discrete else np.eye(n, len(H))
        dH = alpha * (J.T @ P @ dM + dM.T @ P @ J)  # of the Q-function, for the same P

        sizes = self.scales[:n]  # solved in states of size 1, whatever their units
        products = np.outer(sizes, sizes)
        loop = M @ V * sizes / sizes[:, None]
        cost = V.T @ dH @ V * products
        if game.is_discrete:
            dP = solve_discrete_lyapunov(math.sqrt(alpha) * loop.T, cost) / products
            dH = dH + alpha * M.T @ dP @ M
        else:
            dP = solve_continuous_lyapunov(loop.T, -cost) / products
            dH = dH + J.T @ dP @ M + M.T @ dP @ J
        dK = np.linalg.solve(H[n:, n:], (dH @ V)[n:])[:m]  # ∂Q/∂(u, d) stays 0 along V x
        return Bands(dP, dK)

    @cached_property
    def _fit_by_rates(self) -> np.ndarray:
        """Derivative of the fit of steps with respect to [A B E], row by row, (n s, n s), both in
        units of the sizes of begins.

        The fit is the first rows of exp(hold [A B E; 0]), as u and d are constant in a step.
        """
        from scipy.linalg import expm_frechet

        n, s = self.matrix.shape
        hold, rates = self.transitions.hold, plant_of(self.game, s)
        assert hold is not None  # the fit is of steps
        exponent = np.zeros((s, s))
        exponent[:n] = hold * rates * self.units
        changes = hold * np.eye(n * s, s * s).reshape(-1, s, s)  # of [A B E], one entry by 1
        return np.column_stack(
            [expm_frechet(exponent, change, compute_expm=False)[:n].ravel() for change in changes]
        )


def _quantile(outside: float, degrees_of_freedom: int) -> float:
    """Return the half-width, in standard deviations, of a band that misses with a probability."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees_of_freedom, 1.0 - 0.5 * outside))


def _misfit(errors: np.ndarray, ends: np.ndarray) -> float:
    """Return the largest ratio of the errors of a state to its ends, as root mean squares."""
    sizes = root_mean_square(ends)
    return float(np.max(root_mean_square(errors) / np.where(sizes > 0.0, sizes, 1.0)))
