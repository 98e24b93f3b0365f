"""Maximum likelihood estimation by output error: parameters, initial states and noise of records.

With residuals v = z - y(θ, x₀) and a noise variance r of each measured quantity, the likelihood is
largest where

    L = ½ Σ N ln(Σ v² / N) + ½ Σ ((x₀ - guess) / (10 nominal))²

is least. The sums are over quantities, with r = Σ v² / N. The second term keeps initial states that
no sample determines near their guess. The factor 10 applies to measured states. It is 1 for other
states that a trim balances, and 1e-6 for held and for the remaining states.

Gauss-Newton steps use exact sensitivities. A step that does not lower L is damped by Levenberg's
rule. The initial state of each record is eliminated from the normal equations.

Source: R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., 2015, chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.records import Record
from hfa_identify.response import Responses, Simulation

#: Standard deviations of the guess of an initial state, in nominal values: this one for a measured
#: state, 1 for another, and the next one for a held state and for one that a trim does not balance
#: (altitude, heading), which thus keep their guess.
_DEVIATION_MEASURED = 10.0
_DEVIATION_HELD = 1e-6
#: The search converges if the parameters move by less than this fraction of their standard
#: deviations.
SMALL = 1e-3
#: If no step lowers L, the search has still converged if the undamped step is smaller.
_STUCK = 0.05
#: A decrease of L below this value may be a rounding error and is not counted.
_NO_GAIN = 1e-6
MOST_STEPS = 30
#: Least standard deviation of the noise, in nominal values: the error of the integration.
_LEAST = 1e-6
#: An unknown is kept constant if its range is smaller than this fraction of its standard deviation.
_LOOSE = 0.1
#: Trials of a step, in this order: damping, and fraction of the step that is made.
_TRIALS = (
    (0.0, 1.0), (0.0, 0.5), (0.0, 0.25), (1e-4, 1.0), (1e-3, 1.0), (1e-2, 1.0), (1e-1, 1.0),
    (1.0, 1.0), (1e1, 1.0), (1e2, 1.0), (1e3, 1.0), (1e4, 1.0),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations [M B; B' A] [Δθ; Δx₀] = [g; h] of one record.

    Δθ and Δx₀ are the changes of the parameters and of the initial state.

    M: (p, p)
    B: (p, n)
    A: (n, n)
    g: right-hand side for the parameters, (p,)
    h: right-hand side for the initial state, (n,)
    prior: reciprocal variances of the guess of the initial state, which A contains, (n,)
    """

    M: np.ndarray
    B: np.ndarray
    A: np.ndarray
    g: np.ndarray
    h: np.ndarray
    prior: np.ndarray

    @cached_property
    def inverse_A(self) -> np.ndarray:
        """A⁻¹ (n, n), the covariance of the initial state if the parameters are known."""
        return inverse(self.A)

    @property
    def determined(self) -> float:
        """Number of initial states that the record determines, n - tr(A⁻¹ diag(prior))."""
        return len(self.prior) - float(np.diag(self.inverse_A) @ self.prior)

    @property
    def information(self) -> np.ndarray:
        """Fisher information (p, p) of the parameters if the initial state is unknown."""
        part = self.M - self.B @ self.inverse_A @ self.B.T
        return np.asarray(0.5 * (part + part.T))


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters and initial states fitted to records, with the simulations.

    theta: unknowns, (p,).
    starts: state at the first sample of each record, (n,) each.
    noise: noise variances of the measured quantities, (k,).
    residuals: (N, k) for each record, 0 for a missing sample.
    simulated: simulation of each record.
    likelihood: L, as defined in this module.
    steps: number of Gauss-Newton steps.
    converged: whether the search converged.
    search: the search that found the fit and computes its sensitivities.
    """

    theta: np.ndarray
    starts: tuple[np.ndarray, ...]
    noise: np.ndarray
    residuals: tuple[np.ndarray, ...]
    simulated: tuple[Simulation, ...]
    likelihood: float
    steps: int
    converged: bool
    search: OutputError

    @property
    def present(self) -> tuple[np.ndarray, ...]:
        """(N, k) for each record, False for a missing sample."""
        return self.search.present

    @cached_property
    def slopes(self) -> tuple[np.ndarray, ...]:
        """Sensitivities of the simulated quantities of each record, (N, k, p + n)."""
        return tuple(map(self.search.responses.slopes, self.simulated))

    @cached_property
    def normals(self) -> tuple[Normal, ...]:
        """The normal equations of each record.

        Raises FloatingPointError if they are not finite.
        """
        return tuple(self.search.normal(self, number) for number in range(len(self.starts)))

    @cached_property
    def information(self) -> np.ndarray:
        """Fisher information (p, p) of the parameters if the initial states are unknown."""
        return np.sum([normal.information for normal in self.normals], axis=0)

    @cached_property
    def projected(self) -> tuple[np.ndarray, ...]:
        """Sensitivities to the parameters, (N, k, p) for each record.

        The part that a change of the initial state explains is subtracted.
        """
        p = len(self.theta)
        return tuple(
            self.beyond_start(number, slopes[:, :, :p]) for number, slopes in enumerate(self.slopes)
        )

    def weights(self, number: int) -> np.ndarray:
        """Return the reciprocal noise variances, 0 for a missing sample, (N, k).

        number: index of the record
        """
        return np.where(self.present[number], 1.0 / self.noise, 0.0)

    def beyond_start(self, number: int, slopes: np.ndarray) -> np.ndarray:
        """Return sensitivities without the part that a change of the initial state explains.

        number: index of the record
        slopes: sensitivities, (N, k, c)
        """
        # slopes - S₀ A⁻¹ S₀' R⁻¹ slopes, with the sensitivities S₀ to the initial state
        S0 = self.slopes[number][:, :, len(self.theta) :]
        weighted = S0 * self.weights(number)[:, :, None]
        inverse_A = self.normals[number].inverse_A
        return np.asarray(
            slopes - S0 @ (inverse_A @ np.tensordot(weighted, slopes, ((0, 1), (0, 1))))
        )


class Step(NamedTuple):
    """Step of the unknowns of a fit.

    theta: change of the parameters, (p,)
    starts: change of the initial state of each record, (n,) each
    """

    theta: np.ndarray
    starts: list[np.ndarray]


class OutputError:
    """Search for the parameters and initial states that fit records best.

    bounds: limits of the unknowns, (p, 2).
    guesses: guess of each record's initial state, (n,) each.
    present: (N, k) for each record, False for a missing sample.
    samples: number of samples of each measured quantity in all records, (k,).
    least: least noise variance of each quantity, (k,).
    """

    def __init__(
        self,
        responses: Responses,
        records: Sequence[Record],
        guesses: Sequence[np.ndarray],
    ) -> None:
        self.responses = responses
        self.records = tuple(records)
        signals = responses.signals.values()
        self.bounds = np.array([(signal.min, signal.max) for signal in signals])
        self._begin = np.array([signal.start for signal in signals])
        self.guesses = tuple(guesses)
        self._priors = tuple(_start_weights(responses.model, record) for record in self.records)
        tables = [record.table(responses.measured) for record in self.records]
        self.present = tuple(np.isfinite(table) for table in tables)
        self._measured = tuple(
            np.where(flags, table, 0.0) for flags, table in zip(self.present, tables, strict=True)
        )
        self.samples = np.sum([flags.sum(axis=0) for flags in self.present], axis=0)
        self.least = (_LEAST * responses.model.nominal(responses.measured)) ** 2

    def fit(self, progress: Callable[[float, float], None] | None, begin: Fit | None = None) -> Fit:
        """Return the fit with the least L that Gauss-Newton steps reach.

        begin: fit with which the steps begin, or None for the start values

        Raises FloatingPointError if the first simulation diverges or its sensitivities are not
        finite.
        """
        current = self.at(*((begin.theta, begin.starts) if begin else (self._begin, self.guesses)))
        trial = 0
        for number in range(1, MOST_STEPS + 1):
            if progress is not None:
                progress(number, MOST_STEPS)
            undamped = self._step(current, 0.0)
            change = undamped.theta
            # Root mean square of the change in standard deviations of the parameters.
            size = math.sqrt(max(change @ current.information @ change / len(change), 0.0))
            # Begin one trial before the last accepted one, so that the damping may decrease again.
            trial, lower = self._first_lower(current, undamped, max(0, trial - 1), number)
            if lower is None:
                return replace(current, converged=bool(size < _STUCK))
            is_in_roundoff = size < _STUCK and current.likelihood - lower.likelihood < _NO_GAIN
            current = lower
            if size < SMALL or is_in_roundoff:
                return replace(current, converged=True)
        return current

    def _first_lower(
        self, current: Fit, undamped: Step, first: int, number: int
    ) -> tuple[int, Fit | None]:
        """Return the index of the first of `_TRIALS` whose step does not raise L, and the fit after
        it, or None if the step of every trial raises L or fails.
        """
        low, high = self.bounds.T
        for trial in range(first, len(_TRIALS)):
            damping, fraction = _TRIALS[trial]
            try:
                step = self._step(current, damping) if damping else undamped
                theta = np.clip(current.theta + fraction * step.theta, low, high)
                starts = [
                    start + fraction * change
                    for start, change in zip(current.starts, step.starts, strict=True)
                ]
                lower = self.at(theta, tuple(starts), number)
                if lower.likelihood <= current.likelihood:
                    _ = lower.normals  # a step without finite sensitivities is rejected
                    return trial, lower
            except (FloatingPointError, np.linalg.LinAlgError):
                continue
        return len(_TRIALS), None

    def at(self, theta: np.ndarray, starts: tuple[np.ndarray, ...], steps: int = 0) -> Fit:
        """Return the fit object of given parameters and initial states, without a search.

        It contains the simulations and L, and is marked as not converged.

        theta: unknowns, (p,)
        starts: initial state of each record, (n,) each
        steps: number of Gauss-Newton steps so far

        Raises FloatingPointError if the simulation diverges.
        """
        simulated = tuple(
            self.responses.simulated(record, start, theta)
            for record, start in zip(self.records, starts, strict=True)
        )
        residuals = tuple(
            np.where(flags, table - response.y, 0.0)
            for flags, table, response in zip(self.present, self._measured, simulated, strict=True)
        )
        with np.errstate(over="ignore", invalid="ignore"):
            noise = self._noise(residuals)
            likelihood = self._likelihood(residuals, noise, starts)
        if not math.isfinite(likelihood):
            raise FloatingPointError("the simulation diverges")
        return Fit(
            theta,
            starts,
            noise,
            residuals,
            simulated,
            likelihood,
            steps,
            converged=False,
            search=self,
        )

    def _noise(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return the variances of the residuals (k,)."""
        squares = sum((residual**2).sum(axis=0) for residual in residuals)
        return np.asarray(np.maximum(squares / np.maximum(self.samples, 1), self.least))

    def _likelihood(
        self, residuals: Sequence[np.ndarray], noise: np.ndarray, starts: Sequence[np.ndarray]
    ) -> float:
        """Return L, as defined in this module."""
        # residuals (N, k), noise (k,), starts (n,)
        # squares / noise is N, and -1 cancels it, unless the noise is raised to `least`.
        squares = sum((residual**2).sum(axis=0) for residual in residuals)
        total = 0.5 * float(np.sum(self.samples * (np.log(noise) - 1.0) + squares / noise))
        for start, guess, prior in zip(starts, self.guesses, self._priors, strict=True):
            total += 0.5 * float((start - guess) ** 2 @ prior)
        return total

    def normal(self, fit: Fit, number: int) -> Normal:
        """Return the normal equations of record `number`, with the noise variances of the fit.

        Raises FloatingPointError if they are not finite.
        """
        p = len(self.responses.free)
        slopes = fit.slopes[number]
        weights = np.where(self.present[number], 1.0 / np.sqrt(fit.noise), 0.0)
        rows = (slopes * weights[:, :, None]).reshape(-1, slopes.shape[2])
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = rows.T @ rows
            right_side = rows.T @ (fit.residuals[number] * weights).ravel()
        if not (np.isfinite(matrix).all() and np.isfinite(right_side).all()):
            raise FloatingPointError("the simulation diverges")
        prior = self._priors[number]
        return Normal(
            M=matrix[:p, :p],
            B=matrix[:p, p:],
            A=matrix[p:, p:] + np.diag(prior),
            g=right_side[:p],
            h=right_side[p:] + prior * (self.guesses[number] - fit.starts[number]),
            prior=prior,
        )

    def _step(self, current: Fit, damping: float) -> Step:
        """Return the Gauss-Newton step from a fit, damped by Levenberg's rule."""
        # The initial states are eliminated: (Σ M - B A⁻¹ B') Δθ = Σ g - B A⁻¹ h, and then
        # Δx₀ = A⁻¹ (h - B' Δθ) of each record. A parameter keeps its value in two cases:
        # - The parameter is at a bound and the step points outward.
        # - The records do not determine the parameter within its bounds.
        p = len(current.theta)
        matrix = np.zeros((p, p))
        right_side = np.zeros(p)
        inverses = []
        for normal in current.normals:
            M = normal.M
            inverse_A = normal.inverse_A
            if damping:
                M = M + damping * np.diag(np.diag(M))
                with np.errstate(over="ignore", invalid="ignore"):  # such a step is rejected
                    inverse_A = inverse(normal.A + damping * np.diag(np.diag(normal.A)))
            inverses.append(inverse_A)
            matrix += M - normal.B @ inverse_A @ normal.B.T
            right_side += normal.g - normal.B @ inverse_A @ normal.h
        below = (current.theta <= self.bounds[:, 0]) & (right_side < 0.0)
        above = (current.theta >= self.bounds[:, 1]) & (right_side > 0.0)
        # The standard deviations are at least 1 / √diag(matrix).
        with np.errstate(invalid="ignore"):  # without information, or without bounds
            undetermined = np.diag(matrix) * np.ptp(self.bounds, axis=1) ** 2 < _LOOSE**2
        moves = ~(below | above | undetermined)
        theta = np.zeros(p)
        theta[moves] = _solution(matrix[np.ix_(moves, moves)], right_side[moves])
        starts = [
            inverse_A @ (normal.h - normal.B.T @ theta)
            for inverse_A, normal in zip(inverses, current.normals, strict=True)
        ]
        return Step(theta, starts)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the pseudoinverse of a symmetric matrix, computed after scaling to a unit diagonal."""
    scaled, size = _with_unit_diagonal(matrix)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) / size[:, None] / size)


def _with_unit_diagonal(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return S⁻¹ M S⁻¹ of a matrix M, with diag(S)² its diagonal where positive, and diag(S)."""
    diagonal = np.diag(matrix)
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return matrix / size[:, None] / size, size


def _start_weights(model: Model, record: Record) -> np.ndarray:
    """Return the reciprocal variances (n,) of the guess of a record's initial state."""
    deviations = []  # see `_DEVIATION_MEASURED`
    for name, signal in model.states.items():
        if name in record.measured:
            deviation = _DEVIATION_MEASURED
        elif name in model.steady and name not in record.held:
            deviation = 1.0
        else:
            deviation = _DEVIATION_HELD
        deviations.append(deviation * signal.nominal)
    return 1.0 / np.square(deviations)


def _solution(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the least-squares solution x of A x = b, after scaling A to a unit diagonal."""
    scaled, size = _with_unit_diagonal(A)
    return np.linalg.lstsq(scaled, b / size, rcond=1e-13)[0] / size
